"""What to change, in words: each key with its present value, and where it is known the value that it needs."""

import re
from typing import Any, Final

import numpy as np

from rpojax.analysis.failure_causes.finding import number
from rpojax.scenario.numbers.key_units import unit_symbol
from rpojax.scenario.parameter_keys import nominal_of_key, parse_key, section_of_key
from rpojax.scenario.schema import ScenarioFile
from rpojax.scenario.warnings.dispersed_reach import DispersedReach

Value = int | float | str | list[float]
"""What a key needs; a text where it is no number."""
_KEY: Final = re.compile(r"\b[a-z][a-z0-9_]*(?:\.[a-z0-9_]+)+(?:\[\d+\])?|\b(?:duration_s|epoch_utc)\b")
"""A key of a scenario in a text."""
_STATED: Final = re.compile(r"(?::| \(|,)? ?(?:now\b|=)")
"""What follows a key whose present value the text tells itself."""


def change(file: ScenarioFile, key: str, value: Value) -> str:
    """A key, its present value and the one that it needs, such as `camera.field_of_view_deg: now 10 -> 30 deg`."""
    return _joined(file, key, f"-> {_text(value)}")


def at_least(file: ScenarioFile, key: str, value: Value) -> str:
    """A key, its present value and the least one that it needs."""
    return _joined(file, key, f", at least {_text(value)}")


def at_most(file: ScenarioFile, key: str, value: Value) -> str:
    """A key, its present value and the greatest one that it may have."""
    return _joined(file, key, f", at most {_text(value)}")


def with_present_values(file: ScenarioFile, text: str) -> str:
    """A text in which each key that has no value yet has its present one in brackets behind it."""

    def told(found: re.Match[str]) -> str:
        present = present_text(file, found[0])
        if not present or _STATED.match(text, found.end()):
            return found[0]
        return f"{found[0]} (now {present}{_unit(found[0])})"

    return _KEY.sub(told, text)


def present_text(file: ScenarioFile, key: str) -> str:
    """Present value of a key as text, of a dispersed one the middle; empty if the scenario has no such value."""
    parameter = parse_key(key)
    section, name = section_of_key(file, parameter.key) if "." in key else (file, key)
    if section is None or name not in type(section).model_fields:
        return ""
    value = getattr(section, name)
    if nominal_of_key(file, parameter.key) is not None and not isinstance(value, str):
        value = DispersedReach(file).middle(key).tolist()
    elif parameter.index is not None:
        value = value[parameter.index]
    return "" if value is None else _text(value)


def _joined(file: ScenarioFile, key: str, needed: str) -> str:
    space = " " if needed.startswith("-") else ""
    return f"{key}: now {present_text(file, key)}{space}{needed}{_unit(key)}"


def _text(value: Any) -> str:
    if isinstance(value, str):
        return value
    if isinstance(value, list | tuple | np.ndarray):
        each = [_text(one) for one in value]
        return f"[{', '.join(each)}]"
    if isinstance(value, bool):
        return str(value).lower()
    return number(float(value)) if isinstance(value, int | float | np.number) else str(value)


def _unit(key: str) -> str:
    symbol = unit_symbol(key.partition("[")[0])
    return "" if symbol == "1" else " px" if symbol == "pixel" else f" {symbol}"
