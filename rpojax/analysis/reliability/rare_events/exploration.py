"""Exploration: where failure lives, found by subset simulation and by scale annealing, which fail differently.

Scale annealing: failures of a wider distribution are moved to the nominal one, which needs no ranking by margins.

Points of a distribution whose normal numbers are several times wider fail often, and in every failure region in turn. A
sequence of narrower distributions, each restricted to failure, leads to the nominal one: resampling by the ratio of the
densities, then moves of chains that stay inside failure (sequential Monte Carlo; Del Moral, Doucet and Jasra 2006).
Margins only say whether a point fails, so that a margin which leads astray does not matter.
"""

import math
from dataclasses import dataclass

import numpy as np

from rpojax.analysis.reliability.rare_events import subset_simulation
from rpojax.analysis.reliability.rare_events.latent_points import LatentPoints, LimitStateCalls, concatenated
from rpojax.analysis.reliability.rare_events.probability_estimate import LevelRecord
from rpojax.analysis.reliability.rare_events.proposal_fit import WeightedFailures
from rpojax.analysis.reliability.rare_events.subset_simulation import ChainMoves, SubsetResult, spread

_FIRST_SCALES = (3.0, 4.5)
_MIN_FIRST_FAILURES = 5
_FIRST_STEP, _PARTS = 0.6, 4
_EFFECTIVE_SHARE = 0.5
"""Effective sample size after a change of scale, over the number of points."""
FIRST_SHARE = 0.08
"""Share of the budget for the first plain samples."""
_LEVEL_SHARE, _SUBSET_SHARE = 0.05, 0.35
_SCALE_SHARE, _ANNEALING_SHARE = 0.03, 0.25
_MIN_LEVEL, _MIN_SCALE = 20, 12
_OUTER_SHARE = 0.3
"""Factor on the weight of failures that only annealing found while it was wider than the nominal distribution."""


@dataclass(frozen=True)
class AnnealingResult:
    """Result of scale annealing.

    Attributes:
        failures: points of failure at the last scale
        families: (n,) equal for failures that descend from one point of the first scale
        scale: last scale that was reached; 1 is the nominal distribution
        probability: estimate; None where the nominal scale was not reached
        levels: what each scale did
    """

    failures: LatentPoints
    families: np.ndarray
    scale: float
    probability: float | None
    levels: tuple[LevelRecord, ...]


def anneal(calls: LimitStateCalls, rng: np.random.Generator, per_scale: int, most: int) -> AnnealingResult:
    """Failures at the nominal scale from `per_scale` points on each scale, with at most `most` evaluations."""
    end = calls.used + min(most, calls.left)
    points, scale, logarithm, levels = _first_failures(calls, rng, per_scale, end)
    families, factor = np.arange(len(points)), _FIRST_STEP
    if len(points) < _MIN_FIRST_FAILURES:
        return AnnealingResult(points, families, scale, None, tuple(levels))
    while scale > 1.0:
        next_scale = _next_scale(points.x, scale)
        weights = _log_ratio(points.x, scale, next_scale)
        peak = float(weights.max())
        shares = np.exp(weights - peak)
        if calls.used + per_scale > end:
            return AnnealingResult(points, families, scale, None, tuple(levels))
        logarithm += peak + math.log(shares.mean())
        rows = _systematic_rows(rng, shares / shares.sum(), per_scale)
        points, acceptance, factor = _moved(calls, rng, points.rows(rows), next_scale, factor)
        families, scale = families[rows], next_scale
        levels.append(LevelRecord(f"scale {scale:.2f}", per_scale, acceptance=acceptance))
    return AnnealingResult(points, families, scale, math.exp(logarithm), tuple(levels))


def _moved(
    calls: LimitStateCalls, rng: np.random.Generator, points: LatentPoints, scale: float, factor: float
) -> tuple[LatentPoints, float, float]:
    """Failures after a move of each, the share of accepted moves, and the adapted step.

    The points move in parts, so that the step follows the acceptance of those before.
    """
    moves = ChainMoves(spread(points.x) / scale, scale, factor)
    parts = []
    for rows in np.array_split(np.arange(len(points)), _PARTS):
        part = points.rows(rows)
        proposed, redraws = moves.propose(rng, part)
        accepted = calls.margins(proposed) <= 0.0
        moves.adapt(accepted, redraws)
        parts.append(part.replaced(accepted, proposed))
    return concatenated(parts), moves.acceptance, moves.factor


