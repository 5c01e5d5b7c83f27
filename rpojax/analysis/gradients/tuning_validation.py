"""Two settings of one scenario on the same runs, which tuning has never seen: full runs, all metrics."""

from collections.abc import Callable
from dataclasses import dataclass

import jax
import numpy as np

from rpojax.analysis.statistics import campaign_comparison
from rpojax.analysis.statistics.campaign_comparison import Comparison, Runs
from rpojax.campaign.execution import block_runner
from rpojax.campaign.execution.batch_engine import Engine, block_size
from rpojax.campaign.history_retention import Retention
from rpojax.dispersions.designs import Population, make
from rpojax.scenario.schema import ScenarioFile

Watch = Callable[[float], None]
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
class Judgement:
    """Two settings compared.

    Attributes:
        seed: of the runs
        first: runs with the settings to start from
        second: the same runs with the new ones
        medians: paired comparison of medians, failures and requirements
        means: paired comparison of means by metric
    """

    seed: int
    first: Runs
    second: Runs
    medians: Comparison
    means: dict[str, MeanChange]


def judge(
    first: ScenarioFile, second: ScenarioFile, seed: int, runs: int, watch: Watch = lambda share: None
) -> Judgement:
    """Flies `runs` runs with both settings and compares them pair by pair."""
    one = fly(first, seed, runs, lambda share: watch(0.5 * share))
    other = fly(second, seed, runs, lambda share: watch(0.5 + 0.5 * share))
    medians = campaign_comparison.compare(one, other, first.requirements, independent=True)
    return Judgement(seed, one, other, medians, means(one, other))


def fly(file: ScenarioFile, seed: int, runs: int, watch: Watch = lambda share: None) -> Runs:
    """Metrics of runs, in memory."""
    devices = jax.devices()[:runs]
    size = min(block_size(file), -(-runs // len(devices)))
    engine = Engine(file, size, devices, design=make(file, seed, Population(0, runs)))
    batches = -(-runs // engine.capacity)
    results = []
    for number in range(batches):
        ids = number * engine.capacity + np.arange(engine.capacity)

        def during(share: float, _: int, number: int = number) -> None:
            watch((number + share) / batches)

        flown = block_runner.fly(engine, seed, ids, [], ids < runs, Retention.of_runs(()), during)
        results.append(flown.results(slice(0, min(engine.capacity, runs - int(ids[0]))), engine))
    joined = {name: np.concatenate([part[name] for part in results]) for name in results[0]}
    metrics = {name.removeprefix(_METRICS): values for name, values in joined.items() if name.startswith(_METRICS)}
    return Runs(np.arange(runs), joined["status/failure"] == 0, metrics)


def means(one: Runs, other: Runs) -> dict[str, MeanChange]:
    """Means by metric over the runs that have it in both settings; left out where they give no ratio."""
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
        if first == 0.0 or (resampled[0] == 0.0).any():
            continue
        first_95, second_95, ratio_95 = map(_middle, (*resampled, resampled[1] / resampled[0]))
        found[name] = MeanChange(first, second, first_95, second_95, second / first, ratio_95)
    return found


def _middle(samples: np.ndarray) -> tuple[float, float]:
    low, high = np.quantile(samples, [0.025, 0.975])
    return float(low), float(high)
