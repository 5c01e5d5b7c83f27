"""Navigation health: tests of the orbit filter on its own innovations, and confidence in its estimate.

Normalised innovations of a consistent filter are white with unit variance. Their fading means, and those of their
squares, are compared with quantiles of the normal and the chi-square distribution (Bar-Shalom, Li and Kirubarajan,
Estimation with Applications to Tracking and Navigation, 2001, section 5.4).
"""

from typing import Final

import jax.numpy as jnp
from jaxtyping import Array, Float

from rpojax.core.declared_numbers import number
from rpojax.core.numerics import gradient_safe
from rpojax.core.pytree import pytree
from rpojax.flight import control_effort
from rpojax.flight.control_effort import ControlEffort
from rpojax.flight.navigation import lasting_adaptation, shape_errors
from rpojax.flight.navigation.box_measurement import detection_model
from rpojax.flight.navigation.box_measurement.outlier_gate import GateState
from rpojax.flight.navigation.combined_orbit_filter import Innovation
from rpojax.flight.navigation.lasting_adaptation import LastingPriors
from rpojax.flight.navigation.orbit_filter_tuning import OrbitFilterTuning
from rpojax.flight.navigation.relative_filter_state import RelativeEstimate
from rpojax.flight.navigation.sensor_innovation import SensorInnovation

Scalar = Float[Array, ""]

TESTS: Final = (
    "gps_variance",
    "box_variance",
    "box_bias",
    "contradictions",
    "size",
    "unseen",
    "range",
    "control_effort",
    "lasting",
)
"""Tests by name: variance of the GPS innovations; variance and mean of those of the box; share of boxes that were
rejected although others confirm them; size error that explains the difference of range by size and by the orbit;
time in which the target should have been seen and was not; sigma of the range over the range; velocity that burns gave
beyond the one that they were believed to give; measured error that lasts over its declared sigma."""


@pytree
class HealthTuning:
    """Thresholds of the health tests."""

    time_constant: Array = number("time constant of the fading means of normalised innovations", unit="s", above=0.0)
    alarm_sigma: Array = number("quantile of the tests of mean and variance, as of a normal distribution", above=0.0)
    contradiction_limit: Array = number("largest share of boxes rejected although others confirm them", above=0.0)
    size_limit: Array = number(
        "largest mean of the estimated size error over the time constant, over the root sum of squares of "
        "`navigation.scale_sigma` and `target_size_sigma`",
        above=0.0,
    )
    lasting_limit: Array = number("measured error that lasts over the sigma of its prior", above=0.0, default=3.7)
    unseen_limit: Array = number("longest time without box, while the target should be seen", unit="s", above=0.0)
    range_limit: Array = number("largest 1-sigma of the range over the range", above=0.0)
    regain: Array = number(
        "confidence returns when all statistics are below this fraction of their thresholds", above=0.0, at_most=1.0
    )
    clearance: Array = number(
        "without phases: no burn is made after which free motion may come nearer, within three sigma of the estimate, "
        "than this fraction of the station's distance",
        at_least=0.0,
        below=1.0,
    )


@pytree
class NavigationHealth:
    """State of the health tests.

    Attributes:
        moments: (2, m) fading means of the normalised innovations of GPS and box, by name, and of their squares [-]
        contradicted: () fading share of boxes that were rejected although others confirm them [-]
        size_error: (2,) fading mean of the estimated size error: end-on, an outline may be far smaller for a while [-]
        effort: velocity corrections between burns
        lasting: priors of errors that last
        ratios: (9,) statistic over threshold of each of `TESTS` [-]
        confident: () bool, the tests of the relative estimate, all but that of GPS, have passed
        confident_range: () estimated range when they last had [m]
    """

    moments: dict[str, Array]
    contradicted: Array
    size_error: Array
    effort: ControlEffort
    lasting: LastingPriors
    ratios: Array
    confident: Array
    confident_range: Array


def initial(relative: RelativeEstimate) -> NavigationHealth:
    """Confidence in the estimate at hand-over, with the expected values of the means."""
    return NavigationHealth(
        moments={name: jnp.stack([jnp.zeros(3), jnp.ones(3)]).astype(jnp.float64) for name in ("gps", "box")},
        contradicted=jnp.zeros((), dtype=jnp.float64),
        size_error=jnp.zeros_like(relative.slow["size"]),
        effort=control_effort.initial(),
        lasting=lasting_adaptation.initial(relative),
        ratios=jnp.zeros(len(TESTS), dtype=jnp.float64),
        confident=jnp.ones((), dtype=bool),
        confident_range=gradient_safe.norm(relative.r_TS_N),
    )


