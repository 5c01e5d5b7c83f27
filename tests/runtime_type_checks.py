"""The type checker that the test session puts on every function of the package."""

from collections.abc import Callable
from typing import Any

from beartype import beartype


def type_checked(function: Callable[..., Any]) -> Callable[..., Any]:
    """`function` with its arguments and result checked at run time.

    Constructors are left alone: JAX itself rebuilds records with placeholders such as shapes, axes or specs as leaves.
    """
    return function if function.__name__ == "__init__" else beartype(function)
