"""Declared marginal distribution of every dispersed number, and goodness-of-fit tests of the drawn values."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.stats import chisquare, kstest

from rpojax.dispersions.kinds.registry import recorded_dispersion
from rpojax.dispersions.marginal_distribution import DiscreteDistribution, Distribution
from rpojax.physics import equipment_faults
from rpojax.physics.plant_options import is_fault_kind
from rpojax.scenario.parameter_keys import component_columns, parse_key


@dataclass(frozen=True)
class Marginal:
    """A dispersed number as drawn.

    Attributes:
        name: its key; with the component in brackets for a vector, or the axis of rotation for a rotated quaternion
        values: (runs,) in the unit of the key, in degrees for a rotation
        distribution: as declared; None where the scenario declares none, or a constant
    """

    name: str
    values: np.ndarray
    distribution: Distribution | None


def drawn_marginals(scenario: Mapping[str, Any], drawn: Mapping[str, np.ndarray]) -> list[Marginal]:
    """Marginals of `drawn` values (runs,) or (runs, k) by key, with the distributions that a scenario declares."""
    distributions: dict[str, Distribution | None] = {}
    shown: dict[str, dict[str, np.ndarray]] = {}
    entries = [recorded_dispersion(table) for table in scenario.get("dispersions") or []]
    for entry in entries:
        if entry is None or drawn.keys().isdisjoint(parse_key(text).key for text in entry.key_texts):
            continue
        names, nominal = _nominal_components(scenario, entry.key_texts)
        if entry.name in drawn and (columns := entry.shown_numbers(drawn[entry.name], nominal)):
            shown[entry.name] = {f"{entry.name}{suffix}": column for suffix, column in columns.items()}
            names = list(shown[entry.name])
        distributions |= dict(zip(names, entry.marginals(nominal), strict=True))
    assigned = {parse_key(text).key for text in scenario.get("design", {}).get("values", {})}
    return [
        Marginal(name, column, None if key in assigned else distributions.get(name))
        for key, values in drawn.items()
        for name, column in (shown.get(key) or component_columns({key: np.asarray(values, dtype=np.float64)})).items()
    ]


def _nominal_components(scenario: Mapping[str, Any], texts: Sequence[str]) -> tuple[list[str], np.ndarray]:
    """Names and nominal numbers (n,) of the components of keys, NaN where a scenario has none."""
    names: list[str] = []
    numbers: list[np.ndarray] = []
    for text in texts:
        value = np.array(declared_nominal(scenario, text), dtype=np.float64)
        names += [f"{text}[{index}]" for index in range(value.size)] if value.ndim else [text]
        numbers.append(value.ravel())
    return names, np.concatenate(numbers)


def goodness_of_fit_p(values: np.ndarray, distribution: Distribution) -> float:
    """P-value of independent `values` (n,) under a distribution: Kolmogorov-Smirnov, or Pearson's if it is discrete."""
    if not isinstance(distribution, DiscreteDistribution):
        return float(np.asarray(kstest(values, distribution.cdf))[1])
    counts = np.array([np.sum(values == value) for value in distribution.values])
    if counts.sum() < len(values):
        return 0.0
    return float(np.asarray(chisquare(counts, distribution.probabilities * len(values)))[1]) if len(counts) > 1 else 1.0


def _inner(value: Any, part: str) -> Any:
    """What a table has under a name, or the table of that name in a list."""
    if isinstance(value, list):
        return next((each for each in value if isinstance(each, Mapping) and each.get("name") == part), None)
    return value.get(part) if isinstance(value, Mapping) else None


def declared_nominal(scenario: Mapping[str, Any], key: str) -> Any:
    """Value of a key, or of a component such as `a.b[1]`, in the tables of a scenario; None if it is absent."""
    place = parse_key(key)
    value: Any = scenario
    for part in place.key.split("."):
        value = _inner(value, part)
    if place.index is not None:
        return value[place.index] if isinstance(value, list) and place.index < len(value) else None
    return equipment_faults.kind_code(value) if is_fault_kind(key) else value
