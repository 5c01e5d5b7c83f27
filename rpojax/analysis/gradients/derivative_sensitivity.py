"""Derivative-based sensitivity: which dispersions make the spread of a metric, from derivatives of a few runs.

The mean square of a metric's derivative to a standard normal variable is the variance that the variable gives a linear
metric, and an upper bound of its total effect on any smooth one (Sobol and Kucherenko, Math. Comput. Simul. 79, 2009;
Lamboni et al., 87, 2013: the Poincare constant of a standard normal variable is one). Where a metric is rough that
bound is far off. The mean derivative is that of the metric smoothed over all runs (Stein's identity: the gradient of a
linear regression through them), so inputs are ranked by it. Neither sees a jump, or the effect of sensor noise.
"""

import dataclasses
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rpojax.analysis.gradients.rollout_evaluator import RolloutEvaluator, RolloutResult
from rpojax.analysis.statistics.campaign_comparison import changed_keys
from rpojax.analysis.statistics.dependence import MIN_RUNS as MIN_RANKED_RUNS
from rpojax.analysis.statistics.dependence import InputRanking, rank_inputs, spearman
from rpojax.analysis.statistics.intervals import deviation_interval, shrunk_mean
from rpojax.analysis.statistics.paired_comparison import requirement_name
from rpojax.campaign.storage.atomic_outputs import check_replaceable, to_json_types, write_json
from rpojax.campaign.storage.campaign_folder import Campaign
from rpojax.errors import Notice, RpojaxError
from rpojax.optional_packages import require_package
from rpojax.runtime.progress import stage
from rpojax.scenario.dispersed_numbers import standard_normal_space
from rpojax.scenario.dispersed_numbers.standard_normal_space import StandardNormalSpace
from rpojax.scenario.parameter_keys import component_columns
from rpojax.scenario.plugins import plugin_registry
from rpojax.scenario.scenario_digest import scenario_digest
from rpojax.scenario.schema import ScenarioFile
from rpojax.scenario.team.members import refuse_team
from rpojax.simulation.noise import run_keys

if TYPE_CHECKING:
    import pandas

LEADING = 5
"""Number of inputs that count as leading."""
MIN_RUNS = 2
_FAR_ABOVE = 3.0
"""Times the upper limit of a metric's own spread; derivatives beyond are of ripples and not of the metric."""
_KINKS = {
    "min": "the least value over time: its derivative jumps where another instant becomes the least",
    "max": "the greatest value over time: its derivative jumps where another instant becomes the greatest",
    "total": "a sum of burns, decided on in steps: the derivative of a smoothed decision stands in for the jump",
}

_OF_NO_RUN = ("name", "description", "requirements", "tuning", "start", "format_version", "plugin")
"""Parts of a scenario that change nothing in a run."""
_MOST_KEYS = 3

_STEPS = "a number of steps, or moved by noise alone: its derivative is 0 although its values differ"


@dataclass(frozen=True)
class InputShare:
    """Contribution of one input to the spread of a metric, in the metric's unit.

    Attributes:
        name: a dispersed number, or a dispersion whose numbers belong together
        sigma: root mean square over runs of the derivative to the input's standard normal variables
        trend: shrunk size of its mean: the contribution of a linear regression through all runs
        nominal: size of the derivative at the median run alone
        one_run: greatest share of a single run in the mean square; near 1 an event, not a trend, is behind it
    """

    name: str
    sigma: float
    trend: float
    nominal: float
    one_run: float


@dataclass(frozen=True)
class MetricSensitivity:
    """Contributions of the dispersions to the spread of one metric.

    Attributes:
        metric: its name
        unit: of the metric and of all sigmas
        shares: of all inputs, those with the greatest trend first, and of those without one the greatest sigma
        sigma: standard deviation by all of them, were the metric linear
        values: (runs,) of the metric in the runs with random dispersions that reached their end and have it
        undefined: runs that reached their end without a value or a finite derivative of it
        kink: why the derivative jumps, or is 0 between the jumps; None where it is right
    """

    metric: str
    unit: str
    shares: tuple[InputShare, ...]
    sigma: float
    values: np.ndarray
    undefined: int
    kink: str | None

    @property
    def std(self) -> float:
        """Standard deviation of the metric in the runs, noise included."""
        return float(np.std(self.values, ddof=1))

    @property
    def exceeds_spread(self) -> bool:
        """Whether `sigma` is more than three times what the values allow of the metric's spread, at 99 %."""
        return self.sigma > _FAR_ABOVE * deviation_interval(self.std, len(self.values), 0.99)[1]

    @property
    def leading(self) -> tuple[str, ...]:
        """Names of the inputs that make most of the spread."""
        return tuple(share.name for share in self.shares[:LEADING] if share.trend > 0.0)


