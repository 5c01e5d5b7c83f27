"""Declared marginal distribution of every dispersed number, and goodness-of-fit tests of the drawn values."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

import numpy as np
from scipy.stats import chisquare, kstest, lognorm, norm, semicircular, truncnorm, uniform

from rpojax.physics import equipment_faults
from rpojax.scenario.parameter_keys import component_columns, parse_key

_AXES = "xyz"


@runtime_checkable
class Distribution(Protocol):
    """Probability distribution of one number."""

    def cdf(self, x: np.ndarray) -> np.ndarray:
        """Probability of at most `x` (n,)."""
        ...

    def mean(self) -> float:
        """Mean."""
        ...

    def std(self) -> float:
        """Standard deviation."""
        ...


@dataclass(frozen=True)
class DiscreteDistribution:
    """Discrete distribution over distinct `values` in ascending order, with their `probabilities`."""

    values: np.ndarray
    probabilities: np.ndarray

    def cdf(self, x: np.ndarray) -> np.ndarray:
        """Probability of at most `x` (n,)."""
        return np.concatenate([[0.0], np.cumsum(self.probabilities)])[np.searchsorted(self.values, x, side="right")]

    def mean(self) -> float:
        """Mean."""
        return float(self.probabilities @ self.values)

    def std(self) -> float:
        """Standard deviation."""
        return float(np.sqrt(self.probabilities @ np.square(self.values - self.mean())))


@dataclass(frozen=True)
class Marginal:
    """A dispersed number as drawn.

    Attributes:
        name: its key; with the component in brackets for a vector, or the axis of rotation for a rotated quaternion
        values: (runs,) in the unit of the key; [deg] of a rotation
        distribution: as declared; None where the scenario declares none, or a constant
    """

    name: str
    values: np.ndarray
    distribution: Distribution | None


def drawn_marginals(scenario: Mapping[str, Any], drawn: Mapping[str, np.ndarray]) -> list[Marginal]:
    """Marginals of `drawn` values (runs,) or (runs, k) by key, with their distributions by the tables of a scenario."""
    distributions: dict[str, Distribution] = {}
    rotations: dict[str, list[Distribution | None]] = {}
    for entry in scenario.get("dispersions") or []:
        if entry["kind"] == "small_rotation":
            rotations[entry["key"]] = _normal_distributions(np.zeros(3), entry["sigma_deg"])
        else:
            distributions |= _declared_distributions(scenario, entry)
    for name in scenario.get("design", {}).get("values", {}):
        distributions = {
            key: distribution
            for key, distribution in distributions.items()
            if key.partition("[")[0] != name.partition("[")[0]
        }
    found: list[Marginal] = []
    for key, values in drawn.items():
        rows = np.asarray(values, dtype=np.float64)
        if key in rotations:
            turns = _rotation_vectors_deg(rows, np.asarray(declared_nominal(scenario, key), dtype=np.float64))
            named = zip(_AXES, turns.T, rotations[key], strict=True)
            found += [Marginal(f"{key}[about {axis}, deg]", turn, distribution) for axis, turn, distribution in named]
        else:
            columns = component_columns({key: rows})
            found += [Marginal(name, column, distributions.get(name)) for name, column in columns.items()]
    return found


def goodness_of_fit_p(values: np.ndarray, distribution: Distribution) -> float:
    """P-value of independent `values` (n,) under a distribution: Kolmogorov-Smirnov, or Pearson's if it is discrete."""
    if not isinstance(distribution, DiscreteDistribution):
        return float(np.asarray(kstest(values, distribution.cdf))[1])
    counts = np.array([np.sum(values == value) for value in distribution.values])
    if counts.sum() < len(values):
        return 0.0
    return float(np.asarray(chisquare(counts, distribution.probabilities * len(values)))[1]) if len(counts) > 1 else 1.0


def declared_nominal(scenario: Mapping[str, Any], key: str) -> Any:
    """Value of a key, or of one component such as `a.b[1]`, in the tables of a scenario; None if there is none."""
    place = parse_key(key)
    value: Any = scenario
    for part in place.key.split("."):
        value = value.get(part) if isinstance(value, Mapping) else None
    if place.index is not None:
        return value[place.index] if isinstance(value, list) and place.index < len(value) else None
    return equipment_faults.kind_code(value) if key == "fault.kind" else value