@pytree
class HealthEvidence:
    """What the measurements of a tick tell of the health.

    Attributes:
        interval: () since the tick before [s]
        innovation: diagnostics of the orbit filter
        gate: state of the outlier gate after them
        estimate: of the target by them
        effort: control effort after them
        lasting: priors of errors that last after them
        lasting_ratio: () largest measured error that lasts over its declared sigma [-]
        unseen_time: () without a box in which the target should have been seen [s]
        range_sigma: () sigma of the range over the range [-]
    """

    interval: Array
    innovation: Innovation
    gate: GateState
    estimate: RelativeEstimate
    effort: ControlEffort
    lasting: LastingPriors
    lasting_ratio: Array
    unseen_time: Array
    range_sigma: Array


def update(
    tuning: HealthTuning, filter_tuning: OrbitFilterTuning, health: NavigationHealth, found: HealthEvidence
) -> NavigationHealth:
    """Health after the measurements of a tick."""
    innovation, gate, estimate, interval = found.innovation, found.gate, found.estimate, found.interval
    evidence = detection_model.evidence_time(interval) / tuning.time_constant
    sensors, boxes = innovation.sensors, innovation.sensors["box"].accepted | innovation.sensors["box"].rejected
    moments = {name: _faded(before, sensors[name], evidence) for name, before in health.moments.items()}
    (_, gps_square), (box_mean, box_square) = moments["gps"], moments["box"]
    # In seconds at any rate of the camera, since a recovery must not take the confidence for longer on a slow one.
    share = jnp.where(boxes, jnp.minimum(interval / tuning.time_constant, 1.0), 0.0)
    contradicted = health.contradicted + share * (jnp.where(gate.contradicted, 1.0, 0.0) - health.contradicted)
    # The gate itself finds that the estimate is wrong.
    contradicted = jnp.where(gate.recovered & gate.contradicted, 1.0, contradicted)
    samples = 2.0 / evidence
    excess_limit = _NOISE_TOLERANCE**2 * _chi_square_over_dof(tuning.alarm_sigma, samples) - 1.0
    effort_limit = _NOISE_TOLERANCE**2 * _chi_square_over_dof(tuning.alarm_sigma, control_effort.DEGREES_OF_FREEDOM)
    size_error = health.size_error + share * (estimate.slow["size"] - health.size_error)
    size_sigma = gradient_safe.sqrt(jnp.sum(shape_errors.scale_variance(filter_tuning), axis=0))
    ratios = jnp.stack(
        [
            (jnp.max(gps_square, axis=0) - 1.0) / excess_limit,
            (jnp.max(box_square, axis=0) - 1.0) / excess_limit,
            jnp.max(jnp.abs(box_mean), axis=0) * jnp.sqrt(samples) / tuning.alarm_sigma,
            contradicted / tuning.contradiction_limit,
            jnp.abs(jnp.sum(size_error, axis=0)) / size_sigma / tuning.size_limit,
            found.unseen_time / tuning.unseen_limit,
            found.range_sigma / tuning.range_limit,
            found.effort.ratio / effort_limit,
            found.lasting_ratio / tuning.lasting_limit,
        ]
    )
    # The relative state does not depend on GPS.
    worst = jnp.max(ratios[1:], axis=0)
    confident = worst < jnp.where(health.confident, 1.0, tuning.regain)
    return NavigationHealth(
        moments=moments,
        contradicted=contradicted,
        size_error=size_error,
        effort=found.effort,
        lasting=found.lasting,
        ratios=ratios,
        confident=confident,
        confident_range=jnp.where(confident, gradient_safe.norm(estimate.r_TS_N), health.confident_range),
    )


def _faded(moments: Float[Array, "2 m"], innovation: SensorInnovation, evidence: Scalar) -> Float[Array, "2 m"]:
    """Moments after an innovation that counts by its `evidence` in time constants."""
    deviation = innovation.innovation / gradient_safe.sqrt(innovation.variance)
    fraction = jnp.where(innovation.used, jnp.minimum(evidence, 1.0), 0.0)[None]
    powers = jnp.where(innovation.used[None], jnp.stack([deviation, deviation**2]), moments)
    return moments + fraction * (powers - moments)


_NOISE_TOLERANCE = 1.5
"""Noise over the believed one up to which the estimate is less accurate than it might be, but not wrong [-]. A choice:
with 1.33 times the coverage is still 99.8 % (experiments/unseen_missions)."""


def _chi_square_over_dof(sigma: Scalar, dof: Scalar | float) -> Scalar:
    """Quantile of chi-square over its degrees of freedom by that of a normal (Wilson and Hilferty, 1931)."""
    spread = 2.0 / (9.0 * dof)
    return (1.0 - spread + sigma * jnp.sqrt(spread)) ** 3
