"""Importance sampling from proposals that are fitted to the failures of earlier rounds.

Only the last round, whose proposal is fixed before it is drawn, gives the estimate, which is therefore unbiased: also
where noise is drawn anew for each point, whatever the noise does.
"""

import dataclasses
import math
from dataclasses import dataclass

import numpy as np
from scipy.stats import t as student

from rpojax.analysis.reliability.rare_events import proposal_fit
from rpojax.analysis.reliability.rare_events.latent_points import LimitStateCalls
from rpojax.analysis.reliability.rare_events.probability_estimate import (
    DesignPoint,
    log_normal_interval,
)
from rpojax.analysis.reliability.rare_events.proposal_densities import Mixture, log_nominal, mixture
from rpojax.analysis.reliability.rare_events.proposal_fit import WeightedFailures

MIN_EFFECTIVE = 40.0
"""Effective failures below which weights have degenerated."""
_MAX_WEIGHT_SHARE = 0.15
_FITS, _MAX_ROUNDS = 2, 4
"""Fits to rounds of importance sampling that are wanted, and rounds after which they are given up."""
_CAUTION = 1.15
"""Factor on the reach of the interval: a sample rarely holds the largest weights, and understates its variance."""
_UNCOVERED_FACTOR = 10.0
"""Weight, in multiples of the estimate, above which a failure lies where the proposal hardly draws."""
_KEPT_OF_PREVIOUS = 0.2
"""Share of the previous proposal in a new one, so that no region is forgotten."""
_SAME_DIRECTION = 0.5
"""Cosine above which two points of failure count as one region."""
_MANY_DIMENSIONS = 10
_MAX_DESIGN_POINTS = 8


@dataclass(frozen=True)
class Round:
    """Points drawn from one proposal.

    Attributes:
        proposal: density of the points
        x: (n, k)
        keys: (n, blocks) noise keys
        margins: (n,)
        log_nominal: (n,) logarithm of the nominal density
        weights: (n,) nominal density over that of the proposal for failures, else 0
    """

    proposal: Mixture
    x: np.ndarray
    keys: np.ndarray
    margins: np.ndarray
    log_nominal: np.ndarray
    weights: np.ndarray

    @property
    def probability(self) -> float:
        """Estimate."""
        return float(self.weights.mean())

    @property
    def variance_of_one(self) -> float:
        """Squared coefficient of variation of a single point's contribution; infinite without a failure."""
        if self.probability <= 0.0:
            return math.inf
        return float(np.var(self.weights, ddof=1) / self.probability**2)

    @property
    def variation(self) -> float:
        """Coefficient of variation of the estimate."""
        return math.sqrt(self.variance_of_one / len(self.weights))

    @property
    def effective_size(self) -> float:
        """Failures of equal weight that would tell as much."""
        return effective_size(self.weights)


def effective_size(weights: np.ndarray) -> float:
    """Effective sample size of weights (n,); zero without a positive one."""
    total = float(weights.sum())
    return total**2 / float(np.sum(weights**2)) if total > 0.0 else 0.0


def draw_round(calls: LimitStateCalls, rng: np.random.Generator, proposal: Mixture, count: int) -> Round:
    """A round of `count` points, with fresh noise."""
    points = calls.space.with_fresh_noise(rng, proposal.sample(rng, count))
    margins = calls.margins(points)
    nominal = log_nominal(points.x)
    weights = np.where(margins <= 0.0, np.exp(nominal - proposal.log_density(points.x)), 0.0)
    return Round(proposal, points.x, points.keys, margins, nominal, weights)


def adapted(
    calls: LimitStateCalls, rng: np.random.Generator, start: WeightedFailures, count: int
) -> tuple[Mixture, list[Round]]:
    """Proposal after rounds of `count` points, and the rounds; the first proposal is fitted to known failures.

    A new proposal is fitted to the failures of all rounds, weighted as points of the mixture of their proposals.
    Weights that a few points dominate are flattened by an exponent below 1, so that the fit moves part of the way.
    """
    proposal = proposal_fit.fit_proposal(rng, start)
    rounds: list[Round] = []
    fits = 0
    while not rounds or (fits < _FITS and len(rounds) < _MAX_ROUNDS and calls.left >= 4 * count):
        rounds.append(draw_round(calls, rng, proposal, count))
        known = _joint_failures(rounds)
        if known is not None and len(known.x) >= MIN_EFFECTIVE:
            exponent = _tempering(known.weights)
            known = dataclasses.replace(known, weights=known.weights**exponent, steepest=start.steepest)
            fitted = proposal_fit.fit_proposal(rng, known)
            fits += exponent == 1.0
            proposal = mixture([(1.0 - _KEPT_OF_PREVIOUS, fitted), (_KEPT_OF_PREVIOUS, rounds[0].proposal)])
    return proposal, rounds


