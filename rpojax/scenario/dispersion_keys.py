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
_FIXED_COORDINATES = {"choice": 1, "direction": 2, "attitude": 3, "small_rotation": 3, "derived": 0}


@dataclass(frozen=True)
class Place:
    """A number or vector of a scenario, or one component of a vector.

    Attributes:
        key: such as `servicer.mass_kg`
        index: of the component; None for all that the key holds
    """

    key: str
    index: int | None

    def overlaps(self, other: "Place") -> bool:
        """Whether the two have a number in common."""
        return self.key == other.key and (self.index == other.index or None in (self.index, other.index))


def place(text: str) -> Place:
    """Place that a text such as `servicer.mass_kg` or `formation.desired_position_m[1]` names."""
    component = _COMPONENT.fullmatch(text)
    return Place(component[1], int(component[2])) if component else Place(text, None)


def nominal(file: ScenarioFile, where: Place) -> Any:
    """Value at a place as numbers, or None if there is no dispersable number."""
    value = schema.nominal(file, where.key)
    if value is None or where.index is None:
        return value
    return value[where.index] if np.ndim(value) == 1 and where.index < len(value) else None


def columns(values: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Every number (runs,) of values (runs, ...) by key: a vector gives a column per component, `key[0]`, `key[1]`."""
    found: dict[str, np.ndarray] = {}
    for key, rows in values.items():
        parts = rows.reshape(len(rows), -1).T
        names = [key] if rows.ndim == 1 else [f"{key}[{index}]" for index in range(len(parts))]
        found.update(zip(names, parts, strict=True))
    return found


def components(file: ScenarioFile, texts: Sequence[str]) -> list[Place]:
    """Places of single numbers, where a vector stands for its components."""
    found: list[Place] = []
    for text in texts:
        whole = place(text)
        count = np.size(nominal(file, whole)) if np.ndim(nominal(file, whole)) else None
        found += [whole] if count is None else [Place(whole.key, index) for index in range(count)]
    return found


def written(dispersion: Dispersion) -> list[Place]:
    """Places that a dispersion gives values to."""
    texts = dispersion.keys if isinstance(dispersion, schema.CorrelatedNormal) else [dispersion.key]
    return [place(text) for text in texts]


def name(dispersion: Dispersion) -> str:
    """What tells a dispersion from the others: its key, or keys."""
    return "+".join(dispersion.keys) if isinstance(dispersion, schema.CorrelatedNormal) else dispersion.key


def tabled(file: ScenarioFile) -> list[str]:
    """Keys, and components of keys, that the design itself gives values to."""
    return list(file.design.values) if isinstance(file.design, schema.TableDesign | schema.GridDesign) else []


def keys(file: ScenarioFile) -> list[str]:
    """Keys of all numbers that change from run to run, components left out."""
    places = [where for dispersion in file.dispersions for where in written(dispersion)]
    return list(dict.fromkeys(where.key for where in [*places, *map(place, tabled(file))]))


def coordinates(file: ScenarioFile, dispersion: Dispersion) -> int:
    """How many numbers from 0 to 1 a dispersion is made from."""
    if isinstance(dispersion, schema.CorrelatedNormal):
        return len(dispersion.covariance)
    if dispersion.kind in _FIXED_COORDINATES:
        return _FIXED_COORDINATES[dispersion.kind]
    return np.size(nominal(file, place(dispersion.key)))


def design_bytes(file: ScenarioFile, runs: int) -> int:
    """Memory that the design of so many runs takes [B]."""
    if isinstance(file.design, schema.LatinHypercubeDesign | schema.SobolDesign):
        count = sum(coordinates(file, entry) for entry in file.dispersions)
    else:
        count = sum(np.size(nominal(file, place(text))) for text in tabled(file))
    return 8 * runs * count


def in_order(file: ScenarioFile) -> list[Dispersion]:
    """Dispersions as they can be worked out: derived ones come after what they need.

    Raises:
        ScenarioError: derived keys that need one another.
    """
    ready: list[Dispersion] = [entry for entry in file.dispersions if not isinstance(entry, schema.Derived)]
    waiting = [entry for entry in file.dispersions if isinstance(entry, schema.Derived)]
    while waiting:
        open_places = [place(entry.key) for entry in waiting]
        free = [entry for entry in waiting if not _needs(entry, open_places)]
        if not free:
            raise ScenarioError("dispersions", [entry.key for entry in waiting], "derived keys that end in others")
        ready += free
        waiting = [entry for entry in waiting if entry not in free]
    return ready


def _needs(entry: schema.Derived, places: Sequence[Place]) -> bool:
    return any(place(term.key).overlaps(where) for term in entry.terms for where in places)
