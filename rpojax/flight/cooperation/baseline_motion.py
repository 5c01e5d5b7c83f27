"""Motion of a peer relative to this servicer, and what is known of it at hand-over."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from rpojax.core.filter_state_layout import MOTION, StateLayout
from rpojax.core.numerics.exact_difference import Difference
from rpojax.core.orbits import gravity_gradient, zonal_gravity
from rpojax.core.orbits.zonal_gravity import EARTH_GRAVITY
from rpojax.core.pytree import pytree
from rpojax.flight.navigation.orbit_filter_tuning import OrbitFilterTuning

Matrix = Float[Array, "3 3"]
Scalar = Float[Array, ""]
Vector = Float[Array, "3"]

_ERRORS = (("gps_difference", 3),)
_ERRORS_WITH_RANGE = (*_ERRORS, ("range_bias", 1))


@pytree
class TickMotion:
    """Motion of a servicer over a tick, as it believes it.

    Attributes:
        r_before_N: (3,) position before [m]
        r_after_N: (3,) position after [m]
        delta_v_N: (3,) expected change of its velocity in between, by a burn [m/s]
        burn_covariance: (3, 3) of that [m^2/s^2]
        reopened: () bool, guidance has widened the estimate of the target in this tick, as a search of it has failed
    """

    r_before_N: Array
    r_after_N: Array
    delta_v_N: Array
    burn_covariance: Array
    reopened: Array

    @property
    def gravity_gradient(self) -> Matrix:
        """Gradient of gravity at the position before [1/s^2]."""
        return gravity_gradient.gravity_gradient(self.r_before_N)


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


def propagate(zonal_degree: int, baseline: Float[Array, "6"], motion: TickMotion, dt: float) -> Float[Array, "6"]:
    """Position and velocity of a peer `dt` [s] later, of which no burns are known in between.

    The servicer moves and burns meanwhile. Velocity Verlet (Swope et al., 1982).
    """

    def acceleration(r_N: Vector, position: Vector) -> Vector:
        return zonal_gravity.gravity(EARTH_GRAVITY, zonal_degree, Difference(value=r_N, change=position)).change

    position, velocity = baseline[MOTION["position"]], baseline[MOTION["velocity"]]
    first = acceleration(motion.r_before_N, position) - motion.delta_v_N / dt
    moved = position + dt * velocity + (0.5 * dt * dt) * first
    last = acceleration(motion.r_after_N, moved) - motion.delta_v_N / dt
    return jnp.concatenate([moved, velocity + (0.5 * dt) * (first + last)])


def transition_matrix(gravity_gradient: Matrix, t: Scalar | float) -> Float[Array, "6 6"]:
    """State transition matrix of free relative motion over `t` [s], which may be negative, in inertial axes.

    The gravity gradient is constant meanwhile; the series in time has an error of the fourth order in orbit angle, 1e-7
    of the motion over 20 s in a low orbit.
    """
    identity = jnp.eye(3, dtype=gravity_gradient.dtype)
    same = identity + (0.5 * t * t) * gravity_gradient
    drift = t * identity + (t * t * t / 6.0) * gravity_gradient
    return jnp.concatenate(
        [jnp.concatenate([same, drift], axis=1), jnp.concatenate([t * gravity_gradient, same], axis=1)], axis=0
    )
