"""The known key of a scenario that is nearest to an unknown one, with its full path."""

import difflib
import functools
from collections.abc import Iterator
from typing import Any, Final, get_args

from pydantic import BaseModel

from rpojax.scenario.schema import ScenarioFile

_LONGEST: Final = 100
"""Longer keys are like none."""


def nearest_key(unknown: str) -> str:
    """Hint such as ` (did you mean 'servicer.mass_kg'?)`, empty if no key is similar."""
    found = _nearest(unknown) if len(unknown) <= _LONGEST else None
    return "" if found is None else f" (did you mean {found!r}?)"


def is_known_key(key: str) -> bool:
    """Whether a scenario may have a key, which this one may have left out."""
    return key in _known_keys()


@functools.cache
def _known_keys() -> tuple[str, ...]:
    return tuple(_keys_of(ScenarioFile, ""))


def _keys_of(model: type[BaseModel], prefix: str) -> Iterator[str]:
    for name, field in model.model_fields.items():
        yield prefix + name
        section = _section(field.annotation)
        if section is not None:
            yield from _keys_of(section, f"{prefix}{name}.")


def _section(annotation: Any) -> type[BaseModel] | None:
    """Model of a section that may be left out, None for values and lists."""
    for option in (annotation, *get_args(annotation)):
        if isinstance(option, type) and issubclass(option, BaseModel):
            return option
    return None


def _nearest(unknown: str) -> str | None:
    keys = _known_keys()
    leaf = unknown.rpartition(".")[2]
    if unknown in keys:
        return None  # it is known, but not in this scenario
    with_leaf = [key for key in keys if key.rpartition(".")[2] == leaf]
    others = [key for key in keys if not unknown.startswith(f"{key}.")]
    for candidates, cutoff in ((with_leaf, 0.0), (others, 0.6)):
        if near := difflib.get_close_matches(unknown, candidates, n=1, cutoff=cutoff):
            return near[0]
    leaves = {key.rpartition(".")[2]: key for key in reversed(keys)}
    by_leaf = difflib.get_close_matches(leaf, list(leaves), n=1, cutoff=0.75)
    return leaves[by_leaf[0]] if by_leaf else None
