"""Free motion between the points of a reference at which burns are made, and the impulses that join its pieces."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from rpojax.core.orbits.two_impulse_transfer import least_departure_velocity
from rpojax.core.orbits.yamanaka_ankersen import TargetOrbit, advanced, transition_matrix
from rpojax.core.pytree import pytree

Scalar = Float[Array, ""]
Vector = Float[Array, "3"]
State = Float[Array, "6"]


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


def tracked_point(orbit: TargetOrbit, period: Scalar, before: State, at: State, after: State) -> TrackedPoint:
    """Free motions between the states [m, m/s] of a reference one `period` [s] before a burn, at it and one after it.

    `orbit` is that of the target at the burn. Only positions count, unless the period is near one after which an
    impulse hardly moves the servicer along some direction, such as half an orbit across the track. There the velocity
    is that of the reference but for the least change that leads towards the next position, which may be missed.
    """

    def arc(_: None, ends: tuple[Scalar, State, State]) -> tuple[None, tuple[Vector, Vector]]:
        since, start, end = ends
        here = advanced(orbit, since)
        motion = transition_matrix(here, period)
        turned = advanced(here, period).argument_of_latitude - here.argument_of_latitude
        departure = least_departure_velocity(motion, start, end[:3], period, turned)
        return None, (departure, jnp.sum(motion[3:] * jnp.concatenate([start[:3], departure])[None, :], axis=1))

    starts = jnp.stack([-period, jnp.zeros_like(period)])
    # A scan: two copies of these operations would take twice as long to compile.
    arcs = (starts, jnp.stack([before, at]), jnp.stack([at, after]))
    _, (departures, arrivals) = jax.lax.scan(arc, None, arcs)
    return TrackedPoint(arrival_velocity=arrivals[0], impulse=departures[1] - arrivals[0])
