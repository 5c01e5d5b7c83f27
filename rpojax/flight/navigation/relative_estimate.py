"""State of the relative orbit filter: mean and covariance of the target relative to the servicer.

State (12): position and velocity of the target from the servicer in N; log of the apparent size over its expected
value, in a slow and a fast part (2); bearing bias (2); offset of the box centre from the centre of mass, which wanders
as the target tumbles (2).
"""

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from rpojax.core.pytree import pytree, replace
from rpojax.flight.navigation import outline_correlation, shape_errors
from rpojax.flight.navigation.burn_errors import burn_scale
from rpojax.flight.navigation.burn_errors.burn_scale import BurnScale
from rpojax.flight.navigation.orbit_filter_tuning import OrbitFilterTuning
from rpojax.flight.navigation.outline_correlation import OutlineCorrelation

Vector = Float[Array, "3"]


@pytree
class RelativeEstimate:
    """Mean and covariance of the relative state.

    Attributes:
        r_TS_N: (3,) target from servicer [m]
        v_TS_N: (3,) its inertial derivative [m/s]
        scale: (2,) log-size error, slow and fast part [-]
        bearing_bias: (2,) tangents in the camera [rad]
        center_offset: (2,) of the box from the centre of mass, image right and down [m]
        covariance: (12, 12) in this order
        outline: how fast the outline changes, by which the errors of size and centre lose their correlation
        burn_scale: lasting error of the burns' magnitude
    """

    r_TS_N: Array
    v_TS_N: Array
    scale: Array
    bearing_bias: Array
    center_offset: Array
    covariance: Array
    outline: OutlineCorrelation
    burn_scale: BurnScale


def initial_sigma(tuning: OrbitFilterTuning) -> Float[Array, "6"]:
    """1-sigma of position and velocity at hand-over."""
    return jnp.concatenate(
        [
            jnp.full(3, tuning.initial_relative_position_sigma),
            jnp.full(3, tuning.initial_relative_velocity_sigma),
        ]
    )


def initial(tuning: OrbitFilterTuning, r_TS_N: Vector, v_TS_N: Vector) -> RelativeEstimate:
    """Estimate at hand-over with position [m] and velocity [m/s] as means."""
    return RelativeEstimate(
        r_TS_N=r_TS_N,
        v_TS_N=v_TS_N,
        scale=jnp.zeros_like(tuning.scale_sigma),
        bearing_bias=jnp.zeros(2, dtype=r_TS_N.dtype),
        center_offset=jnp.zeros(2, dtype=r_TS_N.dtype),
        covariance=jnp.diag(
            jnp.concatenate(
                [
                    initial_sigma(tuning) ** 2,
                    shape_errors.scale_variance(tuning),
                    jnp.full(2, tuning.bearing_bias_sigma**2),
                    jnp.full(2, shape_errors.center_variance(tuning, jnp.zeros_like(tuning.target_size), r_TS_N)),
                ]
            )
        ),
        outline=outline_correlation.initial(),
        burn_scale=burn_scale.initial(tuning),
    )


def reopening_factor(reopened: Bool[Array, ""]) -> Float[Array, ""]:
    """Factor on the sigma of position and velocity of an estimate that a failed search has reopened, else 1."""
    return jnp.where(reopened, jnp.sqrt(_WIDENING), 1.0)


def reopen(estimate: RelativeEstimate, reopened: Bool[Array, ""]) -> RelativeEstimate:
    """Estimate with twice the variance of position and velocity if the target is not where it should be."""
    factor = reopening_factor(reopened)
    factors = jnp.concatenate([jnp.full(6, factor), jnp.ones(6, dtype=factor.dtype)])
    lasting = replace(estimate.burn_scale, covariance=factors * estimate.burn_scale.covariance)
    widened = estimate.covariance * (factors[:, None] * factors[None, :])
    return replace(estimate, covariance=widened, burn_scale=lasting)


_WIDENING = 2.0
"""Factor on the variance of position and velocity after a search of all directions that they allow."""
