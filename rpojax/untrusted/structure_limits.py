"""Limits on the structure of what is read from JSON and TOML: depth, number of values, and size of numbers."""

import math
from typing import Any, Final

from rpojax.errors import RpojaxError

MOST_DEPTH: Final = 64
"""Most levels of tables and lists within each other."""
MOST_VALUES: Final = 10_000_000
"""Most values of a file, those in lists included."""
LARGEST_INTEGER: Final = 2**64
"""No integer of a file may reach this size."""


class StructureError(RpojaxError):
    """A text is no JSON or TOML, or beyond the limits on its structure."""


def check_structure(content: Any, finite: bool = True) -> None:
    """Refuses content that is too deep or has too many values or large integers; with `finite` also NaN and infinity.

    Raises:
        StructureError: which limit is exceeded.
    """
    level, depth, total = [content], 0, 0
    while level:
        total += len(level)
        if depth > MOST_DEPTH or total > MOST_VALUES:
            found = f"more than {MOST_DEPTH} levels" if depth > MOST_DEPTH else f"more than {MOST_VALUES} values"
            raise StructureError(f"found {found}, expected at most so many")
        below: list[Any] = []
        for value in level:
            if isinstance(value, dict):
                below.extend(value.values())
            elif isinstance(value, list):
                below.extend(value)
            elif isinstance(value, int):
                if not -LARGEST_INTEGER < value < LARGEST_INTEGER:
                    raise StructureError("found an integer of more than 64 bits, expected smaller ones")
            elif finite and isinstance(value, float) and not math.isfinite(value):
                raise StructureError(f"found {value}, expected finite numbers")
        level, depth = below, depth + 1
