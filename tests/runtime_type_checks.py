"""Run-time checks of argument types and array shapes, applied to every function of the package in tests."""

from collections.abc import Callable
from typing import Any

from beartype import beartype


def type_checked(function: Callable[..., Any]) -> Callable[..., Any]:
    """`function` with its arguments and result checked at run time.

    Constructors are not checked: JAX rebuilds records with placeholders such as shapes, axes or specs as leaves.
    """
    return function if function.__name__ == "__init__" else beartype(function)
