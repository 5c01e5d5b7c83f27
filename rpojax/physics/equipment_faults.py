"""What can go wrong with the servicer's equipment: one fault per run, of some kind, for some time."""

from typing import Any, get_args

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from rpojax.core.pytree import pytree
from rpojax.physics.plant_options import FaultKind

Scalar = Float[Array, ""]

KINDS: tuple[str, ...] = get_args(FaultKind)
"""Kinds of fault; a fault's code is its place here."""


def kind_code(kind: object) -> Any:
    """Code of a kind of fault; anything but a name is returned as it is."""
    return KINDS.index(kind) if isinstance(kind, str) else kind


SEIZURE_TIME_CONSTANT = 2.0
"""A stuck wheel stops with this time constant [s]."""


@pytree
class Fault:
    """A fault of one piece of equipment.

    Attributes:
        kind: () its code, the place in `KINDS`
        start: () [s]
        duration: () [s]
        severity: () share of the thrust that a weak thruster lacks, or of the torque limit that friction takes [-]
        wheel: () number of the wheel that a wheel fault strikes
    """

    kind: Array
    start: Array
    duration: Array
    severity: Array
    wheel: Array


@pytree
class Health:
    """What works at the present time.

    Attributes:
        thrust: () share of the thruster's force that is left [-]
        wheel_friction: (3,) additional bearing friction, as a share of the torque limit [-]
        wheel_stuck: (3,) bool
        gps: () bool, works
        star_tracker: () bool, works
        camera: () bool, works
    """

    thrust_fraction: Array
    wheel_friction: Array
    wheel_stuck: Array
    gps: Array
    star_tracker: Array
    camera: Array


def healthy() -> Health:
    """Everything works."""
    yes = jnp.ones((), dtype=bool)
    return Health(
        thrust_fraction=jnp.ones((), dtype=jnp.float64),
        wheel_friction=jnp.zeros(3, dtype=jnp.float64),
        wheel_stuck=jnp.zeros(3, dtype=bool),
        gps=yes,
        star_tracker=yes,
        camera=yes,
    )


def health_at(fault: Fault, time: Scalar) -> Health:
    """What works at `time` [s] from the start of the run."""
    active = (time >= fault.start) & (time < fault.start + fault.duration)

    def is_kind(name: str) -> Bool[Array, ""]:
        return active & (jnp.round(fault.kind) == KINDS.index(name))

    affected_wheel = jnp.arange(3, dtype=fault.wheel.dtype) == jnp.round(fault.wheel)
    lost_thrust = jnp.where(is_kind("thruster_off"), 1.0, jnp.where(is_kind("thruster_weak"), fault.severity, 0.0))
    return Health(
        thrust_fraction=1.0 - lost_thrust,
        wheel_friction=jnp.where(affected_wheel & is_kind("wheel_friction"), fault.severity, 0.0),
        wheel_stuck=affected_wheel & is_kind("wheel_stuck"),
        gps=~is_kind("gps_outage"),
        star_tracker=~is_kind("star_tracker_blind"),
        camera=~is_kind("camera_blackout"),
    )
