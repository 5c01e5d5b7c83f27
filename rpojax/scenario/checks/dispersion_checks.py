"""Checks of the dispersions of a scenario: keys that exist and are assigned once, settings that fit them."""

from typing import Any

import numpy as np

from rpojax.dispersions.dispersion_kinds import CorrelatedNormal, Derived, Dispersion
from rpojax.errors import ScenarioError
from rpojax.scenario.checks.assigned_value_checks import (
    CATEGORICAL_KEYS,
    check_acceptable,
    check_key_exists,
    check_listed_values,
)
from rpojax.scenario.dispersed_numbers.dispersion_keys import assigned_keys, evaluation_order
from rpojax.scenario.parameter_keys import ParameterKey, expand_vectors, nominal_value, parse_key
from rpojax.scenario.schema import ScenarioFile

_REQUIRED_SHAPES = {"direction": (3,), "attitude": (4,), "small_rotation": (4,)}


def check_dispersions(file: ScenarioFile) -> None:
    """Checks all dispersions of a scenario.

    Raises:
        ScenarioError: naming the key, what was found and what was expected.
    """
    assigned: list[ParameterKey] = []
    for index, dispersion in enumerate(file.dispersions):
        where = f"dispersions.{index}"
        for text, parameter in zip(_key_texts(dispersion), assigned_keys(dispersion), strict=True):
            check_key_exists(file, f"{where}.{'keys' if dispersion.kind == 'correlated_normal' else 'key'}", text)
            if any(parameter.overlaps(other) for other in assigned):
                raise ScenarioError(f"{where}.key", text, "a key that no other dispersion draws")
            assigned.append(parameter)
        match dispersion:
            case CorrelatedNormal():
                _check_correlated(file, where, dispersion)
            case Derived():
                _check_derived(file, where, dispersion)
            case _:
                _check_single_key(file, where, dispersion, nominal_value(file, parse_key(dispersion.key)))
    evaluation_order(file)


def _key_texts(dispersion: Dispersion) -> list[str]:
    return dispersion.keys if isinstance(dispersion, CorrelatedNormal) else [dispersion.key]


def _check_correlated(file: ScenarioFile, where: str, dispersion: CorrelatedNormal) -> None:
    for text in dispersion.keys:
        if np.ndim(nominal_value(file, parse_key(text))) > 1 or text in CATEGORICAL_KEYS:
            raise ScenarioError(f"{where}.keys", text, "keys of numbers and of vectors")
    count = len(expand_vectors(file, dispersion.keys))
    if len(dispersion.covariance) != count:
        found = f"{len(dispersion.covariance)} rows"
        raise ScenarioError(f"{where}.covariance", found, f"one for each of the {count} components of keys")


def _check_derived(file: ScenarioFile, where: str, dispersion: Derived) -> None:
    shape = np.shape(nominal_value(file, parse_key(dispersion.key)))
    if dispersion.key in CATEGORICAL_KEYS:
        raise ScenarioError(f"{where}.kind", dispersion.kind, f"'choice' for {dispersion.key}")
    if len(shape) > 1:
        raise ScenarioError(f"{where}.key", dispersion.key, "the key of a number or a vector")
    if np.ndim(dispersion.offset) and np.shape(dispersion.offset) != shape:
        raise ScenarioError(f"{where}.offset", dispersion.offset, f"one number, or numbers of shape {shape}")
    for number, term in enumerate(dispersion.terms):
        check_key_exists(file, f"{where}.terms.{number}.key", term.key)
        value = nominal_value(file, parse_key(term.key))
        if term.key in CATEGORICAL_KEYS or np.shape(value) not in ((), shape):
            raise ScenarioError(f"{where}.terms.{number}.key", term.key, f"a number, or numbers of shape {shape}")


def _check_single_key(file: ScenarioFile, where: str, dispersion: Any, nominal: Any) -> None:
    """Checks a dispersion of one key."""
    shape = np.shape(nominal)
    expected = _REQUIRED_SHAPES.get(dispersion.kind)
    if expected is not None and shape != expected:
        raise ScenarioError(f"{where}.kind", dispersion.kind, f"a key with {expected[0]} components")
    sigma = getattr(dispersion, "sigma", getattr(dispersion, "sigma_deg", 0.0))
    sigma_shape = (3,) if dispersion.kind == "small_rotation" else shape
    if np.ndim(sigma) and np.shape(sigma) != sigma_shape:
        raise ScenarioError(f"{where}.sigma", sigma, f"one number, or numbers of shape {sigma_shape}")
    if dispersion.kind == "choice":
        check_listed_values(f"{where}.values", dispersion.key, dispersion.values, shape)
    elif dispersion.key in CATEGORICAL_KEYS:
        raise ScenarioError(f"{where}.kind", dispersion.kind, f"'choice' for {dispersion.key}")
    if dispersion.kind == "log_normal" and np.any(np.asarray(nominal) <= 0.0):
        raise ScenarioError(f"{where}.key", dispersion.key, "a nominal value above zero for a log-normal")
    _check_extreme_values(file, where, dispersion, shape)


def _check_extreme_values(file: ScenarioFile, where: str, dispersion: Any, shape: tuple[int, ...]) -> None:
    """Checks the bounds of a uniform and the values of a choice against the schema of their key."""
    parameter = parse_key(dispersion.key)
    if dispersion.kind == "uniform":
        for end in ("low", "high"):
            # No run has all components at the bound, so that checks of all components together do not apply.
            value = np.full(shape, getattr(dispersion, end)).tolist()
            check_acceptable(file, f"{where}.{end}", parameter, value, whole=False, shown=getattr(dispersion, end))
    elif dispersion.kind == "choice":
        for value in dispersion.values:
            check_acceptable(file, f"{where}.values", parameter, value, whole=True)
