"""Provenance of replaced flight-software stages: records of names and sources, and comparison with a campaign's."""

import functools
import hashlib
import inspect
from collections.abc import Mapping
from dataclasses import fields
from typing import Any

import numpy as np

from rpojax.errors import RpojaxError
from rpojax.flight.stages import Stages

StageRecords = dict[str, dict[str, str | None]]


def replaced_stages(stages: Stages) -> StageRecords:
    """Name of each stage that is not the default -> its function, and the SHA-256 of its source and of its values.

    Values are what it captures, has bound or holds as an object. A digest is None where there is none.
    """
    default = Stages()
    functions = {field.name: getattr(stages, field.name) for field in fields(Stages)}
    return {
        name: {
            "function": _qualified_name(function),
            "source_sha256": _source_digest(function),
            "values_sha256": _values_digest(function),
        }
        for name, function in functions.items()
        if function is not getattr(default, name)
    }


def _qualified_name(function: Any) -> str:
    """Module and qualified name of a function, or of the class of a callable object."""
    named = function if hasattr(function, "__qualname__") else type(function)
    return f"{named.__module__}.{named.__qualname__}"


def _values_digest(function: Any) -> str | None:
    """SHA-256 of bound arguments, captured variables, defaults and fields; None if one has no digest of its own."""
    try:
        return hashlib.sha256(_content(function, 0).encode()).hexdigest()
    except _NoContentError:
        return None


class _NoContentError(Exception):
    """A value whose content cannot be told from its text."""


_DEEPEST = 8


def _content(value: Any, depth: int) -> str:
    """Text that differs for values of different content.

    Raises:
        _NoContentError: there is none.
    """
    if depth > _DEEPEST:
        raise _NoContentError
    if value is None or isinstance(value, str | bytes | int | float | complex | bool):
        return repr(value)
    if isinstance(value, list | tuple | set | frozenset):
        return f"{type(value).__name__}({[_content(each, depth + 1) for each in value]})"
    if isinstance(value, Mapping):
        return str(sorted((str(key), _content(each, depth + 1)) for key, each in value.items()))
    if hasattr(value, "__array__"):
        array = np.asarray(value)
        return f"{array.dtype}{array.shape}{hashlib.sha256(array.tobytes()).hexdigest()}"
    return _callable_content(value, depth)


def _callable_content(value: Any, depth: int) -> str:
    wrapped = getattr(value, "__wrapped__", None)
    if isinstance(value, functools.partial):
        parts: Any = (value.func, value.args, value.keywords)
    elif wrapped is not None:
        parts = (wrapped,)
    elif inspect.isfunction(value):
        cells = [cell.cell_contents for cell in value.__closure__ or ()]
        code = value.__code__
        constants = tuple(each for each in code.co_consts if not inspect.iscode(each))
        unnamed = (code.co_code, constants) if value.__name__ == "<lambda>" else ()
        parts = (_source_digest(value), cells, value.__defaults__, value.__kwdefaults__, unnamed)
    elif inspect.isroutine(value) or inspect.isclass(value) or inspect.ismodule(value):
        parts = ()
    elif hasattr(value, "__dict__"):
        parts = (vars(value),)
    else:
        raise _NoContentError
    name = _qualified_name(value) if not inspect.ismodule(value) else value.__name__
    return name + "".join(_content(part, depth + 1) for part in parts)


def _source_digest(function: Any) -> str | None:
    try:
        source = inspect.getsource(function if hasattr(function, "__qualname__") else type(function))
    except (OSError, TypeError):
        return None
    return hashlib.sha256(source.encode()).hexdigest()


def check_same_stages(recorded: Mapping[str, Any], stages: Stages) -> None:
    """Refuses stages that differ from those with which a campaign began.

    Raises:
        RpojaxError: naming the stage, and what was found and expected there.
    """
    replaced = replaced_stages(stages)
    for name in sorted({*recorded, *replaced}):
        found, expected = replaced.get(name), recorded.get(name)
        if not _are_same(found, expected):
            raise RpojaxError(
                f"stages: found {format_stage(found)} for {name}, expected {format_stage(expected)}, with which "
                "the campaign began; resume it with rpojax.resume_campaign(folder, stages=...)"
            )


def _are_same(found: Mapping[str, Any] | None, recorded: Mapping[str, Any] | None) -> bool:
    """Whether two records are of the same function; one recorded without a digest of its values had none to compare."""
    if found is None or recorded is None:
        return found is recorded
    unknown = "values_sha256" in recorded and recorded["values_sha256"] is None
    return not unknown and all(found[name] == value for name, value in recorded.items())


def format_stage(record: Mapping[str, Any] | None) -> str:
    """Record of one stage as text."""
    if record is None:
        return "the default"
    source, values = record.get("source_sha256"), record.get("values_sha256")
    known = [f"source {source[:12]}" if source else "source unknown", *([f"values {values[:12]}"] if values else [])]
    return f"{record.get('function')} ({', '.join(known)})"
