"""Faults of data sets: what is refused, and what is noticed."""

import warnings
from collections import Counter
from collections.abc import Hashable, Iterable
from pathlib import Path
from typing import TypeVar

from rpojax.errors import Notice, RpojaxError

Value = TypeVar("Value", bound=Hashable)


class DatasetError(RpojaxError):
    """A data set cannot be used."""


def noticed(place: Path | str, sentences: Iterable[str]) -> tuple[str, ...]:
    """What is unlikely about a data set, each sentence with its place, and told to the user as a `Notice`."""
    notes = tuple(f"{place}: {sentence}" for sentence in sentences)
    for note in notes:
        warnings.warn(f"warning: {note}", Notice, stacklevel=3)
    return notes


def repeated(values: Iterable[Value]) -> tuple[Value, int] | None:
    """A value that occurs more than once, and how often; None if each occurs once."""
    return next(((value, times) for value, times in Counter(values).items() if times > 1), None)
