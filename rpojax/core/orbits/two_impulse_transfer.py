"""Free relative motion between two positions in a given time, and what is flown near times that admit none."""

import math
from typing import Final

import jax.numpy as jnp
from jaxtyping import Array, Float

from rpojax.core.orbits.yamanaka_ankersen import (
    TargetOrbit,
    advanced,
    constants_of_motion,
    free_motion,
    time_of_last_turn,
)
from rpojax.core.pytree import pytree

Scalar = Float[Array, ""]
Vector = Float[Array, "3"]
State = Float[Array, "6"]


def departure_velocity(
    transition: Float[Array, "6 6"], start: Vector, end: Vector, dt: Scalar, angle: Scalar
) -> Vector:
    """Velocity rho_dot [m/s] at `start` [m] with which the free motion is at `end` [m] after `dt` [s].

    `transition` is the state transition matrix over `dt`, whose motion across the orbit plane is decoupled, and `angle`
    about that by which the target moves [rad]. Some times admit no such motion: for the cross-track part whenever the
    target has moved by half turns, for the part in the plane after whole orbits and between them. Next to these times
    the velocity is bounded, and the end is missed: `TransferArc` is for any time, this for times well below half an
    orbit.
    """
    drift = end - jnp.sum(transition[:3, :3] * start[None, :], axis=1)
    by_velocity = transition[:3, 3:] / dt
    (a, b), (c, d) = by_velocity[0, :2], by_velocity[1, :2]
    least = _LEAST / jnp.sqrt(1.0 + angle * angle)
    in_plane = _bounded_inverse(a * d - b * c, least)
    across = _bounded_inverse(by_velocity[2, 2], least)
    x, y, z = drift / dt
    return jnp.stack([(d * x - b * y) * in_plane, (a * y - c * x) * in_plane, z * across])


@pytree
class TransferArc:
    """Motion between two positions: free, but for one impulse on the way near times for which two impulses grow large.

    Attributes:
        departure: (6,) constants of the free motion after the departure [m], of which that is the epoch
        impulse: (6,) constants of the motion that the impulse on the way adds [m], its epoch; zero at regular times
        impulse_after: () time of it after the departure [s]
        delta_v: (3,) velocity change of it in H [m/s]
    """

    departure: Array
    impulse: Array
    impulse_after: Array
    delta_v: Array


def transfer_arc(orbit: TargetOrbit, before: State, end: Vector, dt: Scalar) -> TransferArc:
    """Arc from the position of the state `before` the departure [m, m/s] to `end` [m] in `dt` [s] > 0.

    At regular times it is the free motion with both ends. Near the others (see `departure_velocity`) a change of the
    velocity at departure moves the end hardly along one direction. The change is damped in that direction (Tikhonov),
    so that it goes over into the one of least size, and the rest of the way to the end is made by an impulse a quarter
    of a turn before the arrival, which moves the end in all directions. The arc is a smooth function of all arguments.
    """
    there = advanced(orbit, dt)
    constants = constants_of_motion(orbit, jnp.eye(6, dtype=before.dtype))
    motion = free_motion(there, dt, constants)
    angle = there.argument_of_latitude - orbit.argument_of_latitude
    missing = end - jnp.sum(motion[:3] * before[None, :], axis=1)
    change = _damped_change(motion[:3, 3:], missing, dt, angle)
    left = missing - jnp.sum(motion[:3, 3:] * change[None, :], axis=1)
    last = jnp.minimum(time_of_last_turn(there, _QUARTER_TURN), _LONGEST_SHARE * dt)
    place = advanced(orbit, dt - last)
    of_impulse = constants_of_motion(place, jnp.eye(6, dtype=before.dtype)[:, 3:])
    delta_v = departure_velocity(
        jnp.concatenate([jnp.zeros_like(motion[:, :3]), free_motion(there, last, of_impulse)], axis=1),
        jnp.zeros_like(left),
        left,
        last,
        jnp.full_like(last, _QUARTER_TURN),
    )
    departure = before + jnp.concatenate([jnp.zeros_like(change), change])
    return TransferArc(
        departure=jnp.sum(constants * departure[None, :], axis=1),
        impulse=jnp.sum(of_impulse * delta_v[None, :], axis=1),
        impulse_after=dt - last,
        delta_v=delta_v,
    )


def state_on_arc(arc: TransferArc, orbit: TargetOrbit, since: Scalar) -> State:
    """State (rho, rho_dot) [m, m/s] `since` [s] after the departure from a place on the `orbit`."""
    place = advanced(orbit, since)
    after = since - arc.impulse_after
    added = free_motion(place, after, arc.impulse)
    return free_motion(place, since, arc.departure) + jnp.where(after >= 0.0, added, 0.0)


def _damped_change(by_velocity: Float[Array, "3 3"], missing: Vector, dt: Scalar, angle: Scalar) -> Vector:
    """Change of the velocity [m/s] at departure for a `missing` part of the position [m] after `dt` [s].

    The target moves by an `angle` [rad]. The damping is zero unless the matrix, in units of the time or, after more
    than a radian, of the time per radian, has a singular value below `_REGULAR`.
    """
    scale = jnp.sqrt(1.0 + angle * angle) / dt
    matrix = by_velocity * scale
    (a, b), (c, d) = matrix[0, :2], matrix[1, :2]
    x, y, z = missing * scale
    determinant, square = a * d - b * c, a * a + b * b + c * c + d * d
    # The determinant is the product of the singular values: over the norm, the smaller one where the other is large.
    damping = _damping(determinant * determinant / square)
    divisor = determinant * determinant + damping * (square + damping)
    across = matrix[2, 2]
    of_across = across / (across * across + _damping(across * across))
    return jnp.stack(
        [
            (determinant * (d * x - b * y) + damping * (a * x + c * y)) / divisor,
            (determinant * (a * y - c * x) + damping * (b * x + d * y)) / divisor,
            z * of_across,
        ]
    )


def _damping(square: Scalar) -> Scalar:
    """Square of the damping by that of the smallest singular value [-]."""
    share = jnp.minimum(square / _REGULAR**2, 1.0)
    return _REGULAR**2 * (1.0 - share * share * (3.0 - 2.0 * share))


def _bounded_inverse(x: Scalar, least: Scalar) -> Scalar:
    """The inverse, or below `least` a number that goes through zero with `x` and is nowhere larger than at the border.

    An inverse that is cut off would have its largest size, and change its sign, where there is no solution.
    """
    is_regular = jnp.abs(x) > least
    return jnp.where(is_regular, 1.0 / jnp.where(is_regular, x, 1.0), 2.0 * x / (x * x + least * least))


_LEAST: Final = 0.3
"""Least divisor: of a straight line in the time or, after more than a radian, in the time per radian [-]."""
_REGULAR: Final = 0.4
"""Least singular value of a regular time: the sine of 24 deg, for the cross-track motion next to a half turn [-]."""
_LONGEST_SHARE: Final = 0.9
"""Share of the time that is left for the impulse on the way to have its effect, at most [-]."""
_QUARTER_TURN: Final = 0.5 * math.pi
"""Angle before the arrival at which an impulse moves the end in all directions [rad]."""
