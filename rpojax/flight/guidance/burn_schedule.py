"""Burn planning: times of turn, ignition and cut-off, burn attitude, and inhibition of thrust."""

import math

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from rpojax.core import quaternion
from rpojax.core.numerics import gradient_safe
from rpojax.core.pytree import pytree, replace, select
from rpojax.core.quaternion import rotate
from rpojax.flight.control.reference_governor import LEAST_DELTA_V
from rpojax.flight.guidance.pointing_tuning import GuidanceSoftware, PointingTuning
from rpojax.flight.guidance.slew_profile import slew_duration

Vector = Float[Array, "3"]
Scalar = Float[Array, ""]
Flag = Bool[Array, ""]


@pytree
class BurnPlan:
    """Latest decided burn. Times count from the start of the run.

    Attributes:
        turn_start: () [s]
        ignition: () [s]
        cutoff: () equal to ignition when there is no burn [s]
        delta_v_N: (3,) [m/s]
        q_burn: (4,) attitude during the burn
    """

    turn_start: Array
    ignition: Array
    cutoff: Array
    delta_v_N: Array
    q_burn: Array


def no_burn() -> BurnPlan:
    """Plan before the first decision."""
    zero = jnp.zeros((), dtype=jnp.float64)
    identity = jnp.array([1.0, 0.0, 0.0, 0.0], dtype=jnp.float64)
    return BurnPlan(turn_start=zero, ignition=zero, cutoff=zero, delta_v_N=jnp.zeros(3), q_burn=identity)


def schedule_burn(
    guidance: GuidanceSoftware, delta_v_N: Vector, q_look: Float[Array, "4"], allowed: Flag, time: Scalar
) -> BurnPlan:
    """Next burn with a commanded velocity change [m/s], and a turn from the look attitude `q_look` before it.

    There is no burn inside the dead band, below the thruster's minimum on-time, or unless `allowed`; a burn too long
    for the look-away limit is shortened.
    """
    formation, pointing, vehicle, dt = guidance.formation, guidance.pointing, guidance.vehicle, guidance.tick_s
    size, direction_N = gradient_safe.norm(delta_v_N), gradient_safe.normalize(delta_v_N)

    turn_N, turn_time = _turn_to_burn(guidance, direction_N, q_look)
    # The turn begins up to one tick late, and the attitude is checked up to one tick before ignition.
    settle_time = jnp.maximum(pointing.settle_time, _SETTLE_TICKS * dt)
    on_time = jnp.minimum(size * vehicle.mass / vehicle.thrust, longest_on_time(pointing, turn_time, dt))
    margin = size - formation.dead_band
    above_dead_band = gradient_safe.gate(margin, formation.dead_band_slope * (formation.dead_band + _LEAST_DEAD_BAND))
    possible = (on_time >= vehicle.minimum_on_time) & allowed
    on_time = above_dead_band * jnp.where(possible, on_time, 0.0)
    ignition = time + formation.lead - 0.5 * on_time
    return BurnPlan(
        # Without a burn there is no look-away: the turn starts when it is already over.
        turn_start=jnp.where(on_time > 0.0, jnp.maximum(ignition - settle_time - turn_time, time), ignition),
        ignition=ignition,
        cutoff=ignition + on_time,
        delta_v_N=on_time * vehicle.thrust / vehicle.mass * direction_N,
        q_burn=quaternion.multiply(q_look, quaternion.exp(-turn_N)),
    )


def straight_burn(delta_v_N: Vector, q_look: Float[Array, "4"], ignition: Scalar, on_time: Scalar) -> BurnPlan:
    """Burn of a velocity change [m/s] for an on-time [s] from an ignition on, at the look attitude `q_look`."""
    return BurnPlan(
        turn_start=ignition, ignition=ignition, cutoff=ignition + on_time, delta_v_N=delta_v_N, q_burn=q_look
    )


def certain_delta_v(guidance: GuidanceSoftware) -> Scalar:
    """Velocity change [m/s] of the longest burn in any direction: between two turns by half a circle."""
    vehicle = guidance.vehicle
    half_turn = slew_duration(guidance.pointing, jnp.full_like(vehicle.mass, math.pi))
    return longest_on_time(guidance.pointing, half_turn, guidance.tick_s) * vehicle.thrust / vehicle.mass


def largest_delta_v(guidance: GuidanceSoftware, delta_v_N: Vector, q_look: Float[Array, "4"]) -> Scalar:
    """Velocity change [m/s] of the longest burn in the direction of `delta_v_N` from the look attitude `q_look`."""
    vehicle = guidance.vehicle
    _, turn_time = _turn_to_burn(guidance, gradient_safe.normalize(delta_v_N), q_look)
    return longest_on_time(guidance.pointing, turn_time, guidance.tick_s) * vehicle.thrust / vehicle.mass


