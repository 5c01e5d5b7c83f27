"""Motion of a peer relative to this servicer, and what is known of it at hand-over."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from rpojax.core.numerics.exact_difference import Difference
from rpojax.core.orbits import zonal_gravity
from rpojax.core.orbits.zonal_gravity import EARTH_GRAVITY
from rpojax.core.state_layout import MOTION, StateLayout
from rpojax.flight.navigation.orbit_filter_tuning import OrbitFilterTuning

Vector = Float[Array, "3"]

_ERRORS = (("gps_difference", 3),)
_ERRORS_WITH_RANGE = (*_ERRORS, ("range_bias", 1))


def baseline_layout(has_ranges: bool) -> StateLayout:
    """Layout of a baseline: motion in N, slow error of the difference of GPS positions, bias of the measured range.

    The last one is a state only if ranges over the link are measured.
    """
    return StateLayout((*MOTION.blocks, *(_ERRORS_WITH_RANGE if has_ranges else _ERRORS)))


def peer_layout(has_ranges: bool) -> StateLayout:
    """Layout of a peer in a joint filter: the same, with slow errors of its boxes in between: size and bearing."""
    view = ("size", 1), ("bearing_bias", 2)
    return StateLayout((*MOTION.blocks, *view, *(_ERRORS_WITH_RANGE if has_ranges else _ERRORS)))


def initial_variance(own: OrbitFilterTuning, peer: OrbitFilterTuning) -> Float[Array, "6"]:
    """Variance of position [m^2] and velocity [m^2/s^2] of a baseline by the orbits at hand-over."""
    position = own.initial_position_sigma**2 + peer.initial_position_sigma**2
    velocity = own.initial_velocity_sigma**2 + peer.initial_velocity_sigma**2
    return MOTION.vector(position=jnp.full(3, position), velocity=jnp.full(3, velocity))


def propagate(
    zonal_degree: int,
    baseline: Float[Array, "6"],
    r_before_N: Vector,
    r_after_N: Vector,
    delta_v_N: Vector,
    dt: float,
) -> Float[Array, "6"]:
    """Position and velocity of a peer `dt` [s] later, of which no burns are known in between.

    The servicer moves from `r_before_N` to `r_after_N` [m], its velocity changes by `delta_v_N` [m/s]. Velocity Verlet
    (Swope et al., 1982).
    """

    def acceleration(r_N: Vector, position: Vector) -> Vector:
        return zonal_gravity.gravity(EARTH_GRAVITY, zonal_degree, Difference(value=r_N, change=position)).change

    position, velocity = baseline[MOTION["position"]], baseline[MOTION["velocity"]]
    first = acceleration(r_before_N, position) - delta_v_N / dt
    moved = position + dt * velocity + (0.5 * dt * dt) * first
    last = acceleration(r_after_N, moved) - delta_v_N / dt
    return jnp.concatenate([moved, velocity + (0.5 * dt) * (first + last)])
