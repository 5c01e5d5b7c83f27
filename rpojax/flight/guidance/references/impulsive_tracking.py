"""Free motion between the points of a reference at which burns are made, and the impulses that join its pieces."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from rpojax.core.orbits.keplerian_elements import mean_motion
from rpojax.core.orbits.two_impulse_transfer import departure_velocity
from rpojax.core.orbits.yamanaka_ankersen import TargetOrbit, constants_of_motion, free_motion
from rpojax.core.pytree import pytree

Scalar = Float[Array, ""]
Vector = Float[Array, "3"]


@pytree
class TrackedPoint:
    """Free motion to a point of a reference, and the impulse there for the motion to the next point.

    The impulse is zero where the reference is itself a free motion.

    Attributes:
        arrival_velocity: (3,) rho_dot before the impulse [m/s]
        impulse: (3,) velocity change in H [m/s]
    """

    arrival_velocity: Array
    impulse: Array


def tracked_point(orbits: TargetOrbit, period: Scalar, positions: Float[Array, "3 3"]) -> TrackedPoint:
    """Free motions between the positions [m] of a reference one `period` [s] before a burn, at it and one after it.

    `orbits` are those of the target then, along the first axis as the positions. Periods for which `departure_velocity`
    is singular, such as half an orbit for cross-track motion, give impulses that are bounded, but miss the points.
    """

    def arc(_: None, ends: tuple[TargetOrbit, TargetOrbit, Vector, Vector]) -> tuple[None, tuple[Vector, Vector]]:
        at_start, at_end, start, end = ends
        constants = constants_of_motion(at_start, jnp.eye(6, dtype=start.dtype))
        motion = free_motion(at_end, period, constants)
        departure = departure_velocity(motion, start, end, period, mean_motion(at_start.semi_major_axis) * period)
        return None, (departure, jnp.sum(motion[3:] * jnp.concatenate([start, departure])[None, :], axis=1))

    starts = jax.tree.map(lambda leaf: leaf[:2], orbits)
    ends = jax.tree.map(lambda leaf: leaf[1:], orbits)
    # A scan: two copies of these operations would take twice as long to compile.
    arcs = (starts, ends, positions[:2], positions[1:])
    _, (departures, arrivals) = jax.lax.scan(arc, None, arcs)
    return TrackedPoint(arrival_velocity=arrivals[0], impulse=departures[1] - arrivals[0])
