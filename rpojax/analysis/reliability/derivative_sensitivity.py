"""Which dispersions make the spread of a metric, from derivatives of a handful of runs, and whether sampling agrees.

The mean square of a metric's derivative to a standard normal number is the variance that the number gives a linear
metric, and never less than its total effect on any smooth one (Sobol and Kucherenko, Math. Comput. Simul. 79, 2009;
Lamboni et al., 87, 2013: the Poincare constant of a standard normal number is one). Where a metric is rough that
bound is far off: the slopes are steep and lead nowhere. The mean derivative is that of the metric smoothed over all
runs (Stein's identity: the slope of a straight line through them), so inputs are ranked by it. Neither sees a jump, or
what sensor noise adds.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rpojax.analysis.gradients import rollout_evaluator
from rpojax.analysis.gradients.rollout_evaluator import RolloutEvaluator
from rpojax.analysis.reliability.evaluation_log import shrunk_mean
from rpojax.analysis.statistics.dependence_measures import spearman
from rpojax.analysis.statistics.rank_sensitivity import InputRanking, rank_inputs
from rpojax.dispersions.standard_normal_space import StandardNormalSpace
from rpojax.errors import RpojaxError
from rpojax.scenario.schema import ScenarioFile
from rpojax.simulation import running_metrics

LEADING = 5
"""So many inputs count as the ones that make the spread."""
FEWEST_RUNS = 2
_KINKS = {
    "min": "the least value over time: its derivative jumps where another instant becomes the least",
    "max": "the greatest value over time: its derivative jumps where another instant becomes the greatest",
    "end": "a sum of burns, decided on in steps: the derivative of a smoothed decision stands in for the jump",
}


@dataclass(frozen=True)
class InputShare:
    """What one input gives to the spread of a metric.

    Attributes:
        name: a dispersed number, or a dispersion whose numbers belong together
        sigma: root mean square over runs of the derivative to the input's standard normal numbers, in the metric's unit
        trend: size of its mean, less what its scatter explains: what a straight line through all runs would give
        nominal: the same of the median run alone
        one_run: greatest share of a single run in the mean square; near 1 an event, not a trend, is behind it
    """

    name: str
    sigma: float
    trend: float
    nominal: float
    one_run: float


@dataclass(frozen=True)
class MetricSensitivity:
    """What the dispersions give to the spread of one metric.

    Attributes:
        metric: its name
        unit: of the metric and of all sigmas
        shares: of all inputs, those with the greatest trend first, and of those without one the greatest sigma
        sigma: standard deviation by all of them, were the metric linear
        values: (runs,) of the metric in the runs with random dispersions
        kink: why the derivative jumps; None where it does not
    """

    metric: str
    unit: str
    shares: tuple[InputShare, ...]
    sigma: float
    values: np.ndarray
    kink: str | None

    @property
    def leading(self) -> tuple[str, ...]:
        """Names of the inputs that make most of the spread."""
        return tuple(share.name for share in self.shares[:LEADING] if share.trend > 0.0)


@dataclass(frozen=True)
class RankingAgreement:
    """A ranking by derivatives beside one by sampling.

    Attributes:
        runs: of the campaign that have the metric
        std: of the metric there, noise included
        leading: by sampling
        both: leading by derivatives, too
        rank_correlation: Spearman's, of both orders over all inputs; None where an order has no end
        strengths: by input, what the sampled order goes by
    """

    runs: int
    std: float
    leading: tuple[str, ...]
    both: tuple[str, ...]
    rank_correlation: float | None
    strengths: dict[str, float]


def select_metrics(file: ScenarioFile, asked: Sequence[str]) -> tuple[str, ...]:
    """Metrics that are asked for; by default those of the scenario's requirements that have a derivative.

    Raises:
        RpojaxError: a metric has no derivative, or there is none.
    """
    known = running_metrics.RUNNING_METRICS
    for name in asked:
        if name not in known:
            raise RpojaxError(f"--metric: found {name!r}, expected a metric with a derivative: {', '.join(known)}")
    names = asked or [each.metric for each in file.requirements if each.metric in known]
    if not names:
        raise RpojaxError("--metric: found none, expected one, for a scenario without requirements on such metrics")
    return tuple(dict.fromkeys(names))


def derivative_sensitivities(
    space: StandardNormalSpace, metrics: Sequence[str], runs: int, seed: int, evaluator: RolloutEvaluator | None = None
) -> tuple[MetricSensitivity, ...]:
    """Sensitivities of metrics over `runs` runs with random dispersions, and over the median run.

    Raises:
        RpojaxError: too few runs, or all of them fail.
    """
    if runs < FEWEST_RUNS:
        raise RpojaxError(f"--runs: found {runs}, expected at least {FEWEST_RUNS}")
    flown = evaluator or RolloutEvaluator(space.file, space.values_at, space.dimension, metrics, runs=runs + 1)
    drawn = np.random.default_rng([seed, 0xD15]).normal(size=(runs, space.dimension))
    numbers = np.concatenate([np.zeros((1, space.dimension)), drawn])
    found = flown.jacobian(numbers, rollout_evaluator.run_keys(seed, np.arange(runs + 1)))
    assert found.jacobian is not None
    whole = ~found.failed & np.isfinite(found.jacobian).all(axis=(1, 2))
    rows = np.flatnonzero(whole[1:]) + 1
    if len(rows) < FEWEST_RUNS:
        raise RpojaxError(f"--runs: found {len(rows)} that reached their end, expected at least {FEWEST_RUNS}")
    at_median = found.jacobian[0] if whole[0] else np.full(found.jacobian.shape[1:], np.nan)
    return tuple(
        _sensitivity(space, name, found.jacobian[rows, index], at_median[index], found.metrics[rows, index])
        for index, name in enumerate(metrics)
    )


def _sensitivity(
    space: StandardNormalSpace, metric: str, slopes: np.ndarray, nominal: np.ndarray, values: np.ndarray
) -> MetricSensitivity:
    """From derivatives (runs, k) to the numbers, those of the median run (k,), and values (runs,)."""
    figure = running_metrics.RUNNING_METRICS[metric]
    names = np.array(space.groups)
    shares = []
    for name in dict.fromkeys(space.groups):
        squares = np.sum(slopes[:, names == name] ** 2, axis=1)
        trend = float(np.linalg.norm(shrunk_mean(slopes[:, names == name])))
        total = float(squares.sum())
        at_median = float(np.linalg.norm(nominal[names == name]))
        one_run = float(squares.max()) / total if total > 0.0 else 0.0
        shares.append(InputShare(name, float(np.sqrt(squares.mean())), trend, at_median, one_run))
    return MetricSensitivity(
        metric=metric,
        unit=figure.unit,
        shares=tuple(sorted(shares, key=lambda share: (-share.trend, -share.sigma))),
        sigma=float(np.sqrt(np.mean(np.sum(slopes**2, axis=1)))),
        values=values,
        kink=_KINKS.get(figure.reduction),
    )


def compare_with_sampling(
    found: MetricSensitivity, space: StandardNormalSpace, columns: Mapping[str, np.ndarray], values: np.ndarray
) -> RankingAgreement | None:
    """How far the ranking agrees with that of a campaign's dispersed numbers (runs,) by name and its metric (runs,).

    The sampled strength of an input is the root of the sum of its squared rank correlations. None where nothing can be
    ranked.
    """
    ranking = rank_inputs(columns, values)
    if not ranking.inputs:
        return None
    strengths = _strengths(space, ranking)
    common = [share for share in found.shares if share.name in strengths]
    by_sample = sorted(strengths, key=lambda name: -strengths[name])[:LEADING]
    orders = np.array([[share.trend, strengths[share.name]] for share in common]).reshape(-1, 2).T
    defined = values[np.isfinite(values)]
    return RankingAgreement(
        runs=len(defined),
        std=float(np.std(defined, ddof=1)),
        leading=tuple(by_sample),
        both=tuple(name for name in found.leading if name in by_sample),
        rank_correlation=spearman(orders[0], orders[1]),
        strengths=strengths,
    )


def _strengths(space: StandardNormalSpace, ranking: InputRanking) -> dict[str, float]:
    """Strength of each input from those of the campaign's columns, several of which may belong to one input."""
    squares: dict[str, float] = {}
    for one in ranking.inputs:
        name = space.group_of(one.name)
        if name is not None:
            squares[name] = squares.get(name, 0.0) + one.spearman**2
    return {name: float(np.sqrt(square)) for name, square in squares.items()}
