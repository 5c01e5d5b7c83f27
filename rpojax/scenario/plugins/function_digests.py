"""Digests of a function that tell whether it is the same in another process: of its source, and of what it holds."""

import functools
import hashlib
import inspect
import sys
from collections.abc import Mapping
from types import CodeType, FunctionType, SimpleNamespace
from typing import Any

import numpy as np

PLUGIN_MODULE = "rpojax_plugin_"
"""Begin of the name of a plugin file's module, which ends with the digest of the whole file."""


def qualified_name(function: Any) -> str:
    """Module and qualified name of a function, or of the class of a callable object.

    The name of a plugin file's module, which tells the content of the file, is left out where digests tell all that the
    function depends on: then another function in the file does not make this one another.
    """
    named = function if hasattr(function, "__qualname__") else type(function)
    module = named.__module__ or "__main__"  # code that was executed from a text may have none
    is_told = module.startswith(PLUGIN_MODULE) and inspect.isfunction(function) and _is_told(function, set())
    return f"{'plugin' if is_told else module}.{named.__qualname__}"


def _is_told(function: FunctionType, seen: set[int]) -> bool:
    """Whether digests hold the content of all that a function of a plugin file reads by name."""
    seen.add(id(function))
    for name in _names_in(function.__code__) & function.__globals__.keys():
        value = function.__globals__[name]
        if inspect.isfunction(value) and value.__module__ == function.__module__:
            own = (value.__closure__, value.__defaults__, value.__kwdefaults__, getattr(value, "__wrapped__", None))
            if any(each is not None for each in own) or (id(value) not in seen and not _is_told(value, seen)):
                return False
        elif isinstance(value, _PLAIN):
            try:
                _content(value, 1)
            except _NoContentError:
                return False
        elif not (inspect.ismodule(value) or _is_of_package(value)):
            return False
    return True


def _is_of_package(value: Any) -> bool:
    """Whether it is a function or class of an installed package, which is told by its version."""
    module = sys.modules.get(getattr(value, "__module__", None) or "")
    path = getattr(module, "__file__", None) or ""
    is_installed = "site-packages" in path or (module is not None and module.__name__.partition(".")[0] in _PACKAGES)
    return is_installed and (inspect.isroutine(value) or inspect.isclass(value))


def values_digest(function: Any) -> str | None:
    """SHA-256 of bound arguments, captured and read variables, defaults and fields; None if one has none of its own."""
    try:
        return hashlib.sha256(_content(function, 0).encode()).hexdigest()
    except _NoContentError:
        return None


class _NoContentError(Exception):
    """A value whose content cannot be told from its text."""


_PACKAGES = {"rpojax", *sys.stdlib_module_names}

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
        parts = (
            source_digest(value),
            cells,
            value.__defaults__,
            value.__kwdefaults__,
            unnamed,
            _read_globals(value, {id(value)}),
        )
    elif inspect.isroutine(value) or inspect.ismodule(value):
        parts = ()
    elif inspect.isclass(value):
        parts = (_class_content(value, {id(value)}),)
    elif hasattr(value, "__dict__"):
        parts = (vars(value),)
    else:
        raise _NoContentError
    name = qualified_name(value) if not inspect.ismodule(value) else value.__name__
    return name + "".join(_content(part, depth + 1) for part in parts)


_PLAIN = (str, bytes, int, float, complex, np.ndarray, list, tuple, set, frozenset, Mapping, SimpleNamespace)
"""Types of values whose content a function or class may depend on by a name."""


def _read_globals(function: FunctionType, seen: set[int]) -> dict[str, Any]:
    """Content of the global variables that a function reads: plain values, and what its own module's code is and reads.

    Other objects, such as modules, are left out: they have no content of their own or are told by the versions.
    """
    return {
        name: content
        for name in sorted(_names_in(function.__code__))
        if (content := _named_content(function.__globals__.get(name), function.__module__, seen)) is not None
    }


def _named_content(value: Any, module: str, seen: set[int]) -> Any:
    """Content of a value that has a name in a module, None where it has none of its own."""
    if isinstance(value, _PLAIN):
        try:
            return _content(value, 1)
        except _NoContentError:
            return None
    if id(value) in seen or getattr(value, "__module__", None) != module:
        return None
    seen.add(id(value))
    if inspect.isfunction(value):
        return source_digest(value), _read_globals(value, seen)
    return (source_digest(value), _class_content(value, seen)) if inspect.isclass(value) else None


def _class_content(value: type, seen: set[int]) -> dict[str, Any]:
    """Content of the plain attributes of a class, and of what its methods read."""
    attributes = {name: each for name, each in sorted(vars(value).items()) if not name.startswith("__")}
    methods = {name: getattr(each, "__func__", each) for name, each in attributes.items()}
    return {
        **{name: _named_content(each, "", seen) for name, each in attributes.items() if isinstance(each, _PLAIN)},
        **{name: _read_globals(each, seen) for name, each in methods.items() if inspect.isfunction(each)},
    }


def _names_in(code: CodeType) -> set[str]:
    """Names that code reads, that of inner functions included."""
    inner = [each for each in code.co_consts if inspect.iscode(each)]
    return set(code.co_names).union(*map(_names_in, inner))


def source_digest(function: Any) -> str | None:
    """SHA-256 of the source of a function, or of the class of a callable object; None if it is unknown."""
    try:
        source = inspect.getsource(function if hasattr(function, "__qualname__") else type(function))
    except (OSError, TypeError):
        return None
    return hashlib.sha256(source.encode()).hexdigest()
