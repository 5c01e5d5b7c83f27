"""Objective of tuning: a weighted sum of functions of the metrics of a batch of runs.

Errors and effort count by the mean of their logarithm: relative changes count alike, and a lost run weighs no more than
others. Weights are those of the scenario's section `tuning`.

A run without a value of a metric counts as the worst that a run can have. Left out, it would improve the objective
wherever its value was worse than the mean, and so it would with the worst value of the other runs, wherever it was the
worst of all itself. So each metric has a range in which its values are kept, and its worse end stands for no value:
whatever the value was before, the objective does not improve.
"""

from typing import Final

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from rpojax.errors import ScenarioError
from rpojax.scenario.schema import ScenarioFile

MetricArray = Float[Array, "runs metrics"]

PART_METRICS: Final = {
    "innovations": ("innovation_surprise",),
    "estimate": ("estimate_surprise",),
    "consistency": ("nees_mean", "nees_relative_mean"),
    "navigation": ("nav_relative_position_error_rms_m",),
    "formation": ("formation_error_rms_m",),
    "delta_v": ("delta_v_m_s",),
    "pointing": ("pointing_error_rms_deg",),
}
"""Metrics of each part of the objective."""

_RANGE: Final = {
    "innovations": (-1e3, 1e3),
    "estimate": (-1e3, 1e3),
    "navigation": (1e-9, 1e7),
    "formation": (1e-9, 1e7),
    "delta_v": (1e-3, 1e4),
    "pointing": (1e-3, 180.0),
    "pose_surprise": (-1e3, 1e3),
}
"""Least and greatest value of a run; the greatest are about the radius of an orbit [m], more than any propellant gives
[m/s], and the greatest angle [deg]."""
_OF_LIKELIHOOD: Final = ("innovations", "estimate", "pose_surprise")
"""Parts that are logarithms already, and of either sign."""
_RANGE_OF_ANY: Final = (1e-9, 1e9)
"""That of a metric with a weight of its own, in its unit."""
_LOST_NEES_RATIO: Final = 10.0
"""A run whose NEES exceeds the median by this factor lost its target; its NEES tells nothing of the filter's noises."""
_LOST_PENALTY: Final = (6.0, 18.0)
"""What a share of 1 of lost runs adds to the consistency: a number, and one for each logarithm that the others are off.

With d of the others, one more run at ten times their NEES would make d^2 to (d + log(1 + 9 f))^2, where f is its share:
by less than f (5.84 + 18 |d|). So no run gains from being lost.
"""
_WORST_NEES: Final = 1e6
"""NEES that counts where no run has one."""


def part_metrics(part: str) -> tuple[str, ...]:
    """Metrics of a part of the objective; a part that is a metric with a weight of its own consists of itself."""
    return PART_METRICS.get(part, (part,))


def weight_key(part: str) -> str:
    """Key of the weight of a part in a scenario."""
    return f"tuning.{part}" if part in PART_METRICS else f"tuning.metrics.{part}"