def _declared_distributions(scenario: Mapping[str, Any], entry: Mapping[str, Any]) -> dict[str, Distribution]:
    """Distributions by the names of the single numbers that an entry disperses."""
    if entry["kind"] == "correlated_normal":
        names = [name for key in entry["keys"] for name in _component_names(scenario, key)]
        means = np.array([declared_nominal(scenario, name) for name in names], dtype=np.float64)
        distributions = _normal_distributions(means, np.sqrt(np.diag(np.array(entry["covariance"], dtype=np.float64))))
    else:
        names = _component_names(scenario, entry["key"])
        distributions = _distributions_of_kind(
            entry, np.array([declared_nominal(scenario, name) for name in names], dtype=np.float64)
        )
    return {
        name: distribution for name, distribution in zip(names, distributions, strict=True) if distribution is not None
    }


def _component_names(scenario: Mapping[str, Any], key: str) -> list[str]:
    value = declared_nominal(scenario, key)
    return [f"{key}[{index}]" for index in range(len(value))] if isinstance(value, list) else [key]


def _distributions_of_kind(entry: Mapping[str, Any], means: np.ndarray) -> list[Distribution | None]:
    match entry["kind"]:
        case "normal":
            return _normal_distributions(means, entry["sigma"])
        case "truncated_normal":
            limit = entry["limit_sigmas"]
            sigmas = np.broadcast_to(entry["sigma"], means.shape)
            return [
                truncnorm(-limit, limit, loc=mean, scale=sigma) if sigma > 0.0 and np.isfinite(mean) else None
                for mean, sigma in zip(means, sigmas, strict=True)
            ]
        case "uniform":
            width = entry["high"] - entry["low"]
            return [uniform(entry["low"], width) if width > 0.0 else None] * len(means)
        case "log_normal":
            sigmas = np.broadcast_to(entry["sigma"], means.shape)
            return [
                lognorm(sigma, scale=mean) if sigma > 0.0 and mean > 0.0 else None
                for mean, sigma in zip(means, sigmas, strict=True)
            ]
        case "choice":
            columns = np.array([equipment_faults.kind_code(value) for value in entry["values"]], dtype=np.float64)
            return [_discrete_distribution(column) for column in columns.reshape(len(columns), -1).T]
        case "direction":
            # Archimedes: each coordinate of a point on the sphere is uniform.
            return [uniform(-1.0, 2.0)] * len(means)
        case "attitude":
            # On the sphere in four dimensions the density of a coordinate x is proportional to sqrt(1 - x^2).
            return [semicircular()] * len(means)
        case _:
            return [None] * len(means)


def _normal_distributions(means: np.ndarray, sigma: Any) -> list[Distribution | None]:
    sigmas = np.broadcast_to(np.asarray(sigma, dtype=np.float64), means.shape)
    return [
        norm(mean, one) if one > 0.0 and np.isfinite(mean) else None for mean, one in zip(means, sigmas, strict=True)
    ]


def _discrete_distribution(column: np.ndarray) -> Distribution:
    values, counts = np.unique(column, return_counts=True)
    return DiscreteDistribution(values, counts / len(column))


def _rotation_vectors_deg(quaternions: np.ndarray, start: np.ndarray) -> np.ndarray:
    """Rotation vectors (n, 3) [deg] that turn the quaternion `start` (4,) into each of `quaternions` (n, 4)."""
    w, x, y, z = start / np.linalg.norm(start)
    # Matrix of p -> p q* for the conjugate of q = (w, x, y, z).
    back = np.array([[w, x, y, z], [-x, w, -z, y], [-y, z, w, -x], [-z, -y, x, w]])
    turn = quaternions @ back.T
    turn = np.where(turn[:, :1] < 0.0, -turn, turn)
    size = np.linalg.norm(turn[:, 1:], axis=1, keepdims=True)
    angle = 2.0 * np.arctan2(size, turn[:, :1])
    return np.degrees(turn[:, 1:] * np.divide(angle, size, out=np.full_like(size, 2.0), where=size > 0.0))
