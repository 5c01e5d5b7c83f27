"""Digests of a function that tell whether it is the same in another process: of its source, and of what it holds."""

import functools
import hashlib
import inspect
from collections.abc import Mapping
from typing import Any

import numpy as np


def qualified_name(function: Any) -> str:
    """Module and qualified name of a function, or of the class of a callable object."""
    named = function if hasattr(function, "__qualname__") else type(function)
    return f"{named.__module__}.{named.__qualname__}"


def values_digest(function: Any) -> str | None:
    """SHA-256 of bound arguments, captured variables, defaults and fields; None if one has no digest of its own."""
    try:
        return hashlib.sha256(_content(function, 0).encode()).hexdigest()
    except _NoContentError:
        return None


class _NoContentError(Exception):
    """A value whose content cannot be told from its text."""


_DEEPEST = 8
"""Levels of nested values that are looked at; a function that captures itself has no end."""


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
        parts = [_content(each, depth + 1) for each in value]
        # The order of a set is another one in every process.
        return f"{type(value).__name__}({sorted(parts) if isinstance(value, set | frozenset) else parts})"
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
        parts = (source_digest(value), cells, value.__defaults__, value.__kwdefaults__, unnamed)
    elif inspect.isroutine(value) or inspect.isclass(value) or inspect.ismodule(value):
        parts = ()
    elif hasattr(value, "__dict__"):
        parts = (vars(value),)
    else:
        raise _NoContentError
    name = qualified_name(value) if not inspect.ismodule(value) else value.__name__
    return name + "".join(_content(part, depth + 1) for part in parts)


def source_digest(function: Any) -> str | None:
    """SHA-256 of the source of a function, or of the class of a callable object; None if it is unknown."""
    try:
        source = inspect.getsource(function if hasattr(function, "__qualname__") else type(function))
    except (OSError, TypeError):
        return None
    return hashlib.sha256(source.encode()).hexdigest()
