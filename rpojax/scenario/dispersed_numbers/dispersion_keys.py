"""Keys of a scenario that vary from run to run, and the order in which their values are computed; free of JAX."""

from collections.abc import Sequence

import numpy as np

from rpojax.dispersions.designs.design_kinds import GridDesign, TableDesign
from rpojax.dispersions.dispersion_kinds import CorrelatedNormal, Derived, Dispersion
from rpojax.errors import ScenarioError
from rpojax.scenario.parameter_keys import ParameterKey, nominal_value, parse_key
from rpojax.scenario.schema import ScenarioFile

_COORDINATE_COUNTS = {"choice": 1, "direction": 2, "attitude": 3, "small_rotation": 3, "derived": 0}


def assigned_keys(dispersion: Dispersion) -> list[ParameterKey]:
    """Keys whose values a dispersion sets."""
    texts = dispersion.keys if isinstance(dispersion, CorrelatedNormal) else [dispersion.key]
    return [parse_key(text) for text in texts]


def dispersion_name(dispersion: Dispersion) -> str:
    """Unique name of a dispersion: its key, or its keys joined by `+`."""
    return "+".join(dispersion.keys) if isinstance(dispersion, CorrelatedNormal) else dispersion.key


def design_keys(file: ScenarioFile) -> list[str]:
    """Keys, or `KEY[i]`, whose values a table or grid design lists."""
    return list(file.design.values) if isinstance(file.design, TableDesign | GridDesign) else []


def varied_keys(file: ScenarioFile) -> list[str]:
    """Whole keys of all numbers that vary from run to run, by dispersions or by the design."""
    parameters = [parameter for dispersion in file.dispersions for parameter in assigned_keys(dispersion)]
    return list(dict.fromkeys(parameter.key for parameter in [*parameters, *map(parse_key, design_keys(file))]))


def coordinate_count(file: ScenarioFile, dispersion: Dispersion) -> int:
    """Dimension of the unit cube from which a dispersion is sampled."""
    if isinstance(dispersion, CorrelatedNormal):
        return len(dispersion.covariance)
    if dispersion.kind in _COORDINATE_COUNTS:
        return _COORDINATE_COUNTS[dispersion.kind]
    return np.size(nominal_value(file, parse_key(dispersion.key)))


def evaluation_order(file: ScenarioFile) -> list[Dispersion]:
    """Dispersions sorted topologically: a derived one follows those that its terms refer to.

    Raises:
        ScenarioError: derived keys depend on each other in a cycle.
    """
    ready: list[Dispersion] = [entry for entry in file.dispersions if not isinstance(entry, Derived)]
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
