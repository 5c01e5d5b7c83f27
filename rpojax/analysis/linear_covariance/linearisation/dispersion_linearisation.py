"""Linearisation of dispersions for a linear covariance: mean, and change per sigma of standard normal inputs."""

from dataclasses import dataclass

import numpy as np

from rpojax.analysis.linear_covariance.linearisation import target_outline_ensemble
from rpojax.analysis.linear_covariance.linearisation.deviation_vector import Path
from rpojax.dispersions.kinds.derived import Derived
from rpojax.dispersions.kinds.dispersion_kind import RandomKind
from rpojax.errors import RpojaxError
from rpojax.scenario import params as parameters
from rpojax.scenario.dispersed_numbers import dispersion_keys
from rpojax.scenario.parameter_keys import ParameterKey, nominal_value, parse_key
from rpojax.scenario.schema import ScenarioFile

_AT_START = ("initial", "orbit")
"""Sections of initial conditions, without effect on the rest of a run."""
_WIDEST_DEG = 10.0
"""Widest dispersion of an orbit's angle with a useful derivative: it turns everything [deg]."""


@dataclass(frozen=True)
class LinearisedDispersions:
    """Dispersed numbers as a mean and independent standard normal inputs.

    Attributes:
        mean: by key, in the user's units
        columns: by source and key, the change (size, inputs) per sigma of each input
        left_out: names of dispersions that are too wide for a derivative
    """

    mean: dict[str, np.ndarray]
    columns: dict[str, dict[str, np.ndarray]]
    left_out: list[str]

    def constant_paths(self) -> tuple[Path, ...]:
        """Paths in `Params` of the numbers that are constant in a run and act on it."""
        return tuple(parameters.leaf_path_and_factor(key)[0] for key in self.mean if key.split(".")[0] not in _AT_START)


def linearise_dispersions(file: ScenarioFile) -> LinearisedDispersions:
    """Mean and columns of all dispersions with small deviations; those of the tumble are left to the ensemble.

    Raises:
        RpojaxError: a dispersion without mean and variance, or values that a table or grid gives.
    """
    if dispersion_keys.design_keys(file):
        raise RpojaxError(f"design.kind: found {file.design.kind!r}, expected draws from distributions")
    mean: dict[str, np.ndarray] = {}
    columns: dict[str, dict[str, np.ndarray]] = {}
    left_out: list[str] = []
    for entry in dispersion_keys.evaluation_order(file):
        if entry.name in target_outline_ensemble.KEYS:
            continue
        if isinstance(entry, Derived):
            _derive(file, mean, columns, entry)
            continue
        centre, change = entry.linearise(dispersion_keys.nominal_numbers(file, entry))
        if _is_wide_angle(entry, change):
            left_out.append(entry.name)
            continue
        columns[entry.name] = {}
        rows = dispersion_keys.assigned_parts(file, entry, change)
        for (where, part), (_, own) in zip(dispersion_keys.assigned_parts(file, entry, centre), rows, strict=True):
            _enter(file, mean, where, np.asarray(part))
            _add_change(file, columns[entry.name], where, np.atleast_2d(own))
    return LinearisedDispersions(mean, columns, left_out)


def _is_wide_angle(entry: RandomKind, change: np.ndarray) -> bool:
    """Whether an angle of the orbit is dispersed too widely."""
    keys = [parameter.key for parameter in dispersion_keys.assigned_keys(entry)]
    angles = any(key.startswith("orbit.") and key.endswith("_deg") for key in keys)
    return angles and not entry.is_joint and bool(np.max(change) > _WIDEST_DEG)


def _derive(
    file: ScenarioFile, mean: dict[str, np.ndarray], columns: dict[str, dict[str, np.ndarray]], entry: Derived
) -> None:
    """Adds the mean and columns of a number that is a function of others."""
    where, terms = parse_key(entry.key), [parse_key(term.key) for term in entry.terms]
    shape = np.shape(nominal_value(file, where))
    _enter(file, mean, where, np.asarray(entry.value(shape, [_part(_mean_of(file, mean, key), key) for key in terms])))
    for change in columns.values():
        rows = [np.atleast_2d(_part(change[key.key], key)) if key.key in change else None for key in terms]
        own = entry.change(int(np.prod(shape)), rows)
        if own is not None:
            _add_change(file, change, where, own)


def _part(whole: np.ndarray, where: ParameterKey) -> np.ndarray:
    return whole if where.index is None else np.asarray(whole[where.index])


def _mean_of(file: ScenarioFile, mean: dict[str, np.ndarray], where: ParameterKey) -> np.ndarray:
    """Mean of a whole key, nominal if nothing has set it."""
    whole = ParameterKey(where.key, None)
    return mean.get(where.key, np.asarray(nominal_value(file, whole), dtype=float))


def _enter(file: ScenarioFile, mean: dict[str, np.ndarray], where: ParameterKey, value: np.ndarray) -> None:
    if where.index is not None:
        whole = _mean_of(file, mean, where).copy()
        whole[where.index] = value
        value = whole
    mean[where.key] = value


def _add_change(file: ScenarioFile, changes: dict[str, np.ndarray], where: ParameterKey, change: np.ndarray) -> None:
    """Adds the columns of a key, or of one component of it, to those of its source by key."""
    if where.index is not None:
        size = np.size(nominal_value(file, ParameterKey(where.key, None)))
        rows = np.zeros((size, change.shape[1]))
        rows[where.index] = change
        change = rows
    changes[where.key] = changes[where.key] + change if where.key in changes else change