@dataclass(frozen=True)
class RankingAgreement:
    """Agreement of a ranking by derivatives with one by sampling.

    Attributes:
        runs: of the campaign that have the metric
        std: of the metric there, noise included
        leading: by sampling
        both: leading by derivatives, too
        rank_correlation: Spearman's, of both orders over all inputs; None where an order does not vary
        strengths: by input, the root of the sum of its squared rank correlations
    """

    runs: int
    std: float
    leading: tuple[str, ...]
    both: tuple[str, ...]
    rank_correlation: float | None
    strengths: dict[str, float]


@dataclass(frozen=True)
class SensitivityAnalysis:
    """Sensitivities of the metrics of a scenario.

    Attributes:
        space: standard normal variables of the scenario
        seed: of the runs
        runs: with random dispersions
        metrics: sensitivities, one a metric
        agreements: with a campaign, one a metric; None without a campaign that can be ranked
        unranked: why a given campaign ranks no input, one a metric; None where it does, or without a campaign
    """

    space: StandardNormalSpace
    seed: int
    runs: int
    metrics: tuple[MetricSensitivity, ...]
    agreements: tuple[RankingAgreement | None, ...]
    unranked: tuple[str | None, ...]

    def to_dict(self) -> dict[str, Any]:
        """Content of the JSON file, in the types of JSON."""
        each = zip(self.metrics, self.agreements, self.unranked, strict=True)
        entries = [{**_entry(found, sampled), "unranked": reason} for found, sampled, reason in each]
        return to_json_types(
            {
                "scenario": self.space.file.name,
                "seed": self.seed,
                "runs": self.runs,
                "held": list(self.space.unmapped),
                "metrics": entries,
            }
        )

    def to_dataframe(self) -> "pandas.DataFrame":
        """One row for each metric and input: `metric`, `unit`, and what `InputShare` holds.

        Raises:
            MissingExtraError: pandas is not installed.
        """
        rows = [
            {"metric": found.metric, "unit": found.unit, "input": share.name}
            | {name: getattr(share, name) for name in ("sigma", "trend", "nominal", "one_run")}
            for found in self.metrics
            for share in found.shares
        ]
        return require_package("pandas").DataFrame(rows)

    def write(self, path: Path | str, force: bool = False) -> None:
        """Writes the JSON file.

        Raises:
            OutputError: the file exists and is not to be replaced by `force`, or cannot be written.
        """
        path = Path(path)
        check_replaceable((path,), force)
        write_json(path, self.to_dict())


def sensitivity(
    file: ScenarioFile,
    metrics: Sequence[str] = (),
    *,
    runs: int = 16,
    campaign: Campaign | None = None,
    seed: int = 0,
    progress: bool = True,
) -> SensitivityAnalysis:
    """Contributions of the dispersions to the spread of metrics, from derivatives of `runs` runs and the median run.

    Args:
        file: scenario with dispersions
        metrics: names of metrics with a derivative; by default those of the scenario's requirements
        runs: with random dispersions
        campaign: finished campaign to compare the ranking with
        seed: master seed of the runs
        progress: show progress on stderr

    Raises:
        RpojaxError: a metric has no derivative, nothing can be moved, too few runs complete, or the campaign is of
            another scenario.
    """
    refuse_team(file, "derivatives of runs")
    if campaign is not None:
        check_same_scenario(file, campaign.directory, campaign.info)
    names, space = select_metrics(file, metrics), standard_normal_space.make_space(file)
    with stage("simulating with derivatives (compiling takes a minute or two)", quiet=not progress):
        found = derivative_sensitivities(space, names, runs, seed)
    agreements = tuple(None if campaign is None else _campaign_agreement(one, space, campaign) for one in found)
    unranked = tuple(
        _why_unranked(one.metric, campaign) if campaign is not None and other is None else None
        for one, other in zip(found, agreements, strict=True)
    )
    return SensitivityAnalysis(space, seed, runs, found, agreements, unranked)


