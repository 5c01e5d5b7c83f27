"""Clearance of free drifts from a keep-out ellipsoid over many orbits, with the uncertainty of the estimate.

The free motion of the linear model repeats itself from orbit to orbit but for a drift that is proportional to time. So
the passages of one place on the orbit lie on a straight line, and the samples of one orbit cover any horizon: each by
the least distance of the line from its first passage to its last.
"""

import math

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from rpojax.core.numerics import gradient_safe
from rpojax.core.orbits import yamanaka_ankersen
from rpojax.core.orbits.keplerian_elements import mean_motion
from rpojax.core.orbits.yamanaka_ankersen import TargetOrbit
from rpojax.core.pytree import pytree

Scalar = Float[Array, ""]

_SAMPLES = 24
"""Evenly spaced times of the first orbit."""


@pytree
class Drift:
    """What free drifts after a burn have in common.

    Attributes:
        orbit: of the target at the burn
        state_H: (6,) relative state before the burn [m, m/s]
        scale_sigma: () 1-sigma of the range over the range, which scales the whole relative motion [-]
        drift_sigma: () 1-sigma of the drift constant of the motion apart from that scale [m]
        sigmas: () of these that are covered [-]
        semi_axes: (3,) of the keep-out ellipsoid in H with its margin [m]
        first_span: () free motion that is sampled [s]
        horizon: () end of the drift, at least the span [s]
    """

    orbit: TargetOrbit
    state_H: Array
    scale_sigma: Array
    drift_sigma: Array
    sigmas: Array
    semi_axes: Array
    first_span: Array
    horizon: Array


def orbit_period(orbit: TargetOrbit) -> Scalar:
    """Period of an orbit [s]."""
    return 2.0 * math.pi / mean_motion(orbit.semi_major_axis)


def least_clearance(drift: Drift, directions_H: Float[Array, "3 d"], sizes: Float[Array, "d k"]) -> Float[Array, "d k"]:
    """Least distance from the target over that of the keep-out ellipsoid in the same direction, for each burn.

    Args:
        drift: what the drifts have in common
        directions_H: (3, d) directions of burns, of any length
        sizes: (d, k) factors on each direction [m/s]
    """
    columns = jnp.concatenate([jnp.zeros_like(directions_H), directions_H])
    columns = jnp.concatenate([columns, drift.state_H[:, None]], axis=1)
    constants = yamanaka_ankersen.constants_of_motion(drift.orbit, columns)
    unit_drift = jnp.where(jnp.arange(6)[:, None] == 3, 1.0, jnp.zeros_like(constants[:, :1]))
    constants = jnp.concatenate([constants, unit_drift], axis=1)
    scale_error, drift_error = drift.sigmas * drift.scale_sigma, drift.sigmas * drift.drift_sigma
    signs = [(scale, other) for scale in (-1.0, 1.0) for other in (-1.0, 1.0)]
    ends = jnp.stack([jnp.zeros_like(drift.horizon), drift.horizon - drift.first_span])

    def sample(least: Float[Array, "d k"], time: Scalar) -> tuple[Float[Array, "d k"], None]:
        place = yamanaka_ankersen.advanced(drift.orbit, time)

        def passage(_: None, later: Scalar) -> tuple[None, Float[Array, "3 c"]]:
            moved = yamanaka_ankersen.free_motion(place, time + later, constants)[:3]
            return None, moved / drift.semi_axes[:, None]

        _, (first, last) = jax.lax.scan(passage, None, ends)
        a, b = (each[:, :-2, None] * sizes[None] for each in (first, last))
        for scale, other in signs:
            base = [
                (1.0 + scale * scale_error) * each[:, -2] + other * drift_error * each[:, -1] for each in (first, last)
            ]
            near, far = a + base[0][:, None, None], b + base[1][:, None, None]
            least = jnp.minimum(least, _square_distance_to_line(near, far))
        return least, None

    times = jnp.linspace(1.0 / _SAMPLES, 1.0, _SAMPLES, dtype=drift.state_H.dtype) * drift.first_span
    least, _ = jax.lax.scan(sample, jnp.full_like(sizes, jnp.inf), times)
    return gradient_safe.sqrt(least)


def _square_distance_to_line(a: Float[Array, "3 d k"], b: Float[Array, "3 d k"]) -> Float[Array, "d k"]:
    """Squared distance from the origin to the line from `a` to `b`."""
    along = b - a
    square = jnp.sum(along * along, axis=0)
    share = -jnp.sum(a * along, axis=0) / jnp.where(square > 0.0, square, 1.0)
    nearest = a + jnp.clip(share, 0.0, 1.0)[None, :] * along
    return jnp.sum(nearest * nearest, axis=0)
