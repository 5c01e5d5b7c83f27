"""Objective of tuning: a weighted sum of functions of the metrics of a batch of runs.

Errors and effort count by the mean of their logarithm: relative changes count alike, and a lost run weighs no more than
others. Weights are those of the scenario's section `tuning`.
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

_LOST_NEES_RATIO = 10.0
"""A run whose NEES exceeds the median by this factor lost its target, and does not count for consistency."""
_FLOOR: Final = {"delta_v": 1e-3, "pointing": 1e-3}
"""Values below these count as these [m/s, deg]."""


_SMALLEST: Final = 1e-9
"""Values of a metric with a weight of its own below this one count as this one, in its unit."""


def part_metrics(part: str) -> tuple[str, ...]:
    """Metrics of a part of the objective; a part that is a metric with a weight of its own consists of itself."""
    return PART_METRICS.get(part, (part,))


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

    def __call__(self, metrics: np.ndarray) -> tuple[float, dict[str, float]]:
        """Value at the metrics (runs, metrics) of a batch, and its parts without their weights."""
        value, parts = self._value(jnp.asarray(metrics), jnp.ones(len(metrics)))
        return float(value), {name: float(part) for name, part in parts.items()}

    def gradient(self, metrics: Array, weights: Array, mask: Array) -> Array:
        """Gradient (runs, metrics) of the value of a batch; runs outside the `mask` (runs,) do not count."""
        del weights
        return jax.grad(lambda x: self._total(x, mask)[0])(metrics)

    def _total(self, metrics: MetricArray, mask: Array) -> tuple[Array, dict[str, Array]]:
        finite = jnp.all(jnp.isfinite(metrics), axis=1)
        counted = mask * jnp.where(finite, 1.0, 0.0)
        safe = jnp.where(finite[:, None], metrics, 1.0)
        columns = {name: safe[:, index] for index, name in enumerate(self.metric_names)}
        parts = {name: _part(name, columns, counted) for name in self.weights}
        total = sum((weight * parts[name] for name, weight in self.weights.items()), jnp.zeros(()))
        return total, parts


def _part(name: str, columns: dict[str, Array], counted: Array) -> Array:
    if name == "consistency":
        relative = columns["nees_relative_mean"]
        servicer = columns["nees_mean"] - relative
        return _nees_inconsistency(relative, counted) + _nees_inconsistency(servicer, counted)
    values = columns[part_metrics(name)[0]]
    if name in ("innovations", "estimate"):
        return _masked_mean(values, counted)
    return _masked_mean(
        jnp.log(jnp.maximum(values, _FLOOR.get(name, 0.0 if name in PART_METRICS else _SMALLEST))), counted
    )


def _masked_mean(values: Array, counted: Array) -> Array:
    return jnp.sum(counted * values) / jnp.sum(counted)


def _nees_inconsistency(nees: Float[Array, " runs"], counted: Array) -> Array:
    """Squared log of the mean NEES of six components over six, lost runs left out."""
    median = jnp.nanmedian(jnp.where(counted > 0.0, nees, jnp.nan))
    kept = counted * jnp.where(nees <= _LOST_NEES_RATIO * median, 1.0, 0.0)
    return jnp.log(_masked_mean(nees, kept) / 6.0) ** 2
