"""Checks that listed values fit the key to which a dispersion or a design assigns them."""

from typing import Any

import numpy as np
from pydantic import ValidationError

from rpojax.errors import ScenarioError
from rpojax.scenario.parameter_keys import ParameterKey, nominal_value, parse_key
from rpojax.scenario.schema import ScenarioFile

CATEGORICAL_KEYS = ("fault.kind", "fault.wheel")
"""Keys whose values are categories, not quantities."""
_EXPECTED_KEY = "the key of a number in this scenario, such as 'servicer.mass_kg'"


def check_key_exists(file: ScenarioFile, where: str, text: str) -> None:
    """Refuses a key that names no number of the scenario."""
    if nominal_value(file, parse_key(text)) is None:
        raise ScenarioError(where, text, _EXPECTED_KEY)


def check_listed_values(where: str, key: str, values: list[Any], shape: tuple[int, ...]) -> None:
    """Refuses values of another shape than the key's, and numbers where names are needed or the reverse."""
    named = any(isinstance(value, str) for value in values)
    if named != (key == "fault.kind"):
        raise ScenarioError(where, values[:5], "kinds of fault" if key == "fault.kind" else "numbers")
    odd = [value for value in values if np.shape(value) != shape]
    if odd:
        raise ScenarioError(where, odd[0], f"values of shape {shape}")


def check_acceptable(
    file: ScenarioFile, where: str, parameter: ParameterKey, value: Any, whole: bool, shown: Any = None
) -> None:
    """Refuses a value that the schema does not allow for its key.

    `whole` includes the schema's checks of all components together; `shown` is the value named in the error.
    """
    section_name, _, name = parameter.key.partition(".")
    section = getattr(file, section_name)
    if parameter.index is not None:
        value = [value if at == parameter.index else part for at, part in enumerate(getattr(section, name))]
    try:
        type(section).model_validate({**section.model_dump(), name: value})
    except ValidationError as error:
        for fault in error.errors():
            if whole or fault["type"] != "value_error":
                reason = fault["msg"].removeprefix("Value error, expected ").removeprefix("Input should be ")
                found = value if shown is None else shown
                raise ScenarioError(where, found, f"what {parameter.key} can be: {reason}") from None
