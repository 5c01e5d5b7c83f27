"""Choices: values of keys, each with the reason for it, and rounding to what is worth reading."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Choice:
    """Value of a key.

    Attributes:
        key: with its section
        value: in the unit of the key
        reason: with the number that it follows from; empty if it is a fact
        is_full: whether it has an effect with the full environment alone
    """

    key: str
    value: Any
    reason: str = ""
    is_full: bool = False


@dataclass(frozen=True)
class Choices:
    """Values of keys, and tables of lists.

    Attributes:
        values: by section, in the order of the file
        lists: name of a list of tables (phases, dispersions, requirements) and one table, with a reason
    """

    values: Sequence[Choice] = ()
    lists: Sequence[Choice] = ()

    def __add__(self, other: "Choices") -> "Choices":
        return Choices([*self.values, *other.values], [*self.lists, *other.lists])


def tidy(value: float, digits: int = 3) -> float:
    """A number with that many digits."""
    return float(f"{value:.{digits}g}")


def tidy_all(values: Any, digits: int = 3) -> list[Any]:
    """Numbers of a vector or matrix with that many digits; what is rounding noise is zero."""
    rows = [list(each) if hasattr(each, "__len__") else float(each) for each in values]
    largest = max((abs(float(x)) for row in rows for x in (row if isinstance(row, list) else [row])), default=0.0)

    def one(value: float) -> float:
        return 0.0 if abs(value) < 1e-9 * largest else tidy(float(value), digits)

    return [[one(x) for x in row] if isinstance(row, list) else one(row) for row in rows]


def up_to(value: float, step: float) -> float:
    """The least multiple of a step that is not below a value."""
    return step * math.ceil(value / step - 1e-9)
