"""Periodic relative motion that keeps a station off the along-track axis with one impulse per period."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from rpojax.core.orbits.clohessy_wiltshire import transition_matrix
from rpojax.core.pytree import pytree
from rpojax.flight.control.formation_tuning import FormationTuning

Scalar = Float[Array, ""]


@pytree
class StationKeeping:
    """Free motion that returns to the station after a period, and the impulse that starts it again.

    Both vectors are zero for a station on the along-track axis, which is an equilibrium of the relative motion.

    Attributes:
        arrival_velocity: (3,) rho_dot of the free motion when it returns [m/s]
        impulse: (3,) velocity change at the station that starts the next period [m/s]
    """

    arrival_velocity: Array
    impulse: Array


def solve_station_keeping(formation: FormationTuning, n: Scalar, period: float) -> StationKeeping:
    """Station keeping at the desired position with a `period` [s] at mean motion `n` [rad/s]."""
    transition = transition_matrix(n, jnp.asarray(period, dtype=n.dtype))
    position = formation.desired_position
    drift = position - jnp.sum(transition[:3, :3] * position[None, :], axis=1)
    departure = jnp.linalg.solve(transition[:3, 3:], drift)
    arrival = jnp.sum(transition[3:] * jnp.concatenate([position, departure])[None, :], axis=1)
    return StationKeeping(arrival_velocity=arrival, impulse=departure - arrival)