def _tempering(weights: np.ndarray) -> float:
    """Greatest exponent, at most 1, with which weights (n,) have the least effective size."""
    if effective_size(weights) >= MIN_EFFECTIVE:
        return 1.0
    low, high = 0.0, 1.0
    for _ in range(20):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if effective_size(weights**middle) >= MIN_EFFECTIVE else (low, middle)
    return low


def _joint_failures(rounds: list[Round]) -> WeightedFailures | None:
    """Failures of all rounds, with the weights of the mixture of their proposals; None if there are none."""
    counts = np.array([len(each.margins) for each in rounds], dtype=float)
    joint = mixture([(count, each.proposal) for count, each in zip(counts, rounds, strict=True)])
    failed = [drawn_round.margins <= 0.0 for drawn_round in rounds]
    x = np.concatenate([each.x[rows] for each, rows in zip(rounds, failed, strict=True)])
    if len(x) == 0:
        return None
    nominal = np.concatenate([each.log_nominal[rows] for each, rows in zip(rounds, failed, strict=True)])
    logs = nominal - joint.log_density(x)
    return WeightedFailures(x, np.exp(logs - logs.max()), np.arange(len(x)))


def interval(found: Round) -> tuple[float, float]:
    """95 % interval, wider where few failures carry the weight (Student's factor for the effective size)."""
    reach = _CAUTION * float(student.ppf(0.975, max(found.effective_size, 2.0)))
    return log_normal_interval(found.probability, found.variation, math.erf(reach / math.sqrt(2.0)))


def weight_warnings(found: Round) -> list[str]:
    """What speaks against the weights of a round."""
    warnings = []
    if found.effective_size < MIN_EFFECTIVE:
        warnings.append(f"weights have degenerated: they are worth {found.effective_size:.0f} failures")
    largest = float(found.weights.max() / found.weights.sum()) if found.weights.any() else 1.0
    if largest > _MAX_WEIGHT_SHARE:
        warnings.append(f"one point carries {100.0 * largest:.0f} % of the estimate")
    return warnings


def uncovered_share(x: np.ndarray, found: Round) -> float:
    """Share of failures (n, k), drawn from the nominal distribution, that a round can hardly have drawn."""
    logs = log_nominal(x) - found.proposal.log_density(x)
    return float(np.mean(logs > math.log(_UNCOVERED_FACTOR * max(found.probability, 1e-300))))


def design_points(found: Round) -> tuple[DesignPoint, ...]:
    """Most likely failures, one in each region; in many dimensions the mean of the region's failures."""
    rows = np.flatnonzero(found.weights)
    if len(rows) == 0:
        return ()
    x, weights = found.x[rows], found.weights[rows] / found.weights.sum()
    if x.shape[1] > _MANY_DIMENSIONS:
        shares = found.proposal.shares(x) * weights[:, None]
        totals = shares.sum(axis=0)
        centres = (shares.T @ x)[totals > 0.01] / totals[totals > 0.01][:, None]
    else:
        centres = x
    order = np.argsort(np.linalg.norm(centres, axis=1))
    units = centres / np.maximum(np.linalg.norm(centres, axis=1), 1e-12)[:, None]
    chosen: list[int] = []
    for row in order:
        if len(chosen) < _MAX_DESIGN_POINTS and all(units[row] @ units[other] < _SAME_DIRECTION for other in chosen):
            chosen.append(int(row))
    nearest = np.argmax(x @ units[chosen].T, axis=1)
    shares_of = np.bincount(nearest, weights=weights, minlength=len(chosen))
    points = [
        DesignPoint(centres[row], float(np.linalg.norm(centres[row])), float(share))
        for row, share in zip(chosen, shares_of, strict=True)
    ]
    return tuple(sorted((point for point in points if point.share > 0.01), key=lambda each: -each.share))
