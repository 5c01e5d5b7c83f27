"""Adaptation of what the filter believes of errors that last, where the measurements contradict it.

The posterior of a constant state under a normal prior tells what the measurements alone say of it, and how surely. If
that lies beyond two sigma of the declared prior, the prior was too narrow: it is taken as wide as puts the measured
value at two sigma (an empirical Bayes estimate: Carlin and Louis, Bayes and Empirical Bayes Methods for Data Analysis,
2000, chapter 3), but no wider than `navigation.adaptation_limit` times the declared sigma. Mean and covariance become
those that the filter would have had with this prior from the hand-over on: of a constant error and for a linear filter
that is exact, a change of the information matrix in one element (Sherman and Morrison, 1950).
"""

from typing import Final, NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

from rpojax.core.numerics import gradient_safe
from rpojax.core.pytree import pytree
from rpojax.flight.navigation import relative_filter_state
from rpojax.flight.navigation.orbit_filter_tuning import OrbitFilterTuning
from rpojax.flight.navigation.orbit_measurements import BoxMeasurement
from rpojax.flight.navigation.relative_filter_state import RelativeEstimate

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


class Adaptation(NamedTuple):
    """Estimate under adapted priors, these, and the largest measured error over its declared sigma [-]."""

    estimate: RelativeEstimate
    priors: LastingPriors
    ratio: Scalar


def _names(estimate: RelativeEstimate) -> list[str]:
    """Names of the errors that last among the filter's states.

    None where it has no state that acts on the motion: servicers that share estimates or boxes take theirs from a joint
    filter, which does not adapt. The bearing bias does not where landmarks of a network have lasting errors beside it:
    what they show of it by chance would be taken for it.
    """
    states = [state for state in relative_filter_state.SLOW_STATES if state.name in estimate.slow]
    adapts = any(state.acts_on_motion for state in states)
    left_out = {"bearing_bias"} if "network_place" in estimate.slow else set[str]()
    return [state.name for state in states if state.is_lasting and adapts and state.name not in left_out]


def _variance(estimate: RelativeEstimate) -> Float[Array, " k"]:
    P, layout = estimate.covariance, estimate.layout
    places = [place for name in _names(estimate) for place in layout.places(name)]
    return jnp.stack([P[place, place] for place in places]) if places else jnp.zeros(0, dtype=P.dtype)


def initial(estimate: RelativeEstimate) -> LastingPriors:
    """Priors at hand-over."""
    variance = _variance(estimate)
    return LastingPriors(declared=variance, adapted=variance)


def _growth(tuning: OrbitFilterTuning, estimate: RelativeEstimate, box: BoxMeasurement) -> Float[Array, " k"]:
    """Variance (k,) that the processes of the errors have added since the box before."""
    process = relative_filter_state.process_variances(tuning, estimate, _names(estimate), box.interval)
    # The camera's attitude is part of its bearing bias.
    turned = {"bearing_bias": box.attitude_variance_change}
    return jnp.concatenate([process[name] + turned.get(name, 0.0) for name in process])


def adapt(
    tuning: OrbitFilterTuning, estimate: RelativeEstimate, priors: LastingPriors, box: BoxMeasurement
) -> Adaptation:
    """Adaptation of an estimate after the measurement of a `box`; the priors are of the time of the box before it."""
    layout, names = estimate.layout, _names(estimate)
    if not names:
        return Adaptation(estimate, priors, jnp.zeros_like(box.interval))
    grown = _growth(tuning, estimate, box)
    declared, before = priors.declared + grown, priors.adapted + grown
    x, P, variance = estimate.vector, estimate.covariance, _variance(estimate)
    has_prior = before > 0.0
    # Of an error that is declared as none, so that derivatives are defined, too.
    safe = jnp.where(has_prior, before, 1.0)
    share = jnp.where(has_prior, 1.0 - variance / safe, 0.0)
    is_heard = share > _LEAST_SHARE
    share = jnp.where(is_heard, share, 1.0)
    # What the measurements alone say, and its variance.
    found = jnp.concatenate([estimate.slow[name] for name in names])
    measured, noise = found / share, variance / share
    ratio = jnp.abs(measured) / gradient_safe.sqrt(jnp.where(is_heard, declared + noise, 1.0))
    wanted = jnp.clip((measured / _SIGMAS) ** 2 - noise, declared, tuning.adaptation_limit**2 * declared)
    # One prior a time, that which lacks most: the others wait for a second, and the kernel is as small as can be.
    lack = jnp.where(is_heard, jnp.abs(jnp.log(jnp.where(is_heard, wanted / safe, 1.0))), 0.0)
    chosen = (jnp.arange(found.shape[0]) == jnp.argmax(lack, axis=0)) & is_heard
    adapted = jnp.where(chosen, wanted, before)
    less = jnp.sum(jnp.where(chosen, 1.0 / safe - 1.0 / jnp.where(has_prior, adapted, 1.0), 0.0), axis=0)
    columns = jnp.concatenate([P[:, layout[name]] for name in names], axis=1)
    column = jnp.sum(jnp.where(chosen[None, :], columns, 0.0), axis=1)
    value, own = (jnp.sum(jnp.where(chosen, each, 0.0), axis=0) for each in (found, variance))
    gain = less / (1.0 - less * own)
    moved = relative_filter_state.moved_to(
        estimate, x + gain * value * column, P + gain * column[:, None] * column[None, :]
    )
    greatest = jnp.max(jnp.where(is_heard, ratio, 0.0), axis=0)
    return Adaptation(moved, LastingPriors(declared=declared, adapted=adapted), greatest)
