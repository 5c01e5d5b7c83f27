"""Agreement of a linear covariance with sampled runs: ratios of standard deviations, and their sampling error."""

import time
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2

from rpojax.analysis.linear_covariance.covariance_propagation import LinearCovariance
from rpojax.campaign import experiment_design
from rpojax.campaign.execution.batch_engine import BatchEngine, Segment, default_block_size
from rpojax.core.pytree import concatenate
from rpojax.dispersions.designs.run_range import RunRange
from rpojax.flight.stages import Stages
from rpojax.runtime.programs_per_device import share_runs
from rpojax.scenario.schema import ScenarioFile

CHANNELS = {"rho_H": ("x", "y", "z"), "relative_error_H": ("x", "y", "z"), "delta_v_m_s": ("",)}
"""Compared channels and their components."""
TOLERANCE = 0.15
"""Relative error of a standard deviation that counts as a disagreement, beyond the sampling error."""
_EVERY_S = 10.0
_CONFIDENCE = 0.95


@dataclass(frozen=True)
class MonteCarloSample:
    """Sampled runs, decimated in time.

    Attributes:
        time_s: (times,)
        values: channel -> (times, runs, components) of the runs that completed
        runs: number that completed
        failed: number that did not
        run_s: simulating them, without compilation [s]
    """

    time_s: np.ndarray
    values: dict[str, np.ndarray]
    runs: int
    failed: int
    run_s: float

    def sigma(self, channel: str) -> np.ndarray:
        """Standard deviations (times, components)."""
        return np.std(self.values[channel], axis=1, ddof=1)

    def sigma_interval(self, channel: str) -> tuple[np.ndarray, np.ndarray]:
        """95 % confidence interval of the standard deviations of normal values, from the chi-square distribution."""
        freedom = self.runs - 1
        low, high = chi2.ppf([0.5 + 0.5 * _CONFIDENCE, 0.5 - 0.5 * _CONFIDENCE], freedom)
        sigma = self.sigma(channel)
        return sigma * np.sqrt(freedom / low), sigma * np.sqrt(freedom / high)


@dataclass(frozen=True)
class ChannelAgreement:
    """Ratios of linear to sampled standard deviation for one component of a channel.

    Attributes:
        channel: as `CHANNELS`
        component: axis of H
        median: over all times
        least: over all times
        least_at_s: time of it [s]
        largest: over all times
        largest_at_s: time of it [s]
        rms: of the ratio less one
        within: fraction of the times with a ratio within 15 % of one
        disagrees: fraction of the times with an error beyond 15 % and the sampling error together
        mean_off_sigmas: largest difference of the means over the sampled standard deviation
    """

    channel: str
    component: str
    median: float
    least: float
    least_at_s: float
    largest: float
    largest_at_s: float
    rms: float
    within: float
    disagrees: float
    mean_off_sigmas: float


def simulate_sample(file: ScenarioFile, runs: int, seed: int, stages: Stages | None = None) -> MonteCarloSample:
    """Simulates runs 0 to `runs` - 1 of a scenario and keeps the compared channels, once in ten seconds."""
    design = experiment_design.make_design(file, seed, RunRange(0, runs))
    devices, size = share_runs(runs, default_block_size(file))
    engine = BatchEngine(file, size, devices, stages, design)
    engine.compile()
    step = max(1, round(_EVERY_S / engine.scenario.tick_s))
    begin = time.perf_counter()
    blocks = [
        _collect(
            engine.simulate(engine.prepare(seed, first + np.arange(engine.capacity))),
            step,
            min(runs - first, engine.capacity),
        )
        for first in range(0, runs, engine.capacity)
    ]
    values = concatenate(blocks, axis=1)
    count = values["rho_H"].shape[1]
    return MonteCarloSample(
        time_s=np.arange(0, engine.scenario.ticks, step) * engine.scenario.tick_s,
        values=values,
        runs=count,
        failed=runs - count,
        run_s=time.perf_counter() - begin,
    )


def _collect(segments: Iterator[Segment], step: int, count: int) -> dict[str, np.ndarray]:
    """Channels of the first `count` runs of a block that completed."""
    parts: list[dict[str, np.ndarray]] = []
    failure = np.zeros(count)
    for segment in segments:
        ticks = segment.first_tick + np.arange(len(segment.channels["rho_H"]))
        chosen = {name: segment.channels[name][ticks % step == 0][:, :count] for name in CHANNELS}
        parts.append({name: rows.reshape(len(rows), count, -1).astype(float) for name, rows in chosen.items()})
        failure = segment.failure[:count]
    return {name: rows[:, failure == 0] for name, rows in concatenate(parts).items()}


def compare_with_sample(linear: LinearCovariance, sampled: MonteCarloSample) -> list[ChannelAgreement]:
    """Agreement of every component over the sampled times; times without variation are left out."""
    rows = np.searchsorted(linear.time_s, sampled.time_s)
    found = []
    for channel, components in CHANNELS.items():
        sigma, mean = linear.sigma(channel)[rows], linear.output_mean(channel)[rows]
        sampled_sigma, sampled_mean = sampled.sigma(channel), np.mean(sampled.values[channel], axis=1)
        low, high = sampled.sigma_interval(channel)
        for index, component in enumerate(components):
            own = sampled_sigma[:, index]
            varies = own > 1e-9 * max(own.max(), 1e-300)
            if not np.any(varies):
                continue
            too_small = sigma[varies, index] < (1.0 - TOLERANCE) * low[varies, index]
            too_large = sigma[varies, index] > (1.0 + TOLERANCE) * high[varies, index]
            offset = np.abs(mean[varies, index] - sampled_mean[varies, index]) / own[varies]
            ratio = sigma[varies, index] / own[varies]
            found.append(_agreement(channel, component, sampled.time_s[varies], ratio, too_small | too_large, offset))
    return found


def _agreement(
    channel: str, component: str, time_s: np.ndarray, ratio: np.ndarray, disagrees: np.ndarray, offset: np.ndarray
) -> ChannelAgreement:
    return ChannelAgreement(
        channel=channel,
        component=component,
        median=float(np.median(ratio)),
        least=float(ratio.min()),
        least_at_s=float(time_s[ratio.argmin()]),
        largest=float(ratio.max()),
        largest_at_s=float(time_s[ratio.argmax()]),
        rms=float(np.sqrt(np.mean((ratio - 1.0) ** 2))),
        within=float(np.mean(np.abs(ratio - 1.0) <= TOLERANCE)),
        disagrees=float(np.mean(disagrees)),
        mean_off_sigmas=float(offset.max()),
    )