def _first_failures(
    calls: LimitStateCalls, rng: np.random.Generator, count: int, end: int
) -> tuple[LatentPoints, float, float, list[LevelRecord]]:
    """Failures of the first scale with enough of them, that scale, and the logarithm of their share."""
    points, scale, logarithm = calls.space.sample(rng, 0), _FIRST_SCALES[0], -math.inf
    levels: list[LevelRecord] = []
    for scale in _FIRST_SCALES:
        if calls.used + count > end:
            break
        sampled = calls.space.sample(rng, count, scale, in_blocks=True)
        failed = calls.margins(sampled) <= 0.0
        levels.append(LevelRecord(f"scale {scale:.2f}", count, float(failed.mean())))
        points = sampled.rows(failed)
        if len(points) >= _MIN_FIRST_FAILURES:
            return points, scale, math.log(failed.mean()), levels
    return points, scale, logarithm, levels


def _log_ratio(x: np.ndarray, scale: float, next_scale: float) -> np.ndarray:
    """Logarithm of the ratio of the densities of two scales at points (n, k)."""
    squares = np.sum(x**2, axis=1)
    return x.shape[1] * math.log(scale / next_scale) - 0.5 * squares * (next_scale**-2 - scale**-2)


def _next_scale(x: np.ndarray, scale: float) -> float:
    """Next scale, at least 1, at which the weights of the points keep their share of effective size."""

    def effective_share(candidate: float) -> float:
        weights = _log_ratio(x, scale, candidate)
        weights = np.exp(weights - weights.max())
        return float(weights.sum() ** 2 / (weights**2).sum() / len(weights))

    if effective_share(1.0) >= _EFFECTIVE_SHARE:
        return 1.0
    low, high = 1.0, scale
    for _ in range(30):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if effective_share(middle) >= _EFFECTIVE_SHARE else (middle, high)
    return high


def _systematic_rows(rng: np.random.Generator, shares: np.ndarray, count: int) -> np.ndarray:
    """Rows (count,) chosen in proportion to `shares` by systematic resampling."""
    places = (rng.random() + np.arange(count)) / count
    return np.minimum(np.searchsorted(np.cumsum(shares), places), len(shares) - 1)


@dataclass(frozen=True)
class Exploration:
    """What was found.

    Attributes:
        subset: subset simulation
        annealing: scale annealing
    """

    subset: SubsetResult
    annealing: AnnealingResult

    @property
    def failures(self) -> WeightedFailures | None:
        """Failures found, each search weighted by its number of independent chains; None if none was found."""
        points, chains = self.subset.failures
        parts: list[tuple[np.ndarray, np.ndarray, float]] = []
        if len(points):
            parts.append((points.x, chains, float(len(np.unique(chains)))))
        outer = self.annealing.failures
        if len(outer):
            families = len(np.unique(self.annealing.families))
            share = families if self.annealing.probability is not None else _OUTER_SHARE * families
            x = outer.x if self.annealing.probability is not None else outer.x / self.annealing.scale**0.5
            parts.append((x, self.annealing.families, share))
        if not parts:
            return None
        x = np.concatenate([each for each, _, _ in parts])
        weights = np.concatenate([np.full(len(each), share / len(each)) for each, _, share in parts])
        groups = np.concatenate([chains + 10**6 * place for place, (_, chains, _) in enumerate(parts)])
        return WeightedFailures(x, weights, groups, self.subset.steepest)


def explore(calls: LimitStateCalls, rng: np.random.Generator, first: tuple[LatentPoints, np.ndarray]) -> Exploration:
    """Searches for failure from plain samples with their margins."""
    budget = calls.budget
    subset = subset_simulation.simulate(
        calls, rng, max(_MIN_LEVEL, int(_LEVEL_SHARE * budget)), int(_SUBSET_SHARE * budget), first
    )
    annealing = anneal(calls, rng, max(_MIN_SCALE, int(_SCALE_SHARE * budget)), int(_ANNEALING_SHARE * budget))
    return Exploration(subset, annealing)
