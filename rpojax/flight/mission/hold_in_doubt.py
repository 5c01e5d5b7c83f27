"""Holding in doubt: a stop of the relative motion, and the place to wait at without confidence in the estimate."""

from typing import Final

import jax.numpy as jnp
from jaxtyping import Array, Float

from rpojax.core.numerics import gradient_safe
from rpojax.core.orbits.yamanaka_ankersen import TargetOrbit, rate_without_drift

Scalar = Float[Array, ""]
Vector = Float[Array, "3"]

SHARE_OF_CHANGE: Final = 0.5
"""Part of the change to a hold that is made in doubt: with a range believed k times too large 1 - k / 2 of it is left,
half at k = 3, and it diverges from k = 4 on [-]."""

_NEAR_STATION_AXIS: Final = 0.7
"""Cosine of the angle between servicer and station above which a hold leads to the line through the station [-]. A
choice: 45 deg."""

_MARGIN: Final = 0.1
"""A hold is farther than the range at which the confidence was lost by this fraction of it, so that no error of a burn
comes nearer [-]. A choice, flown in experiments/unseen_missions."""


def change_to_stop(state_H: Float[Array, "6"], orbit: TargetOrbit) -> Vector:
    """Velocity change [m/s] after which the relative motion [m, m/s] does not drift."""
    return rate_without_drift(orbit, state_H[:3]) - state_H[3:]


def place(station_H: Vector, rho_H: Vector, last_range: Scalar) -> Vector:
    """Position [m] on the line through target and station, at the present range; far from that line the present one.

    It is no nearer than the `last_range` at which there was confidence [m].
    """
    now = gradient_safe.norm(rho_H)
    station_axis = gradient_safe.normalize(station_H)
    cosine = jnp.sum(station_axis * rho_H, axis=0) / now
    away = jnp.where(jnp.abs(cosine) > _NEAR_STATION_AXIS, jnp.sign(cosine) * station_axis, rho_H / now)
    return away * jnp.maximum(now, (1.0 + _MARGIN) * last_range)
