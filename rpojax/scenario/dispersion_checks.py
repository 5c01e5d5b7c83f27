"""Checks of what changes from run to run: keys that exist and are given once, values that they can have."""

from typing import Any

import numpy as np
from pydantic import ValidationError

from rpojax.errors import ScenarioError
from rpojax.scenario import dispersion_keys, schema
from rpojax.scenario.dispersion_keys import ParameterKey
from rpojax.scenario.schema import ScenarioFile

_REQUIRED_SHAPES = {"direction": (3,), "attitude": (4,), "small_rotation": (4,)}
_EXPECTED_KEY = "the key of a number in this scenario, such as 'servicer.mass_kg'"
_CATEGORICAL_KEYS = ("fault.kind", "fault.wheel")


def check_dispersions(file: ScenarioFile) -> None:
    """Checks of all dispersions of a scenario.

    Raises:
        ScenarioError: naming the key, what was found and what was expected.
    """
    seen: list[ParameterKey] = []
    for index, dispersion in enumerate(file.dispersions):
        where = f"dispersions.{index}"
        for text, place in zip(_key_texts(dispersion), dispersion_keys.assigned_keys(dispersion), strict=True):
            _check_key_exists(file, f"{where}.{'keys' if dispersion.kind == 'correlated_normal' else 'key'}", text)
            if any(place.overlaps(other) for other in seen):
                raise ScenarioError(f"{where}.key", text, "a key that no other dispersion draws")
            seen.append(place)
        match dispersion:
            case schema.CorrelatedNormal():
                _check_correlated(file, where, dispersion)
            case schema.Derived():
                _check_derived(file, where, dispersion)
            case _:
                _check_single_key(
                    file,
                    where,
                    dispersion,
                    dispersion_keys.nominal_value(file, dispersion_keys.parse_key(dispersion.key)),
                )
    dispersion_keys.evaluation_order(file)


def _key_texts(dispersion: schema.Dispersion) -> list[str]:
    return dispersion.keys if isinstance(dispersion, schema.CorrelatedNormal) else [dispersion.key]


def _check_key_exists(file: ScenarioFile, where: str, text: str) -> None:
    if dispersion_keys.nominal_value(file, dispersion_keys.parse_key(text)) is None:
        raise ScenarioError(where, text, _EXPECTED_KEY)


def _check_correlated(file: ScenarioFile, where: str, dispersion: schema.CorrelatedNormal) -> None:
    for text in dispersion.keys:
        if (
            np.ndim(dispersion_keys.nominal_value(file, dispersion_keys.parse_key(text))) > 1
            or text in _CATEGORICAL_KEYS
        ):
            raise ScenarioError(f"{where}.keys", text, "keys of numbers and of vectors")
    count = len(dispersion_keys.expand_vectors(file, dispersion.keys))
    if len(dispersion.covariance) != count:
        found = f"{len(dispersion.covariance)} rows"
        raise ScenarioError(f"{where}.covariance", found, f"one for each of the {count} components of keys")


def _check_derived(file: ScenarioFile, where: str, dispersion: schema.Derived) -> None:
    shape = np.shape(dispersion_keys.nominal_value(file, dispersion_keys.parse_key(dispersion.key)))
    if dispersion.key in _CATEGORICAL_KEYS:
        raise ScenarioError(f"{where}.kind", dispersion.kind, f"'choice' for {dispersion.key}")
    if len(shape) > 1:
        raise ScenarioError(f"{where}.key", dispersion.key, "the key of a number or a vector")
    if np.ndim(dispersion.offset) and np.shape(dispersion.offset) != shape:
        raise ScenarioError(f"{where}.offset", dispersion.offset, f"one number, or numbers of shape {shape}")
    for number, term in enumerate(dispersion.terms):
        _check_key_exists(file, f"{where}.terms.{number}.key", term.key)
        value = dispersion_keys.nominal_value(file, dispersion_keys.parse_key(term.key))
        if term.key in _CATEGORICAL_KEYS or np.shape(value) not in ((), shape):
            raise ScenarioError(f"{where}.terms.{number}.key", term.key, f"a number, or numbers of shape {shape}")


def _check_single_key(file: ScenarioFile, where: str, dispersion: Any, value: Any) -> None:
    """Checks of a dispersion that draws one key from its own settings."""
    shape = np.shape(value)
    expected = _REQUIRED_SHAPES.get(dispersion.kind)
    if expected is not None and shape != expected:
        raise ScenarioError(f"{where}.kind", dispersion.kind, f"a key with {expected[0]} components")
    sigma = getattr(dispersion, "sigma", getattr(dispersion, "sigma_deg", 0.0))
    wanted = (3,) if dispersion.kind == "small_rotation" else shape
    if np.ndim(sigma) and np.shape(sigma) != wanted:
        raise ScenarioError(f"{where}.sigma", sigma, f"one number, or numbers of shape {wanted}")
    if dispersion.kind == "choice":
        _check_listed_values(f"{where}.values", dispersion.key, dispersion.values, shape)
    elif dispersion.key in _CATEGORICAL_KEYS:
        raise ScenarioError(f"{where}.kind", dispersion.kind, f"'choice' for {dispersion.key}")
    if dispersion.kind == "log_normal" and np.any(np.asarray(value) <= 0.0):
        raise ScenarioError(f"{where}.key", dispersion.key, "a nominal value above zero for a log-normal")
    _check_possible_values(file, where, dispersion, value)


