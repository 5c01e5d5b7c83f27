"""Which numbers of a scenario change from run to run, and in which order they become known; free of jax."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from rpojax.errors import ScenarioError
from rpojax.scenario import schema
from rpojax.scenario.schema import Dispersion, ScenarioFile

_COMPONENT = re.compile(r"(.+)\[([0-9]{1,3})\]")
_COORDINATE_COUNTS = {"choice": 1, "direction": 2, "attitude": 3, "small_rotation": 3, "derived": 0}


@dataclass(frozen=True)
class ParameterKey:
    """A number or vector of a scenario, or one component of a vector.

    Attributes:
        key: such as `servicer.mass_kg`
        index: of the component; None for all that the key holds
    """

    key: str
    index: int | None

    def overlaps(self, other: "ParameterKey") -> bool:
        """Whether the two have a number in common."""
        return self.key == other.key and (self.index == other.index or None in (self.index, other.index))


def parse_key(text: str) -> ParameterKey:
    """Place that a text such as `servicer.mass_kg` or `formation.desired_position_m[1]` names."""
    component = _COMPONENT.fullmatch(text)
    return ParameterKey(component[1], int(component[2])) if component else ParameterKey(text, None)


def nominal_value(file: ScenarioFile, where: ParameterKey) -> Any:
    """Value at a place as numbers, or None if there is no dispersable number."""
    value = schema.nominal_value(file, where.key)
    if value is None or where.index is None:
        return value
    return value[where.index] if np.ndim(value) == 1 and where.index < len(value) else None


def component_columns(values: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Every number (runs,) of values (runs, ...) by key: a vector gives a column per component, `key[0]`, `key[1]`."""
    found: dict[str, np.ndarray] = {}
    for key, rows in values.items():
        parts = rows.reshape(len(rows), -1).T
        names = [key] if rows.ndim == 1 else [f"{key}[{index}]" for index in range(len(parts))]
        found.update(zip(names, parts, strict=True))
    return found


def expand_vectors(file: ScenarioFile, texts: Sequence[str]) -> list[ParameterKey]:
    """Places of single numbers, where a vector stands for its components."""
    found: list[ParameterKey] = []
    for text in texts:
        whole = parse_key(text)
        count = np.size(nominal_value(file, whole)) if np.ndim(nominal_value(file, whole)) else None
        found += [whole] if count is None else [ParameterKey(whole.key, index) for index in range(count)]
    return found


def assigned_keys(dispersion: Dispersion) -> list[ParameterKey]:
    """Places that a dispersion gives values to."""
    texts = dispersion.keys if isinstance(dispersion, schema.CorrelatedNormal) else [dispersion.key]
    return [parse_key(text) for text in texts]


def dispersion_name(dispersion: Dispersion) -> str:
    """What tells a dispersion from the others: its key, or keys."""
    return "+".join(dispersion.keys) if isinstance(dispersion, schema.CorrelatedNormal) else dispersion.key


def design_keys(file: ScenarioFile) -> list[str]:
    """Keys, and components of keys, that the design itself gives values to."""
    return list(file.design.values) if isinstance(file.design, schema.TableDesign | schema.GridDesign) else []


def varied_keys(file: ScenarioFile) -> list[str]:
    """Keys of all numbers that change from run to run, components left out."""
    places = [where for dispersion in file.dispersions for where in assigned_keys(dispersion)]
    return list(dict.fromkeys(where.key for where in [*places, *map(parse_key, design_keys(file))]))


def coordinate_count(file: ScenarioFile, dispersion: Dispersion) -> int:
    """How many numbers from 0 to 1 a dispersion is made from."""
    if isinstance(dispersion, schema.CorrelatedNormal):
        return len(dispersion.covariance)
    if dispersion.kind in _COORDINATE_COUNTS:
        return _COORDINATE_COUNTS[dispersion.kind]
    return np.size(nominal_value(file, parse_key(dispersion.key)))


def design_bytes(file: ScenarioFile, runs: int) -> int:
    """Memory that the design of so many runs takes [B]."""
    if isinstance(file.design, schema.LatinHypercubeDesign | schema.SobolDesign):
        count = sum(coordinate_count(file, entry) for entry in file.dispersions)
    else:
        count = sum(np.size(nominal_value(file, parse_key(text))) for text in design_keys(file))
    return 8 * runs * count


def evaluation_order(file: ScenarioFile) -> list[Dispersion]:
    """Dispersions as they can be worked out: derived ones come after what they need.

    Raises:
        ScenarioError: derived keys that need one another.
    """
    ready: list[Dispersion] = [entry for entry in file.dispersions if not isinstance(entry, schema.Derived)]
    waiting = [entry for entry in file.dispersions if isinstance(entry, schema.Derived)]
    while waiting:
        open_places = [parse_key(entry.key) for entry in waiting]
        free = [entry for entry in waiting if not _depends_on_any(entry, open_places)]
        if not free:
            raise ScenarioError("dispersions", [entry.key for entry in waiting], "derived keys that end in others")
        ready += free
        waiting = [entry for entry in waiting if entry not in free]
    return ready


def _depends_on_any(entry: schema.Derived, places: Sequence[ParameterKey]) -> bool:
    return any(parse_key(term.key).overlaps(where) for term in entry.terms for where in places)
