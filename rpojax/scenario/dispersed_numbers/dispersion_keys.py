"""Keys of a scenario that vary from run to run, and the order in which their values are computed."""

from collections.abc import Sequence
from typing import Any, Final

import numpy as np

from rpojax.dispersions.designs.design_sections import GridDesign, TableDesign
from rpojax.dispersions.kinds.derived import Derived
from rpojax.dispersions.kinds.dispersion_kind import DispersionKind, RandomKind
from rpojax.errors import ScenarioError
from rpojax.scenario.parameter_keys import ParameterKey, expand_vectors, nominal_value, parse_key
from rpojax.scenario.schema import ScenarioFile

_TEAM_SECTIONS: Final = frozenset(
    {"orbit", "atmosphere", "sunlight", "target", "target_surface", "link", "team", "gps_differences", "link_range"}
)
"""Sections whose values all servicers of a team have together."""
_KEYS_OF_PAIRS: Final = ("navigation.difference_", "gps.common_share")
"""Begins of the keys of differences of GPS positions in sections of a servicer."""


def assigned_keys(dispersion: DispersionKind) -> list[ParameterKey]:
    """Keys whose values a dispersion sets."""
    return [parse_key(text) for text in dispersion.key_texts]


def design_keys(file: ScenarioFile) -> list[str]:
    """Keys, or `KEY[i]`, whose values a table or grid design lists."""
    return list(file.design.values) if isinstance(file.design, TableDesign | GridDesign) else []


def varied_keys(file: ScenarioFile) -> list[str]:
    """Whole keys of all numbers that vary from run to run, by dispersions or by the design."""
    parameters = [parameter for dispersion in file.dispersions for parameter in assigned_keys(dispersion)]
    return list(dict.fromkeys(parameter.key for parameter in [*parameters, *map(parse_key, design_keys(file))]))


def is_of_team(parameter: ParameterKey) -> bool:
    """Whether a key is that of the world, or of what all servicers of a team have together."""
    return parameter.key.partition(".")[0] in _TEAM_SECTIONS or parameter.key.startswith(_KEYS_OF_PAIRS)


def is_common(dispersion: DispersionKind) -> bool:
    """Whether all servicers of a team have the same random numbers of a dispersion."""
    if dispersion.common is not None:
        return dispersion.common
    return all(is_of_team(parameter) for parameter in assigned_keys(dispersion))


def common_keys(file: ScenarioFile) -> frozenset[str]:
    """Whole keys that vary from run to run and have the same value for all servicers of a team."""
    return frozenset(key for key in varied_keys(file) if is_of_team(parse_key(key)))


def nominal_numbers(file: ScenarioFile, dispersion: DispersionKind) -> np.ndarray:
    """Nominal value of a dispersion's key, or the vector (n,) of the components of all keys of a joint one."""
    if dispersion.is_joint:
        components = expand_vectors(file, dispersion.key_texts)
        return np.array([nominal_value(file, component) for component in components], dtype=np.float64)
    return np.asarray(nominal_value(file, assigned_keys(dispersion)[0]), dtype=np.float64)


def assigned_parts(file: ScenarioFile, dispersion: DispersionKind, value: Any) -> list[tuple[ParameterKey, Any]]:
    """Keys with their parts of a value: one key with all of it, or each component of joint keys with its number."""
    if dispersion.is_joint:
        return list(zip(expand_vectors(file, dispersion.key_texts), value, strict=True))
    return [(assigned_keys(dispersion)[0], value)]


def coordinate_count(file: ScenarioFile, dispersion: DispersionKind) -> int:
    """Dimension of the unit cube from which a dispersion is sampled."""
    return dispersion.coordinate_count(nominal_numbers(file, dispersion))


def random_dispersions(file: ScenarioFile) -> list[RandomKind]:
    """Dispersions that draw their values."""
    return [entry for entry in file.dispersions if isinstance(entry, RandomKind)]


def evaluation_order(file: ScenarioFile) -> list[RandomKind | Derived]:
    """Dispersions sorted topologically: a derived one follows those that its terms refer to.

    Raises:
        ScenarioError: derived keys depend on each other in a cycle.
    """
    ready: list[RandomKind | Derived] = [*random_dispersions(file)]
    waiting = [entry for entry in file.dispersions if isinstance(entry, Derived)]
    while waiting:
        pending = [parse_key(entry.key) for entry in waiting]
        free = [entry for entry in waiting if not _depends_on_any(entry, pending)]
        if not free:
            raise ScenarioError("dispersions", [entry.key for entry in waiting], "derived keys that end in others")
        ready += free
        waiting = [entry for entry in waiting if entry not in free]
    return ready


def _depends_on_any(entry: Derived, parameters: Sequence[ParameterKey]) -> bool:
    return any(parse_key(term.key).overlaps(parameter) for term in entry.terms for parameter in parameters)
