"""Execution error of burns: covariance of magnitude and direction errors (Gates, 1963), new and lasting ones."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from rpojax.core.numerics import gradient_safe
from rpojax.flight.navigation.orbit_filter_tuning import OrbitFilterTuning

Vector = Float[Array, "3"]
Matrix = Float[Array, "3 3"]
Scalar = Float[Array, ""]


def burn_covariance(
    delta_v_N: Vector, burn_delta_v: Scalar, magnitude_sigma: Scalar, direction_sigma: Scalar
) -> Matrix:
    """Velocity covariance [m^2/s^2] of one step's part `delta_v_N` [m/s] of a burn of size `burn_delta_v` [m/s].

    A burn's execution error is drawn once for all of its steps. Each step gets its share of the burn's variance, so
    that the sum is right.
    """
    size = gradient_safe.norm(delta_v_N)
    along = gradient_safe.normalize(delta_v_N)
    projection = along[:, None] * along[None, :]
    across = jnp.eye(3, dtype=delta_v_N.dtype) - projection
    return size * burn_delta_v * (magnitude_sigma**2 * projection + direction_sigma**2 * across)


def lasting_sigma(tuning: OrbitFilterTuning) -> Scalar:
    """1 sigma of the lasting error that is a state of the filter [-]; 0 where all of it counts as new."""
    return jnp.where(tuning.burn_scale_as_new > 0.0, 0.0, tuning.burn_scale_sigma)


def lasting_direction_sigma(tuning: OrbitFilterTuning) -> Scalar:
    """1 sigma of the lasting angle of the thrust that is a state of the filter [rad]; 0 where it counts as new."""
    return jnp.where(tuning.burn_scale_as_new > 0.0, 0.0, tuning.thrust_direction_sigma)


def new_direction_sigma(tuning: OrbitFilterTuning) -> Scalar:
    """1 sigma per axis of the part of a burn's direction error that is new, or counts as new [rad]."""
    as_new = tuning.burn_scale_as_new * tuning.thrust_direction_sigma
    return gradient_safe.sqrt(tuning.burn_direction_sigma**2 + as_new**2)


def new_sigma(tuning: OrbitFilterTuning) -> Scalar:
    """1 sigma of the part of a burn's relative magnitude error that is new, or counts as new [-]."""
    as_new = tuning.burn_scale_as_new * tuning.burn_scale_sigma
    return gradient_safe.sqrt(tuning.burn_magnitude_sigma**2 + as_new**2)


def new_magnitude_sigma(tuning: OrbitFilterTuning, inflation: Scalar) -> Scalar:
    """1-sigma of that part for a burn with an `inflation` [-] of the sigma.

    Of a thruster that is not as calibrated, with an inflation above 1, the whole error is new.
    """
    lasting, new = lasting_sigma(tuning) ** 2, new_sigma(tuning) ** 2
    return gradient_safe.sqrt(new + (inflation**2 - 1.0) * (new + lasting))


def new_and_whole(
    tuning: OrbitFilterTuning, delta_v_N: Vector, burn_delta_v: Scalar, inflation: Scalar
) -> tuple[Matrix, Matrix]:
    """Velocity covariances [m^2/s^2] of one step's part of a burn: of the errors that are new in it, and of all.

    Arguments are those of `burn_covariance` and of `new_magnitude_sigma`.
    """
    magnitude, direction = new_magnitude_sigma(tuning, inflation), new_direction_sigma(tuning)
    all_magnitude = gradient_safe.sqrt(magnitude**2 + lasting_sigma(tuning) ** 2)
    all_direction = gradient_safe.sqrt(direction**2 + lasting_direction_sigma(tuning) ** 2)
    return (
        burn_covariance(delta_v_N, burn_delta_v, magnitude, direction),
        burn_covariance(delta_v_N, burn_delta_v, all_magnitude, all_direction),
    )
