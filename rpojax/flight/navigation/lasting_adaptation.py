"""Adaptation of what the filter believes of errors that last, where the measurements contradict it.

The posterior of a constant state under a normal prior tells what the measurements alone say of it, and how surely. If
that lies beyond two sigma of the declared prior, the prior was too narrow: it is taken as wide as puts the measured
value at two sigma (an empirical Bayes estimate: Carlin and Louis, Bayes and Empirical Bayes Methods for Data Analysis,
2000, chapter 3), but no wider than `navigation.adaptation_limit` times the declared sigma. Mean and covariance become
those that the filter would have had with this prior from the hand-over on: for a linear filter that is exact, a change
of the information matrix in one element (Sherman and Morrison, 1950).
"""

from typing import Final

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from rpojax.core.numerics import gradient_safe
from rpojax.core.pytree import pytree
from rpojax.flight.navigation import relative_state
from rpojax.flight.navigation.orbit_filter_tuning import OrbitFilterTuning
from rpojax.flight.navigation.orbit_measurements import BoxMeasurement
from rpojax.flight.navigation.relative_state import RelativeEstimate

Scalar = Float[Array, ""]

_SIGMAS: Final = 2.0
"""Measured value over its sigma from which the prior is widened: one in twenty exceeds it by chance."""
_LEAST_SHARE: Final = 0.1
"""Share of the prior's variance that the measurements must have taken before they are heard [-]."""


@pytree
class LastingPriors:
    """Variances of errors that last before any measurement, in the order of the filter's vector.

    Attributes:
        declared: (k,) as declared, with what has been added by their processes since the hand-over
        adapted: (k,) as the filter has them
    """

    declared: Array
    adapted: Array


def _places(estimate: RelativeEstimate) -> np.ndarray:
    """Places of the errors that last in the filter's vector."""
    names = [state.name for state in relative_state.SLOW_STATES if state.is_lasting and state.name in estimate.slow]
    return np.array([place for name in names for place in estimate.layout.places(name)], dtype=int)


def initial(estimate: RelativeEstimate) -> LastingPriors:
    """Priors at hand-over."""
    variance = jnp.diagonal(estimate.covariance)[_places(estimate)]
    return LastingPriors(declared=variance, adapted=variance)


def adapt(
    tuning: OrbitFilterTuning, estimate: RelativeEstimate, priors: LastingPriors, box: BoxMeasurement
) -> tuple[RelativeEstimate, LastingPriors, Scalar]:
    """Estimate under adapted priors, these, and the largest measured error over its declared sigma [-].

    The `box` was the last measurement of the estimate; the priors are of the time of the one before it.
    """
    places = _places(estimate)
    if not places.size:
        return estimate, priors, jnp.zeros_like(box.interval)
    process = relative_state.slow_process(tuning, estimate, estimate.r_TS_N, estimate.v_TS_N, box.interval)[1]
    # The camera's attitude is part of its bearing bias.
    turned = estimate.layout.vector(bearing_bias=jnp.full(2, box.attitude_variance_change))[places]
    grown = process[places - relative_state.MOTION.size] + turned
    declared, before = priors.declared + grown, priors.adapted + grown
    x, P = estimate.vector, estimate.covariance
    variance, has_prior = jnp.diagonal(P)[places], before > 0.0
    share = jnp.where(has_prior, 1.0 - variance / jnp.where(has_prior, before, 1.0), 0.0)
    is_heard = share > _LEAST_SHARE
    share = jnp.where(is_heard, share, 1.0)
    # What the measurements alone say, and its variance.
    measured, noise = x[places] / share, variance / share
    ratio = jnp.abs(measured) / gradient_safe.sqrt(jnp.where(is_heard, declared + noise, 1.0))
    wanted = jnp.clip((measured / _SIGMAS) ** 2 - noise, declared, tuning.adaptation_limit**2 * declared)
    adapted = jnp.where(is_heard, wanted, before)
    for k, place in enumerate(places):
        less = jnp.where(is_heard[k], 1.0 / before[k] - 1.0 / adapted[k], 0.0)
        column = P[:, place]
        gain = less / (1.0 - less * column[place])
        x, P = x + gain * x[place] * column, P + gain * column[:, None] * column[None, :]
    moved = relative_state.moved_to(estimate, x, P)
    return moved, LastingPriors(declared=declared, adapted=adapted), jnp.max(jnp.where(is_heard, ratio, 0.0), axis=0)
