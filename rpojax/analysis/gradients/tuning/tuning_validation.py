"""Validation of a tuned scenario against its start: paired comparison of the same unseen full runs, all metrics."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from rpojax.analysis.statistics import paired_comparison
from rpojax.analysis.statistics.paired_comparison import PairedComparison, RunMetrics
from rpojax.campaign.execution import block_runner
from rpojax.campaign.execution.batch_engine import BatchEngine, default_block_size
from rpojax.campaign.experiment_design import make_design
from rpojax.campaign.options.history_retention import Retention
from rpojax.core.pytree import concatenate
from rpojax.dispersions.designs.run_range import RunRange
from rpojax.flight.stages import Stages
from rpojax.runtime.device_programs import share_runs
from rpojax.scenario.schema import ScenarioFile
from rpojax.simulation.outcomes.outcome_kinds import of_codes

OnProgress = Callable[[float], None]
_RESAMPLES = 999
_METRICS = "metrics/"


@dataclass(frozen=True)
class MeanChange:
    """Mean of a metric over runs that have it in both settings, and 95 % intervals from resampled pairs."""

    first: float
    second: float
    first_95: tuple[float, float]
    second_95: tuple[float, float]
    ratio: float
    ratio_95: tuple[float, float]


@dataclass(frozen=True)
class Validation:
    """Paired comparison of two settings of a scenario.

    Attributes:
        seed: of the runs
        baseline: runs with the initial settings
        tuned: the same runs with the tuned ones
        medians: comparison of medians, failures and requirements
        means: comparison of means by metric
    """

    seed: int
    baseline: RunMetrics
    tuned: RunMetrics
    medians: PairedComparison
    means: dict[str, MeanChange]

    @property
    def undefined(self) -> dict[str, tuple[int, int]]:
        """Runs without a value with either setting, by metric that some do not have; means leave them out."""
        counts = {
            name: (int(np.isnan(values).sum()), int(np.isnan(self.tuned.metrics[name]).sum()))
            for name, values in self.baseline.metrics.items()
        }
        return {name: count for name, count in counts.items() if any(count)}


def validate(
    baseline: ScenarioFile,
    tuned: ScenarioFile,
    seed: int,
    runs: int,
    on_progress: OnProgress = lambda fraction: None,
    stages: Stages | None = None,
) -> Validation:
    """Simulates `runs` runs with both settings and compares them pair by pair."""
    one = simulate_runs(baseline, seed, runs, lambda fraction: on_progress(0.5 * fraction), stages)
    other = simulate_runs(tuned, seed, runs, lambda fraction: on_progress(0.5 + 0.5 * fraction), stages)
    medians = paired_comparison.compare_paired_runs(one, other, baseline.requirements, independent=True)
    return Validation(seed, one, other, medians, compare_means(one, other))


def simulate_runs(
    file: ScenarioFile,
    seed: int,
    runs: int,
    on_progress: OnProgress = lambda fraction: None,
    stages: Stages | None = None,
) -> RunMetrics:
    """Metrics of runs 0 to `runs` - 1 of a seed, simulated in memory."""
    devices, size = share_runs(runs, default_block_size(file))
    engine = BatchEngine(file, size, devices, stages, make_design(file, seed, RunRange(0, runs)))
    batches = -(-runs // engine.capacity)
    results = []
    for number in range(batches):
        ids = number * engine.capacity + np.arange(engine.capacity)

        def during(fraction: float, _: int, number: int = number) -> None:
            on_progress((number + fraction) / batches)

        block = block_runner.simulate_batch(engine, seed, ids, [], ids < runs, Retention.from_run_ids(()), during)
        results.append(block.block_arrays(slice(0, min(engine.capacity, runs - int(ids[0]))), engine))
    joined = concatenate(results)
    metrics = {name.removeprefix(_METRICS): values for name, values in joined.items() if name.startswith(_METRICS)}
    return RunMetrics(np.arange(runs), of_codes(joined["status/failure"]), metrics)


def compare_means(one: RunMetrics, other: RunMetrics) -> dict[str, MeanChange]:
    """Means by metric over the runs that have it in both settings.

    Left out where they give no ratio: a mean that may be zero or of either sign, as of correlations.
    """
    rng = np.random.default_rng(0)
    found = {}
    for name in one.metrics:
        pair = np.stack([one.metrics[name], other.metrics[name]]).astype(float)
        pair = pair[:, np.isfinite(pair).all(axis=0)]
        if pair.shape[1] < 2:
            continue
        drawn = rng.integers(pair.shape[1], size=(_RESAMPLES, pair.shape[1]))
        resampled = pair[:, drawn].mean(axis=2)
        first, second = map(float, pair.mean(axis=1))
        if resampled[0].min() <= 0.0 <= resampled[0].max():
            continue
        first_95, second_95, ratio_95 = map(_interval_95, (*resampled, resampled[1] / resampled[0]))
        found[name] = MeanChange(first, second, first_95, second_95, second / first, ratio_95)
    return found


def _interval_95(samples: np.ndarray) -> tuple[float, float]:
    low, high = np.quantile(samples, [0.025, 0.975])
    return float(low), float(high)
