"""rpojax: differentiable, batched Monte Carlo simulation of vision-based rendezvous and proximity operations.

The public interface is the names that the file of types beside this one, `__init__.pyi`, imports. They load on first
use, so that importing the package, or asking the command line for help, is instant.
"""

import ast
import importlib
from pathlib import Path
from typing import Any

from rpojax.version import __version__ as __version__

_MODULE_OF = {
    alias.name: statement.module or ""
    for statement in ast.parse(Path(__file__).with_suffix(".pyi").read_text(encoding="utf-8")).body
    if isinstance(statement, ast.ImportFrom)
    for alias in statement.names
}
"""Public name -> its module."""

__all__ = sorted(_MODULE_OF)  # pyright: ignore[reportUnsupportedDunderAll]


def __getattr__(name: str) -> Any:
    if name not in _MODULE_OF:
        raise AttributeError(f"module 'rpojax' has no attribute {name!r}")
    jax_environment = importlib.import_module("rpojax.runtime.jax_environment")
    jax_environment.hide_compiler_log()
    return getattr(importlib.import_module(_MODULE_OF[name]), name)


def __dir__() -> list[str]:
    return __all__