def check_same_scenario(file: ScenarioFile, directory: Path, info: Mapping[str, Any]) -> None:
    """Refuses a campaign of other runs than those of a scenario, whatever its seed and the number of its runs.

    Args:
        file: the scenario
        directory: of the campaign
        info: of the campaign, with its scenario

    Raises:
        RpojaxError: naming keys that differ.
    """
    if scenario_digest(file) == info["scenario_hash"]:
        return
    changes = changed_keys(info["scenario"], to_json_types(file.model_dump(mode="json")))
    keys = [change.key for change in changes if change.key.partition(".")[0] not in _OF_NO_RUN]
    if keys:
        more = "" if len(keys) <= _MOST_KEYS else f" and {len(keys) - _MOST_KEYS} more"
        found = f"{directory}, of another scenario: {', '.join(keys[:_MOST_KEYS])}{more} differ"
        raise RpojaxError.of_argument("campaign", f"found {found}, expected one of {file.name}")


def select_metrics(file: ScenarioFile, names: Sequence[str]) -> tuple[str, ...]:
    """Metrics by name, or those of the scenario's requirements on whole runs that have a derivative.

    Other requirements give a `Notice`.

    Raises:
        RpojaxError: a metric has no derivative, or there is none.
    """
    known = [name for name, metric in plugin_registry.catalogue_of(file).items() if metric.has_derivative]
    for name in names:
        if name not in known:
            expected = f"a metric with a derivative: {', '.join(known)}"
            raise RpojaxError.of_argument("metrics", f"found {name!r}, expected {expected}")
    required = [] if names else file.requirements
    usable = [requirement for requirement in required if requirement.is_of_all_runs and requirement.metric in known]
    chosen = names or [each.metric for each in usable]
    if not chosen:
        raise RpojaxError.of_argument(
            "metrics", "found none, expected one, for a scenario without requirements on such metrics"
        )
    left_out = [each for each in required if each not in usable]
    if left_out:
        listed = ", ".join(dict.fromkeys(map(requirement_name, left_out)))
        reason = "they have no derivative, or are not of all whole runs"
        warnings.warn(f"warning: requirements left out, since {reason}: {listed}", Notice, stacklevel=3)
    return tuple(dict.fromkeys(chosen))


def derivative_sensitivities(
    space: StandardNormalSpace, metrics: Sequence[str], runs: int, seed: int, evaluator: RolloutEvaluator | None = None
) -> tuple[MetricSensitivity, ...]:
    """Sensitivities of metrics over `runs` runs with random dispersions, and at the median run.

    Raises:
        RpojaxError: too few runs, or too few of them reach their end with a value of a metric.
    """
    if runs < MIN_RUNS:
        raise RpojaxError.of_argument("runs", f"found {runs}, expected at least {MIN_RUNS}")
    used = evaluator or RolloutEvaluator(space.file, space.values_at, space.dimension, metrics, runs=runs + 1)
    drawn = np.random.default_rng([seed, 0xD15]).normal(size=(runs, space.dimension))
    points = np.concatenate([np.zeros((1, space.dimension)), drawn])
    found = used.jacobian(points, run_keys(seed, np.arange(runs + 1)))
    assert found.jacobian is not None
    return tuple(_metric_sensitivity(space, name, found, index) for index, name in enumerate(metrics))


