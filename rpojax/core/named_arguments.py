"""Calls of users' functions with those named arguments that they declare."""

import difflib
import inspect
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, TypeVar

from rpojax.errors import RpojaxError

T = TypeVar("T")

_NAMED = (inspect.Parameter.POSITIONAL_OR_KEYWORD, inspect.Parameter.KEYWORD_ONLY)
_MISSPELT = 0.7
"""Similarity above which the name of an optional argument is taken for a misspelt one."""


def call(function: Callable[..., T], **arguments: Any) -> T:
    """Result of a function for those of the arguments that it declares, or all if it takes `**arguments`.

    Arguments that a `functools.partial` has bound keep their values.
    """
    parameters = inspect.signature(function).parameters.values()
    bound = _bound_names(function)
    wanted = {name: value for name, value in arguments.items() if name not in bound}
    if any(each.kind is inspect.Parameter.VAR_KEYWORD for each in parameters):
        return function(**wanted)
    return function(**{each.name: wanted[each.name] for each in parameters if each.name in wanted})


def takes(function: Any, name: str) -> bool:
    """Whether `call` hands the argument of that name to a function."""
    parameters = inspect.signature(function).parameters
    has_all = any(each.kind is inspect.Parameter.VAR_KEYWORD for each in parameters.values())
    return (has_all or name in parameters) and name not in _bound_names(function)


def _bound_names(function: Any) -> set[str]:
    return {*function.keywords, *_bound_names(function.func)} if isinstance(function, partial) else set()


def declares(function: Any, name: str) -> bool:
    """Whether a function has an argument of that name, be it one of many that it could do without."""
    return name in inspect.signature(function).parameters and name not in _bound_names(function)


def check(where: str, function: Any, model: Callable[..., Any], extra: Sequence[str] = ()) -> None:
    """Refuses a function that needs an argument which neither its `model` has nor is `extra`.

    `where` names it in the error.

    Raises:
        RpojaxError: it cannot be called, or has an argument of another or a misspelt name, or one by position.
    """
    known = [*(name for name in inspect.signature(model).parameters if name != "self"), *extra]
    expected = f"a function of some of {', '.join(known)}"
    try:
        parameters = inspect.signature(function).parameters.values()
    except (TypeError, ValueError):
        raise RpojaxError(f"{where}: found {function!r}, expected {expected}") from None
    bound = _bound_names(function)
    for each in parameters:
        if each.kind is inspect.Parameter.VAR_KEYWORD or each.name in bound:
            continue
        is_optional = each.default is not inspect.Parameter.empty
        is_own = is_optional and not difflib.get_close_matches(each.name, known, 1, _MISSPELT)
        if each.kind not in _NAMED or not (each.name in known or is_own):
            raise RpojaxError(f"{where}: found the argument '{each}', expected {expected}, by name")
