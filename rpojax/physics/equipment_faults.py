"""Equipment faults of the servicer: a list of faults per run, each of one kind, for some time."""

from collections.abc import Mapping
from functools import reduce
from typing import Any, Final, Literal, get_args

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from rpojax.core.declared_numbers import number
from rpojax.core.pytree import pytree, replace
from rpojax.physics.plant_options import FaultKind

Scalar = Float[Array, ""]

KINDS: tuple[str, ...] = get_args(FaultKind)
"""Kinds of fault; a fault's code is its index here."""
STUCK_OPEN: Final = "thruster_stuck_open"
"""Kind in which a thruster burns all the time, whatever is commanded."""
LEAKS: Final = (STUCK_OPEN, "thruster_leak")
"""Kinds in which a thruster gives force without a command."""


def kind_code(kind: object) -> Any:
    """Code of a kind of fault; anything but a name is returned as it is."""
    return KINDS.index(kind) if isinstance(kind, str) else kind


SEIZURE_TIME_CONSTANT = 2.0
"""Time constant with which a stuck wheel stops [s]. A choice: ten steps of the plant at 5 Hz, which resolve it."""


@pytree
class Fault:
    """Fault of one piece of equipment."""

    kind: Array = number("kind of fault", form=FaultKind)
    start: Array = number("time of the fault", unit="s", at_least=0.0, default=0.0)
    duration: Array = number("its duration; by default it lasts for good", unit="s", above=0.0, default=1e9)
    severity: Array = number(
        "fraction of thrust that `thruster_weak` loses or `thruster_leak` gives without a command, or of the torque "
        "limit that `wheel_friction` takes",
        at_least=0.0,
        at_most=1.0,
        default=0.5,
    )
    wheel: Array = number("index of the wheel of a wheel fault", form=Literal[0, 1, 2], default=0)
    thruster: Array = number(
        "number of the thruster of a thruster fault among `[[thrusters]]` in the order of their names, from 0",
        at_least=0.0,
        default=0.0,
    )


Faults = Mapping[str, Fault]
"""Faults of a run by their names; their number is static."""


@pytree
class Health:
    """State of the equipment at one time.

    Attributes:
        thrust_fraction: () remaining fraction of the thruster's force [-]
        wheel_friction: (3,) additional bearing friction, as a fraction of the torque limit [-]
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
    """Health of equipment without any fault."""
    yes = jnp.ones((), dtype=bool)
    return Health(
        thrust_fraction=jnp.ones((), dtype=jnp.float64),
        wheel_friction=jnp.zeros(3, dtype=jnp.float64),
        wheel_stuck=jnp.zeros(3, dtype=bool),
        gps=yes,
        star_tracker=yes,
        camera=yes,
    )


def with_propellant(health: Health, is_left: Bool[Array, ""]) -> Health:
    """Health of the equipment, without thrust unless propellant is left."""
    return replace(health, thrust_fraction=jnp.where(is_left, health.thrust_fraction, 0.0))


def in_order(faults: Faults) -> list[Fault]:
    """Faults in the order of their names, which a mapping has after a compiled program."""
    return [faults[name] for name in sorted(faults)]


def health_at(faults: Faults, time: Scalar) -> Health:
    """Health of the equipment at `time` [s] from the start of the run, with all faults that act then.

    Fractions of thrust multiply, and frictions add.
    """
    each = [_health_of(fault, time) for fault in in_order(faults)]
    return reduce(_both, each) if each else healthy()


def _health_of(fault: Fault, time: Scalar) -> Health:
    """Health of the equipment with one fault alone."""
    active = _is_active(fault, time)

    def is_kind(name: str) -> Bool[Array, ""]:
        return active & (jnp.round(fault.kind) == KINDS.index(name))

    affected_wheel = jnp.arange(3, dtype=fault.wheel.dtype) == jnp.round(fault.wheel)
    lost_thrust = _lost_thrust(fault, active)
    return Health(
        thrust_fraction=1.0 - lost_thrust,
        wheel_friction=jnp.where(affected_wheel & is_kind("wheel_friction"), fault.severity, 0.0),
        wheel_stuck=affected_wheel & is_kind("wheel_stuck"),
        gps=~is_kind("gps_outage"),
        star_tracker=~is_kind("star_tracker_blind"),
        camera=~is_kind("camera_blackout"),
    )


def _both(one: Health, other: Health) -> Health:
    """Health of equipment that has two faults at once."""
    return Health(
        thrust_fraction=one.thrust_fraction * other.thrust_fraction,
        wheel_friction=one.wheel_friction + other.wheel_friction,
        wheel_stuck=one.wheel_stuck | other.wheel_stuck,
        gps=one.gps & other.gps,
        star_tracker=one.star_tracker & other.star_tracker,
        camera=one.camera & other.camera,
    )


def _is_active(fault: Fault, time: Scalar) -> Bool[Array, ""]:
    """Whether the fault acts at `time` [s]."""
    return (time >= fault.start) & (time < fault.start + fault.duration)


def _lost_thrust(fault: Fault, active: Bool[Array, ""]) -> Scalar:
    """Fraction of the force that the thruster of a fault has lost [-]."""
    kind = jnp.round(fault.kind)
    weak = jnp.where(kind == KINDS.index("thruster_weak"), fault.severity, 0.0)
    return jnp.where(active, jnp.where(kind == KINDS.index("thruster_off"), 1.0, weak), 0.0)


def rcs_fractions(faults: Faults, time: Scalar, count: int) -> Float[Array, " n"]:
    """Remaining fraction of the force of each of `count` thrusters of the reaction control system [-]."""

    def left(fault: Fault) -> Float[Array, " n"]:
        return 1.0 - jnp.where(_is_affected(fault, count), _lost_thrust(fault, _is_active(fault, time)), 0.0)

    each = [left(fault) for fault in in_order(faults)]
    return reduce(jnp.multiply, each) if each else jnp.ones(count, dtype=jnp.float64)


def leak_shares(fault: Fault, count: int) -> Float[Array, " n"]:
    """Share of the full force that each of `count` thrusters gives without a command while the fault acts [-].

    A valve that is stuck open gives all of it, one that leaks the severity of the fault.
    """
    leaks = jnp.where(jnp.round(fault.kind) == KINDS.index("thruster_leak"), fault.severity, 0.0)
    return jnp.where(is_stuck_open(fault, count), 1.0, jnp.where(_is_affected(fault, count), leaks, 0.0))


def is_stuck_open(fault: Fault, count: int) -> Bool[Array, " n"]:
    """Which of `count` thrusters of the reaction control system stays open while the fault acts."""
    return _is_affected(fault, count) & (jnp.round(fault.kind) == KINDS.index(STUCK_OPEN))


def _is_affected(fault: Fault, count: int) -> Bool[Array, " n"]:
    """Which of `count` thrusters of the reaction control system the fault of a thruster is of."""
    return jnp.arange(count, dtype=fault.thruster.dtype) == jnp.round(fault.thruster)


def radio_works(faults: Faults, time: Scalar) -> Bool[Array, ""]:
    """False while the radio of a servicer of a team neither sends nor receives, at `time` [s] from the start."""

    def works(fault: Fault) -> Bool[Array, ""]:
        return ~(_is_active(fault, time) & (jnp.round(fault.kind) == KINDS.index("radio_off")))

    each = [works(fault) for fault in in_order(faults)]
    return reduce(jnp.logical_and, each) if each else jnp.ones((), dtype=bool)
