"""Does a linear covariance agree with sampled runs? Ratios of standard deviations, with what sampling leaves open."""

import time
from collections.abc import Iterator
from dataclasses import dataclass

import jax
import numpy as np
from scipy.stats import chi2

from rpojax.analysis.linear_covariance.linear_covariance import LinearCovariance
from rpojax.campaign.execution.batch_engine import BatchEngine, Segment, default_block_size
from rpojax.dispersions import designs
from rpojax.dispersions.designs import RunRange
from rpojax.scenario.schema import ScenarioFile

CHANNELS = {"rho_H": ("x", "y", "z"), "relative_error_H": ("x", "y", "z"), "delta_v_m_s": ("",)}
"""What is compared, and its components."""
TOLERANCE = 0.15
"""A standard deviation this far off, beyond what sampling explains, is a disagreement."""
_EVERY_S = 10.0
_CONFIDENCE = 0.95


@dataclass(frozen=True)
class MonteCarloSample:
    """Sampled runs, decimated.

    Attributes:
        time_s: (times,)
        values: channel -> (times, runs, components) of the runs that completed
        runs: how many completed
        failed: how many did not
        run_s: flying them, compilation apart [s]
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
        """95 % confidence interval of the standard deviations if values are normal, from the chi-square law."""
        freedom = self.runs - 1
        low, high = chi2.ppf([0.5 + 0.5 * _CONFIDENCE, 0.5 - 0.5 * _CONFIDENCE], freedom)
        sigma = self.sigma(channel)
        return sigma * np.sqrt(freedom / low), sigma * np.sqrt(freedom / high)


@dataclass(frozen=True)
class ChannelAgreement:
    """One component of one channel, linear over sampled standard deviation.

    Attributes:
        channel: as `CHANNELS`
        component: axis of H
        median: ratio over all times
        least: ratio
        least_at_s: when
        largest: ratio
        largest_at_s: when
        rms: of the ratio less one
        within: share of the times at which the ratio is within 15 % of one
        disagrees: share of the times at which it is further off than 15 % and sampling together allow
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


def simulate_sample(file: ScenarioFile, runs: int, seed: int) -> MonteCarloSample:
    """Flies runs 0, 1, ... of a scenario and keeps what is compared, once in ten seconds."""
    planned = designs.make_design(file, seed, RunRange(0, runs))
    engine = BatchEngine(file, min(default_block_size(file), -(-runs // jax.device_count())), design=planned)
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
    values = {name: np.concatenate([block[name] for block in blocks], axis=1) for name in CHANNELS}
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
    parts: dict[str, list[np.ndarray]] = {name: [] for name in CHANNELS}
    failure = np.zeros(count)
    for segment in segments:
        ticks = segment.first_tick + np.arange(len(segment.channels["rho_H"]))
        for name, kept in parts.items():
            rows = segment.channels[name][ticks % step == 0][:, :count]
            kept.append(rows.reshape(len(rows), count, -1).astype(np.float64))
        failure = segment.failure[:count]
    return {name: np.concatenate(kept)[:, failure == 0] for name, kept in parts.items()}


def compare_with_sample(linear: LinearCovariance, sampled: MonteCarloSample) -> list[ChannelAgreement]:
    """Agreement of every component over the times that were sampled; what does not vary yet is left out."""
    rows = np.searchsorted(linear.time_s, sampled.time_s)
    found = []
    for channel, components in CHANNELS.items():
        sigma, mean = linear.sigma(channel)[rows], linear.output_mean(channel)[rows]
        own, centre = sampled.sigma(channel), np.mean(sampled.values[channel], axis=1)
        low, high = sampled.sigma_interval(channel)
        for index, component in enumerate(components):
            varies = own[:, index] > 1e-9 * max(own[:, index].max(), 1e-300)
            if not np.any(varies):
                continue
            at = sampled.time_s[varies]
            ratio = sigma[varies, index] / own[varies, index]
            too_small = sigma[varies, index] < (1.0 - TOLERANCE) * low[varies, index]
            too_large = sigma[varies, index] > (1.0 + TOLERANCE) * high[varies, index]
            off = np.abs(mean[varies, index] - centre[varies, index]) / own[varies, index]
            found.append(
                ChannelAgreement(
                    channel=channel,
                    component=component,
                    median=float(np.median(ratio)),
                    least=float(ratio.min()),
                    least_at_s=float(at[ratio.argmin()]),
                    largest=float(ratio.max()),
                    largest_at_s=float(at[ratio.argmax()]),
                    rms=float(np.sqrt(np.mean((ratio - 1.0) ** 2))),
                    within=float(np.mean(np.abs(ratio - 1.0) <= TOLERANCE)),
                    disagrees=float(np.mean(too_small | too_large)),
                    mean_off_sigmas=float(off.max()),
                )
            )
    return found