def _metric_sensitivity(space: StandardNormalSpace, name: str, found: RolloutResult, index: int) -> MetricSensitivity:
    """Sensitivity of the metric in column `index`, from metrics and Jacobian of the median run and the other runs.

    Raises:
        RpojaxError: too few runs reach their end with a value of it.
    """
    assert found.jacobian is not None
    metric = plugin_registry.catalogue_of(space.file)[name]
    values, jacobian = found.metrics[:, index], found.jacobian[:, index]
    usable = ~found.failed & np.isfinite(values) & np.isfinite(jacobian).all(axis=1)
    rows, undefined = np.flatnonzero(usable[1:]) + 1, int((~found.failed & ~usable)[1:].sum())
    if len(rows) < MIN_RUNS:
        without = f", and {undefined} more without a value or derivative of {name}" if undefined else ""
        raise RpojaxError.of_argument(
            "runs", f"found {len(rows)} that reached their end{without}, expected at least {MIN_RUNS}"
        )
    gradients, at_median = jacobian[rows], jacobian[0] if usable[0] else np.full(jacobian.shape[1], np.nan)
    groups = np.array(space.groups)
    shares = []
    for group in dict.fromkeys(space.groups):
        squares = np.sum(gradients[:, groups == group] ** 2, axis=1)
        trend = float(np.linalg.norm(shrunk_mean(gradients[:, groups == group])))
        total = float(squares.sum())
        nominal = float(np.linalg.norm(at_median[groups == group]))
        one_run = float(squares.max()) / total if total > 0.0 else 0.0
        shares.append(InputShare(group, float(np.sqrt(squares.mean())), trend, nominal, one_run))
    return MetricSensitivity(
        metric=name,
        unit=metric.unit,
        shares=tuple(sorted(shares, key=lambda share: (-share.trend, -share.sigma))),
        sigma=float(np.sqrt(np.mean(np.sum(gradients**2, axis=1)))),
        values=values[rows],
        undefined=undefined,
        kink=_STEPS if not gradients.any() and np.ptp(values[rows]) > 0.0 else _KINKS.get(str(metric.reduction)),
    )


def compare_with_sampling(
    found: MetricSensitivity, space: StandardNormalSpace, columns: Mapping[str, np.ndarray], values: np.ndarray
) -> RankingAgreement | None:
    """Agreement with the ranking of a campaign's dispersed numbers (runs,) by name and its metric `values` (runs,).

    None where nothing can be ranked.
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


def _campaign_agreement(
    found: MetricSensitivity, space: StandardNormalSpace, campaign: Campaign
) -> RankingAgreement | None:
    if found.metric not in campaign.metrics:
        return None
    columns = {name: column for name, column in component_columns(campaign.drawn).items() if np.isfinite(column).all()}
    return compare_with_sampling(found, space, columns, campaign.metrics[found.metric])


def _why_unranked(metric: str, campaign: Campaign) -> str:
    if metric not in campaign.metrics:
        return f"{campaign.directory} has no {metric}"
    values = campaign.metrics[metric]
    defined = values[np.isfinite(values)]
    if len(defined) < MIN_RANKED_RUNS:
        return f"{len(defined)} runs of {campaign.directory} have {metric}, and a ranking needs {MIN_RANKED_RUNS}"
    return f"{metric} or the dispersions of all {len(defined)} runs of {campaign.directory} are equal"


def _strengths(space: StandardNormalSpace, ranking: InputRanking) -> dict[str, float]:
    """Strength of each input: root of the summed squares over the campaign's columns that belong to it."""
    squares: dict[str, float] = {}
    for one in ranking.inputs:
        name = space.group_of(one.name)
        if name is not None:
            squares[name] = squares.get(name, 0.0) + one.spearman**2
    return {name: float(np.sqrt(square)) for name, square in squares.items()}


def _entry(found: MetricSensitivity, agreement: RankingAgreement | None) -> dict[str, Any]:
    """Part of the JSON about one metric."""
    return {
        "metric": found.metric,
        "unit": found.unit,
        "runs_used": len(found.values),
        "undefined": found.undefined,
        "mean": float(np.mean(found.values)),
        "sigma_by_dispersions": found.sigma,
        "std": found.std,
        "exceeds_spread": found.exceeds_spread,
        "leading": list(found.leading),
        "kink": found.kink,
        "inputs": [dataclasses.asdict(share) for share in found.shares],
        "sampling": None if agreement is None else dataclasses.asdict(agreement),
    }
