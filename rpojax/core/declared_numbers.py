"""Numbers of a scenario, each declared once as a field of the record that uses it.

A declaration gives key, form, bounds, default, unit and meaning, and says that it may be dispersed and differentiated.
"""

import dataclasses
from dataclasses import MISSING, dataclass
from typing import Annotated, Any, Final, get_args

from pydantic import Field

_NAME: Final = "number"


@dataclass(frozen=True, eq=False)
class Number:
    """Declaration of a number, vector or matrix of a scenario.

    Attributes:
        meaning: of the key
        form: type of the key's value with its bounds, for pydantic
        unit: suffix of the key, empty for a dimensionless number
        default: value of a key that is left out, in the key's unit; MISSING if it must be given
        key: with its section, empty for the name of the field and the unit in the section of the record
    """

    meaning: str
    form: Any
    unit: str
    default: Any
    key: str

    @property
    def varies(self) -> bool:
        """Whether it may be dispersed and differentiated: all but whole numbers."""
        return self.form is not int and get_args(self.form)[:1] != (int,)


def number(
    meaning: str,
    *,
    unit: str = "",
    form: Any = float,
    length: int | None = None,
    above: float | None = None,
    at_least: float | None = None,
    below: float | None = None,
    at_most: float | None = None,
    default: Any = MISSING,
    key: str = "",
) -> Any:
    """Field of a record that is a number of a scenario.

    Args:
        meaning: of the key, in one or two sentences
        unit: suffix of the key, such as `deg_s`
        form: type of the key's value, if it is no number or list of numbers
        length: numbers of a vector
        above: limit of each number, itself left out
        at_least: limit of each number
        below: limit of each number, itself left out
        at_most: limit of each number
        default: value of a key that is left out, in its unit; with None the field is None then
        key: with section and unit, if it is not that of the field in the section of the record
    """
    if form is float:
        form = Annotated[float, Field(gt=above, ge=at_least, lt=below, le=at_most, allow_inf_nan=False)]
    if length is not None:
        form = Annotated[list[form], Field(min_length=length, max_length=length)]
    if default is None:
        form = form | None
    declared = Number(meaning, form, unit, default, key)
    return dataclasses.field(default=None if default is None else MISSING, metadata={_NAME: declared})


def declared_numbers(record: type) -> dict[str, tuple[str, Number]]:
    """Field -> its key, with a section only where the declaration names one, and the declaration."""
    found = {}
    for each in dataclasses.fields(record):
        if declared := each.metadata.get(_NAME):
            found[each.name] = declared.key or "_".join(filter(None, (each.name, declared.unit))), declared
    return found


def described(record: type) -> str | None:
    """Docstring of a record with the meanings of its numbers."""
    lines = [f"        {name}: {each.meaning}; key `{key}`" for name, (key, each) in declared_numbers(record).items()]
    text = record.__doc__
    if not text or not lines:
        return text
    return "\n".join([text.rstrip(), *([] if "Attributes:" in text else ["", "    Attributes:"]), *lines, "    "])
