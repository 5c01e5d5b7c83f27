"""Control of the reaction control system: shares of thrust for a tick, and pulses in the steps of the plant."""

from typing import Final

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from rpojax.core import quaternion
from rpojax.core.numerics import gradient_safe
from rpojax.core.pytree import pytree, replace
from rpojax.core.vectors import apply_transposed
from rpojax.flight.control import thruster_allocation, thruster_isolation
from rpojax.flight.control.thruster_allocation import ThrusterLayout
from rpojax.flight.control.thruster_isolation import Isolation, OpenTime
from rpojax.flight.navigation.orbit_filter_tuning import OrbitFilterTuning
from rpojax.flight.vehicle_model import VehicleModel

Scalar = Float[Array, ""]
Vector = Float[Array, "3"]


@pytree
class RcsCommand:
    """Command of the reaction control system for a tick, and what its thrusters owe.

    Attributes:
        shares: (n,) of full thrust [-]
        owed: (n,) on-time that was commanded and is not given yet, as it is shorter than a pulse [s]
        acts: () bool, whether the phase translates by these thrusters
        ratio: (n,) thrust over its nominal value by the pressure in the chambers, 1 without a sensor [-]
        used: () propellant that the commanded pulses took since the start [kg]
        isolation: what is known of thrusters that are open without a command, None where they are not isolated
    """

    shares: Array
    owed: Array
    acts: Array
    ratio: Array
    used: Array
    isolation: Isolation | None = None


def no_command(thrusters: ThrusterLayout, isolates: bool = False) -> RcsCommand:
    """Closed valves."""
    none = jnp.zeros_like(thrusters.cost)
    isolation = thruster_isolation.initial(thrusters) if isolates else None
    return RcsCommand(
        shares=none,
        owed=none,
        acts=jnp.zeros((), dtype=bool),
        ratio=none + 1.0,
        used=jnp.zeros_like(thrusters.greatest_flow),
        isolation=isolation,
    )


def with_propellant_used(vehicle: VehicleModel, given: RcsCommand) -> VehicleModel:
    """Vehicle without the propellant that pulses took: 13 m/s by cold gas are a fiftieth of the mass."""
    return replace(vehicle, mass=vehicle.mass - given.used)


def after_pulses(thrusters: ThrusterLayout, given: RcsCommand, on_time: Float[Array, " n"]) -> RcsCommand:
    """Command that counts the propellant of pulses of (n,) on-times [s]."""
    taken = thrusters.greatest_flow * jnp.sum(thrusters.cost * given.ratio * on_time, axis=0)
    return replace(given, used=given.used + taken)


def command(
    thrusters: ThrusterLayout,
    vehicle: VehicleModel,
    before: RcsCommand,
    q_BN: Float[Array, "4"],
    delta_v_N: Vector,
    wheel_speed: Vector,
    acts: Bool[Array, ""],
    may_fire: Bool[Array, " n"],
    tick_s: float,
) -> RcsCommand:
    """Command for a velocity change [m/s] over a tick at the estimated attitude, which also unloads the wheels.

    The velocity change is limited to what any direction allows. `wheel_speed` (3,) is that of the tachometers [rad/s],
    `may_fire` (n,) says which thrusters may be used.
    """
    limit = thrusters.authority / vehicle.mass * tick_s
    delta_v_N = delta_v_N * limit / jnp.maximum(gradient_safe.norm(delta_v_N), limit)
    force_B = quaternion.rotate(q_BN, delta_v_N) * (vehicle.mass / tick_s)
    momentum_B = apply_transposed(vehicle.wheel_axes, vehicle.wheel_inertia * wheel_speed)
    wrench = jnp.concatenate([force_B, -momentum_B / _UNLOADING_TIME])
    works = jnp.where((before.ratio > _FAILED_RATIO) & may_fire, 1.0, 0.0)
    shares = thruster_allocation.allocate(_as_known(thrusters, before), wrench, works)
    return replace(
        before,
        shares=jnp.where(acts, shares, 0.0),
        owed=jnp.where(acts & may_fire, before.owed, 0.0),
        acts=acts,
    )


def pulses(
    thrusters: ThrusterLayout,
    given: RcsCommand,
    owed: Float[Array, " n"],
    dt: float,
    isolation: Isolation | None = None,
) -> tuple[Float[Array, " n"], Float[Array, " n"]]:
    """On-times of the next step of `dt` [s], and what is owed after it [s].

    A valve opens as soon as it owes its shortest pulse, so that the mean over some steps is the share. One behind a
    shut isolation valve owes nothing.
    """
    due = owed + given.shares * dt
    if isolation is not None:
        due = jnp.where(thruster_isolation.is_shut_off(isolation), 0.0, due)
    on_time = jnp.where(due >= thrusters.minimum_on_time, jnp.minimum(due, dt), 0.0)
    return on_time, due - on_time


