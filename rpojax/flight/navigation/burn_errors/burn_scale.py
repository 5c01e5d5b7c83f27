"""Error of the burns' magnitude that stays from burn to burn: that of thrust and mass, a scalar state of the filter.

Taken as a new error in every burn, it would seem to average out over many of them, and the range that the burns show
would be believed too well.
"""

import jax.numpy as jnp
from jaxtyping import Array, Float

from rpojax.core.kalman_update import MeasurementRows, SequentialGains
from rpojax.core.numerics import gradient_safe
from rpojax.core.pytree import pytree
from rpojax.flight.navigation.orbit_filter_tuning import OrbitFilterTuning

Scalar = Float[Array, ""]
Vector = Float[Array, "3"]


@pytree
class BurnScale:
    """Relative error of the velocity change of burns: mean, variance, and covariance with the relative state.

    It is the last row of the filter's covariance, kept apart, as it changes in burns alone.

    Attributes:
        mean: () [-]
        variance: () [-]
        covariance: (12,) with the relative state
    """

    mean: Array
    variance: Array
    covariance: Array


def initial(tuning: OrbitFilterTuning) -> BurnScale:
    """Belief before any burn."""
    variance = lasting_sigma(tuning) ** 2
    return BurnScale(
        mean=jnp.zeros_like(variance), variance=variance, covariance=jnp.zeros(12, dtype=tuning.scale_sigma.dtype)
    )


def propagated(
    scale: BurnScale,
    gravity_gradient: Float[Array, "3 3"],
    decay: Float[Array, "6"],
    relative_delta_v_N: Vector,
    dt: float,
) -> tuple[BurnScale, tuple[Float[Array, "6"], Float[Array, "12"]]]:
    """Belief `dt` [s] later, and the vectors `g` and `u` of the covariance `g u' + u g'` that a burn adds to the state.

    `relative_delta_v_N` [m/s] is the change of the relative velocity by the burn; `decay` [-] is that of the slow
    errors, whose state is the rest. The transition is that of `orbit_covariance.propagate`.
    """
    position, velocity = scale.covariance[:3], scale.covariance[3:6]
    kicked = velocity + dt * jnp.sum(gravity_gradient * position[None, :], axis=1)
    moved = jnp.concatenate([position + dt * kicked, kicked, decay * scale.covariance[6:]])
    effect = jnp.concatenate([0.5 * dt * relative_delta_v_N, relative_delta_v_N])
    none = jnp.zeros_like(decay)
    half = moved + jnp.concatenate([0.5 * scale.variance * effect, none])
    after = BurnScale(
        mean=scale.mean,
        variance=scale.variance,
        covariance=moved + jnp.concatenate([scale.variance * effect, none]),
    )
    return after, (effect, half)


def updated(scale: BurnScale, rows: MeasurementRows, gains: SequentialGains) -> BurnScale:
    """Belief after measurements of the relative state by `rows`, whose `gains` are those of that state."""
    mean, variance, covariance = scale.mean, scale.variance, scale.covariance
    for index, vector in enumerate(gains.vectors):
        product = jnp.sum(covariance * rows.jacobian[index], axis=0)
        mean = mean + rows.weight[index] / gains.innovation_variance[index] * gains.innovation[index] * product
        variance = variance - gains.factors[index] * product * product
        covariance = covariance - gains.factors[index] * product * vector
    return BurnScale(mean=mean, variance=variance, covariance=covariance)


def lasting_sigma(tuning: OrbitFilterTuning) -> Scalar:
    """1 sigma of the lasting error that is a state of the filter [-]; 0 where all of it counts as new."""
    return jnp.where(tuning.burn_scale_as_new > 0.0, 0.0, tuning.burn_scale_sigma)


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
