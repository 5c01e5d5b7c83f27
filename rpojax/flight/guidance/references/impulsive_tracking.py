"""Free motion between the points of a reference at which burns are made, and the impulses that join its pieces."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from rpojax.core.orbits.keplerian_elements import mean_motion
from rpojax.core.orbits.two_impulse_transfer import departure_velocity
from rpojax.core.orbits.yamanaka_ankersen import TargetOrbit, advanced, transition_matrix
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


def tracked_point(orbit: TargetOrbit, period: Scalar, before: Vector, at: Vector, after: Vector) -> TrackedPoint:
    """Free motions between the positions [m] of a reference one `period` [s] before a burn, at it and one after it.

    `orbit` is that of the target at the burn. Periods for which `departure_velocity` is singular, such as half an orbit
    for cross-track motion, give impulses that are bounded, but miss the points.
    """

    def arc(_: None, ends: tuple[Scalar, Vector, Vector]) -> tuple[None, tuple[Vector, Vector]]:
        since, start, end = ends
        motion = transition_matrix(advanced(orbit, since), period)
        departure = departure_velocity(motion, start, end, period, mean_motion(orbit.semi_major_axis) * period)
        return None, (departure, jnp.sum(motion[3:] * jnp.concatenate([start, departure])[None, :], axis=1))

    starts = jnp.stack([-period, jnp.zeros_like(period)])
    # A scan: two copies of these operations would take twice as long to compile.
    arcs = (starts, jnp.stack([before, at]), jnp.stack([at, after]))
    _, (departures, arrivals) = jax.lax.scan(arc, None, arcs)
    return TrackedPoint(arrival_velocity=arrivals[0], impulse=departures[1] - arrivals[0])