def effort(thrusters: ThrusterLayout, vehicle: VehicleModel, shares: Float[Array, " n"]) -> Scalar:
    """Sum of the sizes of all accelerations [m/s^2] at shares of full thrust, also of those that cancel each other."""
    forces = jax.vmap(gradient_safe.norm, in_axes=1)(thrusters.wrench[:3])
    return jnp.sum(shares * forces, axis=0) / vehicle.mass


def burn_size(
    thrusters: ThrusterLayout,
    vehicle: VehicleModel,
    given: RcsCommand,
    uncommanded: OpenTime | None,
    delta_v_N: Vector,
    tuning: OrbitFilterTuning,
    tick_s: float,
) -> Scalar:
    """Size [m/s] of a burn whose errors are those of the pulses of a tick with a velocity change in N [m/s].

    Thrusters push partly against each other, and each has its error: it grows with the sum of all forces, not with the
    velocity change that is left of them. When one opened or closed without a command is known to a step alone.
    """
    size = gradient_safe.norm(delta_v_N)
    if uncommanded is None:
        spent = effort(thrusters, vehicle, given.shares) * tick_s
        return spent * gradient_safe.safe_div(spent, size)
    spent = effort(thrusters, vehicle, given.shares + uncommanded.time / tick_s) * tick_s
    errors = gradient_safe.sqrt(uncommanded.variance) / tuning.burn_magnitude_sigma
    timing = effort(thrusters, vehicle, errors)
    return gradient_safe.safe_div(spent**2 + timing**2, size)


def learn_ratios(given: RcsCommand, measured: Float[Array, " n"], fired: Float[Array, " n"]) -> RcsCommand:
    """Command with the thrust that the chambers' pressures over nominal (n,) show of those that `fired` [s]."""
    change = measured - given.ratio
    # A failure is believed at once, the noise of sound ones is averaged.
    gain = jnp.where(jnp.abs(change) > _JUMP, 1.0, _PRESSURE_GAIN)
    return replace(given, ratio=given.ratio + jnp.where(fired > 0.0, gain * change, 0.0))


def shut_off(given: RcsCommand) -> RcsCommand:
    """Command that knows that isolated thrusters give nothing any more."""
    if given.isolation is None:
        return given
    return replace(given, ratio=jnp.where(thruster_isolation.is_shut_off(given.isolation), 0.0, given.ratio))


def _as_known(thrusters: ThrusterLayout, given: RcsCommand) -> ThrusterLayout:
    """The layout with the thrust that each is known to have."""
    return replace(thrusters, wrench=thrusters.wrench * given.ratio[None, :])


def expected_delta_v(
    thrusters: ThrusterLayout,
    vehicle: VehicleModel,
    given: RcsCommand,
    q_BN: Float[Array, "4"],
    on_time: Float[Array, " n"],
) -> Vector:
    """Velocity change in N [m/s] that flight software expects of pulses."""
    return delta_v(_as_known(thrusters, given), vehicle, q_BN, on_time)


def delta_v(
    thrusters: ThrusterLayout, vehicle: VehicleModel, q_BN: Float[Array, "4"], on_time: Float[Array, " n"]
) -> Vector:
    """Velocity change in N [m/s] of thrusters that are open for their on-times [s], at full thrust."""
    impulse_B = jnp.sum(thrusters.wrench[:3] * on_time[None, :], axis=1)
    return quaternion.rotate(quaternion.conjugate(q_BN), impulse_B) / vehicle.mass


_UNLOADING_TIME: Final = 200.0
"""Time constant with which thrusters take the momentum of the wheels [s]. A choice: below a hundredth of the torque of
a thruster of 0.25 N at 0.3 m for full wheels of 50 mN m s, and well within an approach."""
_FAILED_RATIO: Final = 0.3
"""Thrust over its nominal value below which a thruster is not used any more [-]. As that of the one thruster."""
_JUMP: Final = 0.2
"""Change of a chamber's pressure over nominal that is a failure [-]. A choice: seven sigma of its noise."""
_PRESSURE_GAIN: Final = 0.05
"""Gain of the fading mean of the pressure [-]. A choice: a fifth of its noise is left."""
