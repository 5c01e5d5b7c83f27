"""Checks that listed values fit the key to which a dispersion or a design assigns them."""

from typing import Any

from pydantic import ValidationError

from rpojax.errors import ScenarioError
from rpojax.scenario import former_keys
from rpojax.scenario.parameter_keys import ParameterKey, nominal_value, parse_key, section_of_key
from rpojax.scenario.schema import ScenarioFile

_EXPECTED_KEY = "the key of a number in this scenario, such as 'servicer.mass_kg'"


def check_key_exists(file: ScenarioFile, where: str, text: str) -> None:
    """Refuses a key that names no number of the scenario."""
    if nominal_value(file, parse_key(text)) is None:
        raise ScenarioError(where, text, former_keys.replacement(text) or _EXPECTED_KEY)


def check_acceptable(
    file: ScenarioFile, where: str, parameter: ParameterKey, value: Any, whole: bool, shown: Any = None
) -> None:
    """Refuses a value that the schema does not allow for its key.

    `whole` includes the schema's checks of all components together; `shown` is the value named in the error.
    """
    section, name = section_of_key(file, parameter.key)
    assert section is not None
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
