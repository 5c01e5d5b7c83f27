"""Line sampling: the probability along parallel lines in the direction in which failure is nearest.

Lines are random across the direction; along each the margin is evaluated on both sides on a grid, its changes of sign
are refined by regula falsi, or halved where it is a step, and the probability of what fails is that of a normal number
(Koutsourelakis, Pradlwarter and Schueller 2004). Noise is drawn once for each line.
"""

import math
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr
from scipy.stats import t as student

from rpojax.analysis.reliability.rare_events import subset_simulation
from rpojax.analysis.reliability.rare_events.latent_points import LatentPoints, LimitStateCalls, undefined_fault
from rpojax.analysis.reliability.rare_events.probability_estimate import (
    DesignPoint,
    LevelRecord,
    ProbabilityEstimate,
    log_normal_interval,
)

_DIRECTION_SHARE = 0.35
_LEVEL_SHARE = 0.05
_GRID = np.array([-7.0, -5.0, -3.5, -2.0, 0.0, 2.0, 3.0, 4.0, 5.0, 6.5, 8.0])
_REFINEMENTS = 4
_MOST_REFINEMENTS = 16
"""Refinements at most of a change of sign at a step of the margin, which use what other lines leave over."""
_SETTLED = 0.02
"""Distance by which the last refinement moves a change of sign at most, or it is halved on."""
_LARGEST_SLOPE_RATIO = 8.0
"""Ratio of the margin's slopes on both sides of a place above which it is a step between them."""
_MANY_DIMENSIONS = 10
"""Dimension above which the mean of a few failures is a poor direction, and the regression of margins a better one."""
_ROOT_VARIATION = 2e-3
"""Coefficient of variation that stands for the error of the changes of sign that were found."""
_OTHER_SIDE = 0.02
"""Share of the probability on the far side above which the direction is no important one."""
_UNKNOWN = 0.1
"""Share of the probability between places next to a step of the margin above which the estimate is not trusted."""


@dataclass(frozen=True)
class _Lines:
    """What was found along lines.

    Attributes:
        probabilities: (lines,) of failure
        other_side: (lines,) part of them on the far side
        undefined: (lines,) whether failure begins or ends where the margin is undefined
        unknown: (lines,) probability within which changes of sign were not located
        nearest: least distance of failure
    """

    probabilities: np.ndarray
    other_side: np.ndarray
    undefined: np.ndarray
    unknown: np.ndarray
    nearest: float