def _check_listed_values(where: str, key: str, values: list[Any], shape: tuple[int, ...]) -> None:
    """Values listed for a key have its form."""
    named = any(isinstance(value, str) for value in values)
    if named != (key == "fault.kind"):
        raise ScenarioError(where, values[:5], "kinds of fault" if key == "fault.kind" else "numbers")
    odd = [value for value in values if np.shape(value) != shape]
    if odd:
        raise ScenarioError(where, odd[0], f"values of shape {shape}")


def _check_possible_values(file: ScenarioFile, where: str, dispersion: Any, value: Any) -> None:
    """Values that a dispersion is sure to draw, or to come near to, must be acceptable for their key."""
    place = dispersion_keys.parse_key(dispersion.key)
    if dispersion.kind == "uniform":
        for end in ("low", "high"):
            # The ends of a uniform, all components at once, are drawn by no run: only their limits one by one count.
            drawn = np.full(np.shape(value), getattr(dispersion, end)).tolist()
            _check_acceptable(file, f"{where}.{end}", place, drawn, whole=False, shown=getattr(dispersion, end))
    elif dispersion.kind == "choice":
        for drawn in dispersion.values:
            _check_acceptable(file, f"{where}.values", place, drawn, whole=True)


def _check_acceptable(
    file: ScenarioFile, where: str, place: ParameterKey, value: Any, whole: bool, shown: Any = None
) -> None:
    """Refuses a value that its key cannot hold; `whole` counts checks of all components together too."""
    section_name, _, name = place.key.partition(".")
    section = getattr(file, section_name)
    if place.index is not None:
        value = [value if at == place.index else part for at, part in enumerate(getattr(section, name))]
    try:
        type(section).model_validate({**section.model_dump(), name: value})
    except ValidationError as error:
        for fault in error.errors():
            if whole or fault["type"] != "value_error":
                reason = fault["msg"].removeprefix("Value error, expected ").removeprefix("Input should be ")
                found = value if shown is None else shown
                raise ScenarioError(where, found, f"what {place.key} can be: {reason}") from None


def check_design(file: ScenarioFile) -> None:
    """Checks of a scenario's design: keys that exist and are not dispersed besides, and values that they can have.

    Raises:
        ScenarioError: naming the key, what was found and what was expected.
    """
    design = file.design
    if not isinstance(design, schema.TableDesign | schema.GridDesign):
        return
    if isinstance(design, schema.TableDesign):
        _check_column_lengths(design)
    seen = [place for dispersion in file.dispersions for place in dispersion_keys.assigned_keys(dispersion)]
    for text, values in design.values.items():
        where, place = f"design.values.{text}", dispersion_keys.parse_key(text)
        _check_key_exists(file, where, text)
        if any(place.overlaps(other) for other in seen):
            raise ScenarioError("design.values", text, "a key that nothing else gives values to")
        seen.append(place)
        shape = np.shape(dispersion_keys.nominal_value(file, place))
        if shape and isinstance(design, schema.TableDesign):
            raise ScenarioError("design.values", text, f"one column for each component, such as '{text}[0]'")
        _check_listed_values(where, text, values, shape)
        for value in _extreme_values(text, values):
            _check_acceptable(file, where, place, value, whole=bool(shape))
    for key in {place.key for place in map(dispersion_keys.parse_key, design.values) if place.index is not None}:
        _check_acceptable(
            file, f"design.values.{key}", ParameterKey(key, None), _shortest_vector(file, design, key), whole=True
        )


def _shortest_vector(file: ScenarioFile, design: schema.TableDesign | schema.GridDesign, key: str) -> list[float]:
    """Shortest vector that a design puts together from components; where that is acceptable, so are the others."""
    columns: dict[int, np.ndarray] = {}
    for text, values in design.values.items():
        if (place := dispersion_keys.parse_key(text)).key == key and place.index is not None:
            column = np.array(values, dtype=np.float64)
            columns[place.index] = column if design.kind == "table" else column[[np.abs(column).argmin()]]
    rows = np.tile(schema.nominal_value(file, key), (len(next(iter(columns.values()))), 1))
    for index, column in columns.items():
        rows[:, index] = column
    return rows[np.linalg.norm(rows, axis=1).argmin()].tolist()


def _check_column_lengths(design: schema.TableDesign) -> None:
    if design.file:
        raise ScenarioError("design.file", design.file, "values, or a file in a scenario that is loaded")
    lengths = {len(values) for values in design.values.values()}
    if len(lengths) != 1 or 0 in lengths:
        raise ScenarioError("design.values", f"columns of {sorted(lengths)} values", "one value or more for each run")


def _extreme_values(text: str, values: list[Any]) -> list[Any]:
    """Values whose acceptance means that all are acceptable: limits of numbers are intervals, so the ends do."""
    if text in _CATEGORICAL_KEYS:
        return list(dict.fromkeys(values))
    return [min(values), max(values)] if not isinstance(values[0], list) else values
