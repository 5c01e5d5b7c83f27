"""What a scenario declares of the numbers that it disperses, one by one, and whether drawn values follow it."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

import numpy as np
from scipy.stats import chisquare, kstest, lognorm, norm, semicircular, truncnorm, uniform

from rpojax.physics import equipment_faults
from rpojax.scenario import dispersion_keys

_AXES = "xyz"


@runtime_checkable
class Distribution(Protocol):
    """Distribution of one number."""

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
    """One of several `values`, sorted and distinct, with their `shares`."""

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
        name: its key; with the component in brackets for a vector, or the axis of rotation for a turned quaternion
        values: (runs,) in the unit of the key; [deg] of a rotation
        law: as declared; None where the scenario declares none, or a constant
    """

    name: str
    values: np.ndarray
    distribution: Distribution | None


def drawn_marginals(scenario: Mapping[str, Any], drawn: Mapping[str, np.ndarray]) -> list[Marginal]:
    """Every dispersed number of `drawn` (runs,) or (runs, k) by key, with its law by the tables of a scenario."""
    laws: dict[str, Distribution] = {}
    turned: dict[str, list[Distribution | None]] = {}
    for entry in scenario.get("dispersions") or []:
        if entry["kind"] == "small_rotation":
            turned[entry["key"]] = _normals(np.zeros(3), entry["sigma_deg"])
        else:
            laws |= _laws(scenario, entry)
    for name in scenario.get("design", {}).get("values", {}):
        laws = {key: law for key, law in laws.items() if key.partition("[")[0] != name.partition("[")[0]}
    found: list[Marginal] = []
    for key, values in drawn.items():
        rows = np.asarray(values, dtype=np.float64)
        if key in turned:
            turns = _rotations_deg(rows, np.asarray(declared_nominal(scenario, key), dtype=np.float64))
            named = zip(_AXES, turns.T, turned[key], strict=True)
            found += [Marginal(f"{key}[about {axis}, deg]", turn, law) for axis, turn, law in named]
        else:
            columns = dispersion_keys.component_columns({key: rows})
            found += [Marginal(name, column, laws.get(name)) for name, column in columns.items()]
    return found


def goodness_of_fit_p(values: np.ndarray, law: Distribution) -> float:
    """P-value of independent `values` (n,) under a law: Kolmogorov and Smirnov's, or Pearson's for a choice."""
    if not isinstance(law, DiscreteDistribution):
        return float(np.asarray(kstest(values, law.cdf))[1])
    counts = np.array([np.sum(values == value) for value in law.values])
    if counts.sum() < len(values):
        return 0.0
    return float(np.asarray(chisquare(counts, law.probabilities * len(values)))[1]) if len(counts) > 1 else 1.0


def declared_nominal(scenario: Mapping[str, Any], key: str) -> Any:
    """Value of a key, or of one component such as `a.b[1]`, in the tables of a scenario; None if there is none."""
    place = dispersion_keys.parse_key(key)
    value: Any = scenario
    for part in place.key.split("."):
        value = value.get(part) if isinstance(value, Mapping) else None
    if place.index is not None:
        return value[place.index] if isinstance(value, list) and place.index < len(value) else None
    return equipment_faults.kind_code(value) if key == "fault.kind" else value


def _laws(scenario: Mapping[str, Any], entry: Mapping[str, Any]) -> dict[str, Distribution]:
    """Laws by the names of the single numbers that an entry disperses."""
    if entry["kind"] == "correlated_normal":
        names = [name for key in entry["keys"] for name in _names(scenario, key)]
        means = np.array([declared_nominal(scenario, name) for name in names], dtype=np.float64)
        laws = _normals(means, np.sqrt(np.diag(np.array(entry["covariance"], dtype=np.float64))))
    else:
        names = _names(scenario, entry["key"])
        laws = _of_kind(entry, np.array([declared_nominal(scenario, name) for name in names], dtype=np.float64))
    return {name: law for name, law in zip(names, laws, strict=True) if law is not None}


def _names(scenario: Mapping[str, Any], key: str) -> list[str]:
    value = declared_nominal(scenario, key)
    return [f"{key}[{index}]" for index in range(len(value))] if isinstance(value, list) else [key]


def _of_kind(entry: Mapping[str, Any], means: np.ndarray) -> list[Distribution | None]:
    match entry["kind"]:
        case "normal":
            return _normals(means, entry["sigma"])
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
            return [_choice(column) for column in columns.reshape(len(columns), -1).T]
        case "direction":
            # Archimedes: each coordinate of a point on the sphere is uniform.
            return [uniform(-1.0, 2.0)] * len(means)
        case "attitude":
            # On the sphere in four dimensions the density of a coordinate x is proportional to sqrt(1 - x^2).
            return [semicircular()] * len(means)
        case _:
            return [None] * len(means)


def _normals(means: np.ndarray, sigma: Any) -> list[Distribution | None]:
    sigmas = np.broadcast_to(np.asarray(sigma, dtype=np.float64), means.shape)
    return [
        norm(mean, one) if one > 0.0 and np.isfinite(mean) else None for mean, one in zip(means, sigmas, strict=True)
    ]


def _choice(column: np.ndarray) -> Distribution:
    values, counts = np.unique(column, return_counts=True)
    return DiscreteDistribution(values, counts / len(column))


def _rotations_deg(quaternions: np.ndarray, start: np.ndarray) -> np.ndarray:
    """Rotation vectors (n, 3) [deg] that turn the quaternion `start` (4,) into each of `quaternions` (n, 4)."""
    w, x, y, z = start / np.linalg.norm(start)
    # Matrix of p -> p q* for the conjugate of q = (w, x, y, z).
    back = np.array([[w, x, y, z], [-x, w, -z, y], [-y, z, w, -x], [-z, -y, x, w]])
    turn = quaternions @ back.T
    turn = np.where(turn[:, :1] < 0.0, -turn, turn)
    size = np.linalg.norm(turn[:, 1:], axis=1, keepdims=True)
    angle = 2.0 * np.arctan2(size, turn[:, :1])
    return np.degrees(turn[:, 1:] * np.divide(angle, size, out=np.full_like(size, 2.0), where=size > 0.0))