class Objective:
    """Weighted sum of parts, as a function of the metrics of a batch.

    Attributes:
        weights: by part, those that are not zero
        metric_names: of the required metrics
    """

    def __init__(self, file: ScenarioFile) -> None:
        parts = file.tuning.model_dump(exclude={"metrics"})
        self.weights = {name: weight for name, weight in parts.items() if weight > 0.0}
        self.weights |= {name: weight for name, weight in (file.tuning.metrics or {}).items() if weight != 0.0}
        if not self.weights:
            raise ScenarioError("tuning", "no weight above zero", f"a weight for one of {', '.join(PART_METRICS)}")
        self.metric_names = tuple(dict.fromkeys(name for part in self.weights for name in part_metrics(part)))
        self._value = jax.jit(self._total)
        self._gradient = jax.jit(jax.grad(lambda metrics, mask: self._total(metrics, mask)[0]))

    def __call__(self, metrics: np.ndarray) -> tuple[float, dict[str, float]]:
        """Value at the metrics (runs, metrics) of a batch, NaN where undefined, and its parts without their weights.

        Raises:
            ScenarioError: a metric with a weight of its own is negative, which has no logarithm.
        """
        for name, values in zip(self.metric_names, np.asarray(metrics).T, strict=True):
            if name in self.weights and name not in _OF_LIKELIHOOD and np.any(values < 0.0):
                expected = "0 or more in every run, since its logarithm counts"
                raise ScenarioError(weight_key(name), float(np.nanmin(values)), expected)
        value, parts = self._value(jnp.asarray(metrics), jnp.ones(len(metrics)))
        return float(value), {name: float(part) for name, part in parts.items()}

    def gradient(self, metrics: Array, mask: Array) -> Array:
        """Gradient (runs, metrics) of the value of a batch; runs outside the `mask` (runs,) do not count."""
        return self._gradient(metrics, mask)

    def undefined_runs(self, metrics: np.ndarray) -> dict[str, int]:
        """By part, how many runs of a batch (runs, metrics) have no value of it, and count as the worst."""
        missing = dict(zip(self.metric_names, ~np.isfinite(metrics).T, strict=True))
        by_part = {part: [missing[name] for name in part_metrics(part)] for part in self.weights}
        return {part: int(np.any(columns, axis=0).sum()) for part, columns in by_part.items()}

    def constant_parts(self, metrics: np.ndarray) -> list[str]:
        """One line for each part that no run of a batch (runs, metrics) has within its range: it has no gradient."""
        columns = dict(zip(self.metric_names, metrics.T, strict=True))
        lines = []
        for part in self.weights:
            if part == "consistency":
                continue
            name, (least, greatest) = part_metrics(part)[0], _RANGE.get(part, _RANGE_OF_ANY)
            values = columns[name][np.isfinite(columns[name])]
            if len(values) and np.all((values < least) | (values > greatest)):
                found = " to ".join(f"{value:g}" for value in dict.fromkeys((values.min(), values.max())))
                lines.append(
                    f"{weight_key(part)}: found {name} = {found} in all {len(values)} runs that have it, expected some "
                    f"between {least:g} and {greatest:g}, beyond which it counts as constant and has no gradient"
                )
        return lines

    def _total(self, metrics: MetricArray, mask: Array) -> tuple[Array, dict[str, Array]]:
        columns = dict(zip(self.metric_names, metrics.T, strict=True))
        parts = {name: _part(name, columns, mask, weight < 0.0) for name, weight in self.weights.items()}
        total = sum((weight * parts[name] for name, weight in self.weights.items()), jnp.zeros(()))
        return total, parts


def _part(name: str, columns: dict[str, Array], counted: Array, more_is_better: bool) -> Array:
    if name == "consistency":
        relative = columns["nees_relative_mean"]
        servicer = columns["nees_mean"] - relative
        return _nees_inconsistency(relative, counted) + _nees_inconsistency(servicer, counted)
    least, greatest = _RANGE.get(name, _RANGE_OF_ANY)
    values, is_defined = _defined(columns[part_metrics(name)[0]])
    values = jnp.where(is_defined, jnp.clip(values, least, greatest), least if more_is_better else greatest)
    return _masked_mean(values if name in _OF_LIKELIHOOD else jnp.log(values), counted)


def _defined(values: Float[Array, " runs"]) -> tuple[Array, Array]:
    """Values with 1 in place of non-finite numbers, which would spoil derivatives, and flags of the finite ones."""
    is_finite = jnp.isfinite(values)
    return jnp.where(is_finite, values, 1.0), is_finite


def _masked_mean(values: Array, counted: Array) -> Array:
    return jnp.sum(counted * values) / jnp.sum(counted)


def _nees_inconsistency(nees: Float[Array, " runs"], counted: Array) -> Array:
    """Squared log of the mean NEES of six components over six; a run without a NEES counts as lost."""
    values, is_defined = _defined(nees)
    counts = is_defined & (counted > 0.0)
    median = jnp.nanmedian(jnp.where(counts, values, jnp.nan))
    is_kept = counts & (values <= _LOST_NEES_RATIO * median)
    kept = jnp.where(jnp.any(is_kept), counted * jnp.where(is_kept, 1.0, 0.0), counted)
    off = jnp.log(_masked_mean(jnp.where(jnp.any(is_kept), values, _WORST_NEES), kept) / 6.0)
    lost = 1.0 - _masked_mean(jnp.where(is_kept, 1.0, 0.0), counted)
    constant, for_each_log = _LOST_PENALTY
    return off**2 + lost * (constant + for_each_log * jax.lax.stop_gradient(jnp.abs(off)))
