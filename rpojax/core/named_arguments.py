"""Calls of users' functions with those named arguments that they declare."""

import inspect
from collections.abc import Callable
from typing import Any, TypeVar

from rpojax.errors import RpojaxError

T = TypeVar("T")

_NAMED = (inspect.Parameter.POSITIONAL_OR_KEYWORD, inspect.Parameter.KEYWORD_ONLY)


def call(function: Callable[..., T], **arguments: Any) -> T:
    """Result of a function for those of the arguments that it declares, or all if it takes `**arguments`."""
    parameters = inspect.signature(function).parameters.values()
    if any(each.kind is inspect.Parameter.VAR_KEYWORD for each in parameters):
        return function(**arguments)
    return function(**{each.name: arguments[each.name] for each in parameters if each.name in arguments})


def check(where: str, function: Any, model: Callable[..., Any]) -> None:
    """Refuses a function that needs an argument which its `model` does not have; `where` names it in the error.

    Raises:
        RpojaxError: it cannot be called, or needs an argument of another name, or one by position.
    """
    known = [name for name in inspect.signature(model).parameters if name != "self"]
    expected = f"a function of some of {', '.join(known)}"
    try:
        parameters = inspect.signature(function).parameters.values()
    except (TypeError, ValueError):
        raise RpojaxError(f"{where}: found {function!r}, expected {expected}") from None
    for each in parameters:
        needed = each.default is inspect.Parameter.empty and each.kind is not inspect.Parameter.VAR_KEYWORD
        if needed and (each.kind not in _NAMED or each.name not in known):
            raise RpojaxError(f"{where}: found the argument '{each}', expected {expected}, by name")