def share_within_limit(guidance: GuidanceSoftware, delta_v_N: Vector, q_look: Float[Array, "4"]) -> Scalar:
    """Part of a velocity change [m/s] that is left where the look-away limit shortens its burn, 1 where it does not.

    Arguments are those of `largest_delta_v`.
    """
    limit = largest_delta_v(guidance, delta_v_N, q_look)
    return limit / jnp.maximum(gradient_safe.norm(delta_v_N), jnp.maximum(limit, LEAST_DELTA_V))


def _turn_to_burn(guidance: GuidanceSoftware, direction_N: Vector, q_look: Float[Array, "4"]) -> tuple[Vector, Scalar]:
    """Rotation vector in N [rad] that turns the thrust from the look attitude to a direction, and its time [s]."""
    thrust_now_N = rotate(quaternion.conjugate(q_look), guidance.vehicle.thrust_direction)
    turn_N = quaternion.rotation_vector_between(thrust_now_N, direction_N)
    return turn_N, slew_duration(guidance.pointing, gradient_safe.norm(turn_N))


def longest_on_time(pointing: PointingTuning, turn_time: Scalar, dt: float) -> Scalar:
    """Longest burn [s] between two turns of `turn_time` [s] within the look-away limit."""
    settle_time = jnp.maximum(pointing.settle_time, _SETTLE_TICKS * dt)
    margin = _SCHEDULE_TICKS * dt + _TARGET_MOTION_TIME
    return jnp.maximum(pointing.look_away_limit - 2.0 * turn_time - settle_time - margin, 0.0)


_LEAST_DEAD_BAND = 2e-5
"""Added to the dead band in the width of its slope, by which a derivative is divided [m/s]."""


_SETTLE_TICKS = 3.0
"""Least number of guidance ticks between the end of the turn and ignition: two of delay, and one to settle [-]."""


_SCHEDULE_TICKS = 2.0
"""Turns begin on whole guidance ticks, which can add one to each of them [-]."""


_TARGET_MOTION_TIME = 1.0
"""Time that the target's own motion adds to a turn [s]: in a low orbit the line of sight turns by 7 deg in the 110 s of
a look-away, which makes a half turn at 16 mrad/s^2 longer by 0.7 s."""


@pytree
class ExternalBurn:
    """Burn commanded by an external program; times since the start of the run.

    Attributes:
        commanded: () bool, whether there is a command in this tick; without one the plan stays
        ignition: () [s]
        cutoff: () [s]; the valve closes immediately if it is not later than the ignition
        q_burn: (4,) body attitude during the burn
    """

    commanded: Array
    ignition: Array
    cutoff: Array
    q_burn: Array


def plan_from_command(
    guidance: GuidanceSoftware, burn: ExternalBurn, before: BurnPlan, q_look: Float[Array, "4"], time: Scalar
) -> BurnPlan:
    """Burn plan from an external command, with a turn from the look attitude `q_look` before it.

    A command with the ignition of the plan `before` only changes its cut-off. Without on-time the valve closes now.
    """
    pointing, vehicle = guidance.pointing, guidance.vehicle
    ignition, cutoff, q_burn = burn.ignition, burn.cutoff, burn.q_burn
    wanted = cutoff > ignition
    turn = quaternion.log(quaternion.multiply(q_burn, quaternion.conjugate(q_look)))
    turn_start = jnp.maximum(ignition - pointing.settle_time - slew_duration(pointing, gradient_safe.norm(turn)), time)
    direction_N = rotate(quaternion.conjugate(q_burn), vehicle.thrust_direction)
    commanded = BurnPlan(
        turn_start=jnp.where(ignition == before.ignition, before.turn_start, turn_start),
        ignition=ignition,
        cutoff=cutoff,
        delta_v_N=(cutoff - ignition) * vehicle.thrust / vehicle.mass * direction_N,
        q_burn=q_burn,
    )
    stopped = jnp.minimum(before.ignition, time)
    closed = replace(before, ignition=stopped, cutoff=jnp.clip(before.cutoff, stopped, time))
    return select(burn.commanded, select(wanted, commanded, closed), before)


def inhibit(guidance: GuidanceSoftware, plan: BurnPlan, q_BN: Float[Array, "4"], time: Scalar) -> BurnPlan:
    """Plan with thrust cut off if it is due before the next tick and the attitude is too far from the burn's."""
    # The scalar product of two unit quaternions is the cosine of half the angle between the attitudes.
    half_angle_cosine = jnp.abs(jnp.sum(plan.q_burn * q_BN, axis=0))
    mispointed = half_angle_cosine < jnp.cos(0.5 * guidance.pointing.burn_attitude_limit)
    firing = (time + guidance.tick_s > plan.ignition) & (time < plan.cutoff)
    stop = mispointed & firing
    ignition = jnp.where(stop, jnp.minimum(plan.ignition, time), plan.ignition)
    return replace(plan, ignition=ignition, cutoff=jnp.where(stop, jnp.maximum(ignition, time), plan.cutoff))
