"""Checks of the dispersions of a scenario: keys that exist and are assigned once, settings that fit them."""

import numpy as np

from rpojax.dispersions.kinds.derived import Derived
from rpojax.dispersions.kinds.dispersion_kind import DispersionKind
from rpojax.errors import ScenarioError
from rpojax.physics.plant_options import is_category
from rpojax.scenario.dispersed_numbers.assigned_value_checks import check_acceptable, check_key_exists
from rpojax.scenario.dispersed_numbers.dispersion_keys import assigned_keys, evaluation_order, nominal_numbers
from rpojax.scenario.parameter_keys import ParameterKey, nominal_value, parse_key
from rpojax.scenario.schema import ScenarioFile


def check_dispersions(file: ScenarioFile) -> None:
    """Checks all dispersions of a scenario.

    Raises:
        ScenarioError: naming the key, what was found and what was expected.
    """
    assigned: list[ParameterKey] = []
    for index, dispersion in enumerate(file.dispersions):
        where = f"dispersions.{index}"
        for text, parameter in zip(dispersion.key_texts, assigned_keys(dispersion), strict=True):
            check_key_exists(file, f"{where}.{'keys' if dispersion.is_joint else 'key'}", text)
            if any(parameter.overlaps(other) for other in assigned):
                raise ScenarioError(f"{where}.key", text, "a key that no other dispersion draws")
            assigned.append(parameter)
            if dispersion.is_joint:
                _check_joint_key(file, where, text)
            elif is_category(text) and not dispersion.takes_categories:
                raise ScenarioError(f"{where}.kind", dispersion.kind, f"'choice' for {text}")
        nominal = nominal_numbers(file, dispersion)
        dispersion.check(where, nominal)
        _check_extreme_values(file, where, dispersion, nominal.shape)
        if isinstance(dispersion, Derived):
            _check_terms(file, where, dispersion, nominal.shape)
    evaluation_order(file)


def _check_joint_key(file: ScenarioFile, where: str, text: str) -> None:
    if np.ndim(nominal_value(file, parse_key(text))) > 1 or is_category(text):
        raise ScenarioError(f"{where}.keys", text, "keys of numbers and of vectors")


def _check_terms(file: ScenarioFile, where: str, dispersion: Derived, shape: tuple[int, ...]) -> None:
    for number, term in enumerate(dispersion.terms):
        check_key_exists(file, f"{where}.terms.{number}.key", term.key)
        value = nominal_value(file, parse_key(term.key))
        if is_category(term.key) or np.shape(value) not in ((), shape):
            raise ScenarioError(f"{where}.terms.{number}.key", term.key, f"a number, or numbers of shape {shape}")


def _check_extreme_values(file: ScenarioFile, where: str, dispersion: DispersionKind, shape: tuple[int, ...]) -> None:
    """Checks the values that a dispersion can assign against the schema of its key."""
    for extreme in dispersion.extreme_values(shape):
        parameter, setting = assigned_keys(dispersion)[0], f"{where}.{extreme.setting}"
        check_acceptable(file, setting, parameter, extreme.value, whole=extreme.whole, shown=extreme.shown)