def estimate(
    calls: LimitStateCalls, rng: np.random.Generator, first: tuple[LatentPoints, np.ndarray], reason: str
) -> ProbabilityEstimate:
    """Probability by lines along the mean direction of failures that a subset simulation finds."""
    budget = calls.budget
    search = subset_simulation.simulate(
        calls, rng, max(60, int(_LEVEL_SHARE * budget)), int(_DIRECTION_SHARE * budget), first
    )
    failures, _ = search.failures
    warnings: list[str] = []
    if len(failures) == 0:
        warnings.append("no failure was found: the direction is that of the lowest margins")
        failures = search.last.points.rows(np.argsort(search.last.margins)[: max(1, len(search.last.margins) // 10)])
    mean = failures.x.mean(axis=0)
    direction = mean / max(float(np.linalg.norm(mean)), 1e-12)
    if calls.space.dimension > _MANY_DIMENSIONS and search.steepest is not None and search.steepest @ direction > 0.5:
        direction = search.steepest
    concentration = float(
        np.linalg.norm(mean) / np.sqrt(np.mean(np.sum((failures.x @ direction)[:, None] ** 2, axis=1)))
    )
    if concentration < 0.5:
        warnings.append("failures lie in several directions, so that no single one is important")
    lines = _along_lines(calls, rng, direction)
    warnings += undefined_fault(np.where(lines.undefined, -np.inf, 0.0), lines.probabilities)
    return _judged(calls, search, lines, direction * lines.nearest, warnings, reason)


def _along_lines(calls: LimitStateCalls, rng: np.random.Generator, direction: np.ndarray) -> _Lines:
    """Failure along as many random lines in a direction as the budget allows."""
    lines = max(1, calls.left // (len(_GRID) + 2 * _REFINEMENTS))
    points = calls.space.sample(rng, lines)
    across = points.x - (points.x @ direction)[:, None] * direction

    def margins(rows: np.ndarray, places: np.ndarray) -> np.ndarray:
        x = across[rows] + places[:, None] * direction
        return calls.margins(LatentPoints(x, points.keys[rows]))

    rows = np.repeat(np.arange(lines), len(_GRID))
    grid = margins(rows, np.tile(_GRID, lines)).reshape(lines, len(_GRID))
    failed = grid <= 0.0
    line, cell = np.nonzero(failed[:, 1:] != failed[:, :-1])
    low, high = _GRID[cell], _GRID[cell + 1]
    g_low, g_high = grid[line, cell], grid[line, cell + 1]
    # Where no straight line through the margins leads to the change of sign: once it is, a cell is halved to the end.
    abrupt = ~np.isfinite(g_low + g_high) | (g_low == 0.0) | (g_high == 0.0)
    for refinement in range(_MOST_REFINEMENTS):
        chosen = np.arange(len(line)) if refinement < _REFINEMENTS else np.flatnonzero(abrupt)
        if not len(chosen) or len(chosen) > calls.left:
            break
        a, b, g_a, g_b = low[chosen], high[chosen], g_low[chosen], g_high[chosen]
        share = np.where(abrupt[chosen], 0.5, np.clip(_zero(g_a, g_b), 0.05, 0.95))
        middle = a + share * (b - a)
        g_middle = margins(line[chosen], middle)
        same = (g_middle <= 0.0) == (g_a <= 0.0)
        low[chosen], g_low[chosen] = np.where(same, middle, a), np.where(same, g_middle, g_a)
        high[chosen], g_high[chosen] = np.where(same, b, middle), np.where(same, g_b, g_middle)
        abrupt[chosen] |= _is_abrupt(share, g_a, g_middle, g_b)
        if refinement == _REFINEMENTS - 1:
            abrupt |= np.abs(low + _zero(g_low, g_high) * (high - low) - middle) > _SETTLED
    crossings = low + np.where(abrupt, 0.5, np.clip(_zero(g_low, g_high), 0.0, 1.0)) * (high - low)
    undefined, unknown = np.zeros(lines, dtype=bool), np.zeros(lines)
    undefined[line[np.isneginf(np.minimum(g_low, g_high))]] = True
    np.add.at(unknown, line[abrupt], (ndtr(high) - ndtr(low))[abrupt])
    probabilities, other_side = np.zeros(lines), np.zeros(lines)
    for number in range(lines):
        ends = np.concatenate([[-np.inf], crossings[line == number], [np.inf]])
        inside = failed[number, 0] ^ (np.arange(len(ends) - 1) % 2 == 1)
        for begin, end in zip(ends[:-1][inside], ends[1:][inside], strict=True):
            probabilities[number] += float(ndtr(-begin) - ndtr(-end)) if begin > 0.0 else float(ndtr(end) - ndtr(begin))
            other_side[number] += float(ndtr(min(end, 0.0)) - ndtr(begin)) if begin < 0.0 else 0.0
    nearest = float(np.min(np.abs(crossings), initial=_GRID[-1])) if len(crossings) else float(_GRID[-1])
    return _Lines(probabilities, other_side, undefined, unknown, nearest)


def _zero(g_low: np.ndarray, g_high: np.ndarray) -> np.ndarray:
    """Fractions of intervals where lines through the margins of their ends are zero; a half where one is undefined."""
    defined = np.isfinite(g_low) & np.isfinite(g_high) & (g_low != g_high)
    return np.where(defined, g_low, 1.0) / np.where(defined, g_low - g_high, 2.0)


def _is_abrupt(share: np.ndarray, g_low: np.ndarray, g_middle: np.ndarray, g_high: np.ndarray) -> np.ndarray:
    """Whether margins of the ends and of a place at a share between them are those of a step, or undefined.

    The slopes on both sides of the place differ by much, or have opposite signs: counts of ticks are such margins.
    """
    with np.errstate(invalid="ignore", divide="ignore"):
        ratio = (g_middle - g_low) / share / ((g_high - g_middle) / (1.0 - share))
    return ~((ratio > 1.0 / _LARGEST_SLOPE_RATIO) & (ratio < _LARGEST_SLOPE_RATIO))


def _judged(
    calls: LimitStateCalls,
    search: subset_simulation.SubsetResult,
    along: _Lines,
    point: np.ndarray,
    warnings: list[str],
    reason: str,
) -> ProbabilityEstimate:
    """Estimate from probabilities along lines, of their far side and next to steps, and reasons to distrust it."""
    probabilities, other_side = along.probabilities, along.other_side
    lines, probability = len(probabilities), float(probabilities.mean())
    share_unknown, variation = 0.0, math.inf
    if probability > 0.0:
        sampled = float(np.std(probabilities, ddof=1)) / math.sqrt(lines) / probability if lines > 1 else 1.0
        # All lines may meet the same step, so that their errors add.
        share_unknown = float(along.unknown.mean()) / probability
        variation = math.hypot(sampled, _ROOT_VARIATION, 0.5 * share_unknown)
    if share_unknown > _UNKNOWN:
        share = f"{100 * share_unknown:.0f} %"
        warnings.append(f"failure begins at steps of the margin, which are located to {share} of the probability")
    if probability <= 0.0:
        warnings.append("no line met failure")
    if other_side.sum() > _OTHER_SIDE * probabilities.sum() > 0.0:
        warnings.append("failure lies on more than one side of the direction")
    if search.complete and probability > 0.0:
        gap = math.log(search.probability / probability) / math.sqrt(
            math.log1p(search.variation**2) + math.log1p(variation**2)
        )
        if gap > 3.0:
            warnings.append(f"subset simulation found {search.probability:.3g}: lines miss a part of failure")
    effective = probabilities.sum() ** 2 / np.sum(probabilities**2) if probability > 0.0 else 0.0
    if effective < 20.0:
        warnings.append(f"lines are worth {effective:.0f} equal ones")
    reach = float(student.ppf(0.975, max(effective, 2.0)))
    confidence = math.erf(reach / math.sqrt(2.0))
    no_failure = (0.0, float(ndtr(-2.0)))
    return ProbabilityEstimate(
        probability=probability,
        interval_95=log_normal_interval(probability, variation, confidence) if probability > 0.0 else no_failure,
        coefficient_of_variation=variation,
        evaluations=calls.used,
        method="line",
        trusted=not warnings,
        warnings=(*warnings, *calls.undefined_remark()),
        reason=reason,
        effective_sample_size=float(effective),
        levels=(*search.levels, LevelRecord("lines", lines, probability)),
        design_points=(DesignPoint(point, float(np.linalg.norm(point)), 1.0),) if probability > 0.0 else (),
    )
