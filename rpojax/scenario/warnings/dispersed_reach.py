"""Ends of what the numbers of a scenario reach over its runs, by dispersions and by a table or grid.

Normal errors have no ends; what they reach beyond the bounds of the schema is warned of.
"""

import numpy as np

from rpojax.dispersions.designs.design_sections import GridDesign, TableDesign
from rpojax.dispersions.kinds.choice import Choice
from rpojax.dispersions.kinds.derived import Derived
from rpojax.dispersions.listed_values import listed_ends
from rpojax.errors import ScenarioError
from rpojax.physics.plant_options import is_category
from rpojax.scenario.dispersed_numbers.assigned_value_checks import check_acceptable
from rpojax.scenario.dispersed_numbers.dispersion_keys import (
    assigned_keys,
    assigned_parts,
    evaluation_order,
    nominal_numbers,
)
from rpojax.scenario.parameter_keys import ParameterKey, nominal_of_key, parse_key
from rpojax.scenario.schema import ScenarioFile


class DispersedReach:
    """Least and greatest value of each number of a scenario over nearly all runs."""

    def __init__(self, file: ScenarioFile) -> None:
        self._file = file
        self._ends: dict[str, np.ndarray] = {}
        if isinstance(file.design, TableDesign | GridDesign):
            for text, values in file.design.values.items():
                self._set(parse_key(text), listed_ends(values, np.asarray(self.ends(text)[0])))
        for entry in evaluation_order(file):
            if isinstance(entry, Derived):
                self._set(parse_key(entry.key), self._derived(entry))
                continue
            ends = entry.reach(nominal_numbers(file, entry))
            # Components of joint keys come first, as assigned values have them.
            for parameter, part in assigned_parts(file, entry, np.moveaxis(ends, 0, -1)):
                self._set(parameter, np.moveaxis(part, -1, 0))

    @property
    def fault_kinds(self) -> set[str]:
        """Kinds of fault that the runs may have."""
        return {kind for fault in self._file.faults for kind in self.kinds_of(fault.name)}

    def kinds_of(self, fault: str) -> set[str]:
        """Kinds that the fault of a name may be of."""
        key, design = f"faults.{fault}.kind", self._file.design
        if isinstance(design, TableDesign | GridDesign) and key in design.values:
            return {str(kind) for kind in design.values[key]}
        drawn = [entry.values for entry in self._file.dispersions if isinstance(entry, Choice) and entry.key == key]
        nominal = [each.kind for each in self._file.faults if each.name == fault]
        return {str(kind) for kind in (drawn[-1] if drawn else nominal)}

    def ends(self, text: str) -> np.ndarray:
        """(2, ...) least and greatest value of a key, or of a component of one, by component."""
        parameter = parse_key(text)
        nominal = np.asarray(nominal_of_key(self._file, parameter.key), dtype=np.float64)
        found = self._ends.get(parameter.key, np.stack([nominal, nominal]))
        return found if parameter.index is None else found[:, parameter.index]

    def low(self, key: str) -> float:
        """Least value of the key of a number."""
        return float(self.ends(key)[0])

    def high(self, key: str) -> float:
        """Greatest value of the key of a number."""
        return float(self.ends(key)[1])

    def middle(self, key: str) -> np.ndarray:
        """Value (...) half-way between the ends."""
        return np.asarray(self.ends(key).mean(axis=0))

    def norms(self, key: str) -> tuple[float, float]:
        """Least and greatest length of a vector between its ends."""
        low, high = self.ends(key)
        nearest, farthest = np.clip(0.0, low, high), np.maximum(np.abs(low), np.abs(high))
        return float(np.linalg.norm(nearest)), float(np.linalg.norm(farthest))

    def axis_extremes(self, *keys: str) -> np.ndarray:
        """(2 n + 1, n) values of the vectors of keys, joined: the middle, and each component alone at both ends."""
        low, high = np.concatenate([self.ends(key).reshape(2, -1) for key in keys], axis=1)
        middle, half = 0.5 * (low + high), np.diag(0.5 * (high - low))
        return np.concatenate([middle[None, :], middle + half, middle - half])

    def _set(self, parameter: ParameterKey, ends: np.ndarray) -> None:
        if parameter.index is None:
            self._ends[parameter.key] = ends
        else:
            whole = self.ends(parameter.key).copy()
            whole[:, parameter.index] = ends
            self._ends[parameter.key] = whole

    def _derived(self, entry: Derived) -> np.ndarray:
        shape = nominal_numbers(self._file, entry).shape
        inputs = [self.ends(term.key)[:: 1 if term.factor > 0.0 else -1] for term in entry.terms]
        return np.stack([np.asarray(entry.value(shape, [ends[side] for ends in inputs])) for side in (0, 1)])


def bound_warnings(file: ScenarioFile, reach: DispersedReach) -> list[str]:
    """One line for each dispersed number that three sigma lead to where it cannot be, such as a negative mass."""
    found = []
    for index, dispersion in enumerate(file.dispersions):
        for text, parameter in zip(dispersion.key_texts, assigned_keys(dispersion), strict=True):
            if is_category(text):
                continue
            errors = []
            for value in reach.ends(text):
                try:
                    check_acceptable(
                        file, f"dispersions.{index}", parameter, value.tolist(), False, np.round(value, 9).tolist()
                    )
                except ScenarioError as error:
                    errors.append(error)
            if errors:
                share = "some runs are" if len(errors) == 1 else "nearly every run is"
                found.append(f"{errors[0]}; {share} simulated with such a value")
    return found
