"""Subset simulation: a small probability as a product of larger, conditional ones (Au and Beck 2001).

Moves of Markov chains that keep the nominal distribution: preconditioned Crank-Nicolson, and redrawn noise keys.

The step of each coordinate follows the spread of the points at hand, and a common factor follows the acceptance
(adaptive conditional sampling; Papaioannou, Betz, Zwirglmaier and Straub 2015).
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from rpojax.analysis.reliability.rare_events.latent_points import KEY_LIMIT, LatentPoints, LimitStateCalls, concatenated
from rpojax.analysis.reliability.rare_events.probability_estimate import LevelRecord

_TARGET_ACCEPTANCE = 0.44
_KEY_MOVE_SHARE = 0.5
"""Share of the moves that redraw noise keys, where there are any, and leave the normal numbers."""
LEVEL_PROBABILITY = 0.1
MIN_PROBABILITY = 1e-14
"""Probability below which no further level is begun."""
_FLAT_SHARE = 0.5
"""Share of points at or below the threshold of a level above which margins are too equal to rank them."""
_MIN_ACCEPTANCE = 0.1
_FIRST_STEP = 0.8


@dataclass
class ChainMoves:
    """Proposals of chains, adapted to their acceptance.

    Attributes:
        deviations: (k,) spread of the points, in units of the nominal scale
        scale: of the distribution that the moves keep
        factor: on `deviations`
        key_share: expected share of the noise keys that a move redraws
        proposed: moves so far
        accepted: of them
    """

    deviations: np.ndarray
    scale: float = 1.0
    factor: float = 0.8
    key_share: float = 0.5
    proposed: int = 0
    accepted: int = 0
    _turns: int = field(default=0)

    @property
    def acceptance(self) -> float:
        """Share of accepted moves."""
        return self.accepted / max(1, self.proposed)

    def propose(self, rng: np.random.Generator, points: LatentPoints) -> tuple[LatentPoints, np.ndarray]:
        """Proposals, and flags (n,) of those that redraw noise."""
        count, blocks = len(points), points.keys.shape[1]
        step = np.minimum(1.0, self.factor * self.deviations)
        moved = np.sqrt(1.0 - step**2) * points.x + step * self.scale * rng.standard_normal(points.x.shape)
        if blocks == 0:
            return LatentPoints(moved, points.keys), np.zeros(count, dtype=bool)
        redraws = rng.random(count) < _KEY_MOVE_SHARE
        chosen = rng.random(points.keys.shape) < self.key_share
        chosen[np.arange(count), rng.integers(0, blocks, count)] = True
        fresh = rng.integers(1, KEY_LIMIT, points.keys.shape, dtype=np.uint32)
        keys = np.where(chosen & redraws[:, None], fresh, points.keys)
        return LatentPoints(np.where(redraws[:, None], points.x, moved), keys), redraws

    def adapt(self, accepted: np.ndarray, redraws: np.ndarray) -> None:
        """Adapts the step to the acceptance (n,) of proposals; `redraws` (n,) marks those that redrew noise."""
        self._turns += 1
        gain = 1.0 / np.sqrt(self._turns)
        self.proposed += len(accepted)
        self.accepted += int(accepted.sum())
        for which, name in ((~redraws, "factor"), (redraws, "key_share")):
            if which.any():
                change = gain * (accepted[which].mean() - _TARGET_ACCEPTANCE)
                setattr(self, name, float(np.clip(getattr(self, name) * np.exp(change), 1e-3, 3.0)))
        self.key_share = min(self.key_share, 1.0)


def spread(x: np.ndarray) -> np.ndarray:
    """Standard deviations (k,) of points (n, k), never zero."""
    return np.maximum(np.std(x, axis=0), 1e-2) if len(x) > 1 else np.ones(x.shape[1])


@dataclass(frozen=True)
class ChainSamples:
    """Points of one level.

    Attributes:
        points: (n,) of them
        margins: (n,)
        chains: (n,) number of the chain of each
        independent: whether they are independent rather than chains
    """

    points: LatentPoints
    margins: np.ndarray
    chains: np.ndarray
    independent: bool


@dataclass(frozen=True)
class SubsetResult:
    """Result of one subset simulation.

    Attributes:
        probability: estimate; that of the last level that was reached, where failure was not
        variation: its coefficient of variation
        last: points of the last level
        previous: points of the level before, with their margins
        levels: what each did
        complete: whether failure was reached
        flat: whether margins did not rank the points
        mixing: whether all chains moved
    """

    probability: float
    variation: float
    last: ChainSamples
    previous: ChainSamples
    levels: tuple[LevelRecord, ...]
    complete: bool
    flat: bool
    mixing: bool

    @property
    def failures(self) -> tuple[LatentPoints, np.ndarray]:
        """Points of failure of the last level, and their chains."""
        failed = self.last.margins <= 0.0
        return self.last.points.rows(failed), self.last.chains[failed]

    @property
    def steepest(self) -> np.ndarray | None:
        """Unit vector (k,) against the slope of a linear regression of margins on points of the last two levels."""
        levels = (self.previous, self.last)
        x = np.concatenate([level.points.x for level in levels])
        margins = np.concatenate([level.margins for level in levels])
        finite = np.isfinite(margins)
        if finite.sum() < 2 * x.shape[1] or np.ptp(margins[finite]) == 0.0:
            return None
        columns = np.hstack([x[finite], np.ones((int(finite.sum()), 1))])
        slope = -np.linalg.lstsq(columns, margins[finite], rcond=None)[0][:-1]
        length = float(np.linalg.norm(slope))
        return slope / length if length > 0.0 else None


def simulate(
    calls: LimitStateCalls,
    rng: np.random.Generator,
    per_level: int,
    most: int,
    first: tuple[LatentPoints, np.ndarray] | None = None,
) -> SubsetResult:
    """One subset simulation with `per_level` points on each level and at most `most` evaluations.

    `first` are points of the nominal distribution with their margins, for the first level.
    """
    end = calls.used + min(most, calls.left)
    samples = _first_samples(calls, rng, per_level, first)
    levels, squares, probability, mixing = [], 0.0, 1.0, True
    acceptance, threshold, previous, factor = None, math.inf, samples, _FIRST_STEP
    while True:
        margins, count = samples.margins, len(samples.margins)
        failures = int((margins <= 0.0).sum())
        wanted = math.ceil(LEVEL_PROBABILITY * count)
        new_threshold = 0.0 if failures >= wanted else float(np.partition(margins, wanted - 1)[wanted - 1])
        inside = margins <= new_threshold
        share = inside.mean()
        evaluations = count if samples.independent else count - len(np.unique(samples.chains))
        levels.append(LevelRecord("level", evaluations, float(share), new_threshold, acceptance))
        flat = new_threshold > 0.0 and (share > _FLAT_SHARE or new_threshold >= threshold)
        done = new_threshold <= 0.0
        needed = per_level - min(int(inside.sum()), math.ceil(LEVEL_PROBABILITY * per_level))
        tiny = probability * share < MIN_PROBABILITY
        if done or flat or tiny or calls.used + needed > end:
            probability *= failures / count if done or failures else share
            squares += _squared_variation(samples, inside)
            return SubsetResult(probability, math.sqrt(squares), samples, previous, tuple(levels), done, flat, mixing)
        probability *= share
        squares += _squared_variation(samples, inside)
        threshold, previous = new_threshold, samples
        samples, moves = _next_samples(calls, rng, samples, inside, threshold, per_level, factor)
        acceptance, factor = moves.acceptance, moves.factor
        mixing = mixing and acceptance > _MIN_ACCEPTANCE


def _first_samples(
    calls: LimitStateCalls,
    rng: np.random.Generator,
    count: int,
    first: tuple[LatentPoints, np.ndarray] | None,
) -> ChainSamples:
    """Independent points of the nominal distribution, those of `first` among them."""
    parts = [] if first is None else [first]
    missing = min(count - sum(len(points) for points, _ in parts), calls.left)
    if missing > 0:
        points = calls.space.sample(rng, missing, in_blocks=True)
        parts.append((points, calls.margins(points)))
    margins = np.concatenate([margins for _, margins in parts])
    return ChainSamples(concatenated([points for points, _ in parts]), margins, np.arange(len(margins)), True)


def _next_samples(
    calls: LimitStateCalls,
    rng: np.random.Generator,
    samples: ChainSamples,
    inside: np.ndarray,
    threshold: float,
    count: int,
    factor: float,
) -> tuple[ChainSamples, ChainMoves]:
    """Points of the next level by chains from those inside the threshold."""
    rows = rng.permutation(np.flatnonzero(inside))
    rows = rows[: max(1, math.ceil(LEVEL_PROBABILITY * count))]
    points, margins, moves = walk(
        calls,
        rng,
        samples.points.rows(rows),
        samples.margins[rows],
        lambda g: g <= threshold,
        count - len(rows),
        factor,
    )
    return ChainSamples(points, margins, np.arange(len(margins)) % len(rows), False), moves


def walk(
    calls: LimitStateCalls,
    rng: np.random.Generator,
    points: LatentPoints,
    margins: np.ndarray,
    is_inside: Callable[[np.ndarray], np.ndarray],
    new_points: int,
    factor: float = 0.8,
) -> tuple[LatentPoints, np.ndarray, ChainMoves]:
    """Points of chains from starts (n,), the starts first, then step by step; the last step may be of fewer chains."""
    moves = ChainMoves(spread(points.x), factor=factor)
    all_points, all_margins = [points], [margins]
    while new_points > 0:
        count = min(len(points), new_points)
        points, margins = points.rows(slice(count)), margins[:count]
        proposed, redraws = moves.propose(rng, points)
        found = calls.margins(proposed)
        accepted = is_inside(found)
        points, margins = points.replaced(accepted, proposed), np.where(accepted, found, margins)
        moves.adapt(accepted, redraws)
        all_points.append(points)
        all_margins.append(margins)
        new_points -= count
    return concatenated(all_points), np.concatenate(all_margins), moves


def _squared_variation(samples: ChainSamples, inside: np.ndarray) -> float:
    """Square of the coefficient of variation of the share inside, with the correlation along chains."""
    share, count = inside.mean(), len(inside)
    if share <= 0.0:
        return math.inf
    independent = (1.0 - share) / (share * count)
    if samples.independent:
        return independent
    chains = len(np.unique(samples.chains))
    steps = count // chains
    hits = inside[: steps * chains].reshape(steps, chains).astype(float)
    # Variance of the mean from the totals of chains, which are nearly independent, and the sum of autocorrelations.
    between = float(np.var(hits.mean(axis=0), ddof=1)) / chains / share**2 if chains > 1 else math.inf
    return max(independent, between)
