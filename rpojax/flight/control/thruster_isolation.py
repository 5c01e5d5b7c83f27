"""Isolation of thrusters that are open without a command: chamber pressure shows them, a valve shuts them off."""

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from rpojax.core.declared_numbers import number
from rpojax.core.pytree import pytree
from rpojax.flight.control.thruster_allocation import ThrusterLayout

Scalar = Float[Array, ""]


@pytree
class IsolationTuning:
    """When flight software takes a thruster to be stuck open."""

    pressure: Array = number(
        "chamber pressure over its nominal value, while no pulse is commanded, above which a thruster is open",
        above=0.0,
        below=1.0,
        default=0.3,
        key="isolation.pressure",
    )
    samples: Array = number(
        "consecutive samples above that, one in each step of the plant, after which the thruster is shut off",
        at_least=1.0,
        default=3.0,
        key="isolation.samples",
    )


@pytree
class Isolation:
    """What flight software knows of thrusters that are open without a command.

    Attributes:
        samples: (n,) latest consecutive samples with pressure and without a pulse [-]
        pressure: (n,) of the latest sample over nominal, 0 below the limit and during a pulse [-]
        shut_at: (n,) when the isolation valve was commanded shut [s], infinite before
    """

    samples: Array
    pressure: Array
    shut_at: Array


@pytree
class OpenTime:
    """For how long thrusters were open without a command, at full thrust.

    Attributes:
        time: (n,) [s]
        variance: (n,) of its error, as samples tell of begin and end to a step alone [s^2]
    """

    time: Array
    variance: Array


def never_open(isolation: Isolation) -> OpenTime:
    """No time yet of the thrusters that are watched."""
    none = jnp.zeros_like(isolation.pressure)
    return OpenTime(time=none, variance=none)


def initial(thrusters: ThrusterLayout) -> Isolation:
    """Thrusters without any sign of a failure."""
    none = jnp.zeros_like(thrusters.cost)
    return Isolation(samples=none, pressure=none, shut_at=none + jnp.inf)


def is_shut_off(isolation: Isolation) -> Bool[Array, " n"]:
    """Which thrusters have been isolated."""
    return jnp.isfinite(isolation.shut_at)


def watch(
    tuning: IsolationTuning,
    before: Isolation,
    pressure: Float[Array, " n"],
    on_time: Float[Array, " n"],
    dt: float,
    time: Scalar,
) -> tuple[Isolation, OpenTime]:
    """Knowledge after a step, and for how long each thruster was open in it without a command.

    Args:
        tuning: thresholds
        before: knowledge at the begin of the step
        pressure: (n,) in the chambers over nominal, at the end of the step [-]
        on_time: (n,) of the commanded pulses, from the begin of the step on [s]
        dt: duration of the step [s]
        time: () end of the step since the start of the run [s]
    """
    # A pulse that lasts to the end of the step explains the pressure, and tells nothing.
    rests = on_time < dt
    is_open = rests & (pressure > tuning.pressure)
    samples = jnp.where(rests, jnp.where(is_open, before.samples + 1.0, 0.0), before.samples)
    fails = samples >= jnp.round(tuning.samples)
    after = Isolation(
        samples=samples,
        pressure=jnp.where(is_open, pressure, 0.0),
        shut_at=jnp.where(fails, jnp.minimum(before.shut_at, time), before.shut_at),
    )
    # The trapezoid of two samples. Where one of them is zero, the valve moved at any instant of the step.
    rest, moved = jnp.maximum(dt - on_time, 0.0), (before.pressure > 0.0) != (after.pressure > 0.0)
    open_time = 0.5 * (before.pressure + after.pressure) * rest
    return after, OpenTime(time=open_time, variance=jnp.where(moved, rest * rest / 12.0, 0.0))
