"""Run-time checks of argument types and array shapes in tests, on a sample of the calls of each function.

Functions of modules and of classes are checked: at their first calls, and then at one call of many, since a trace calls
the same few kernels thousands of times. Functions defined inside others are left out, as decorating them anew at each
call of the outer one took most of the time of a trace. With `RPOJAX_CHECK_EVERY_CALL=1` no call is left out.
"""

import ast
import functools
import os
import sys
from collections.abc import Callable, Sequence
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec, PathFinder, SourceFileLoader
from pathlib import Path
from types import CodeType, ModuleType
from typing import Any

from beartype import beartype
from jaxtyping import jaxtyped

_FIRST_CALLS = 4
_ONE_OF = 1 if os.environ.get("RPOJAX_CHECK_EVERY_CALL") else 64
_DECORATOR = "__import__('runtime_type_checks').checked"


def check_package(package: Path) -> None:
    """Checks the sub-packages of `package`, a folder with modules that are not imported yet."""
    names = [f"{package.name}.{folder.name}" for folder in package.iterdir() if (folder / "__init__.py").exists()]
    sys.meta_path.insert(0, _Finder(tuple(names)))


def checked(function: Callable[..., Any]) -> Callable[..., Any]:
    """`function` with its arguments and result checked at run time, at a sample of its calls.

    Constructors are not checked: JAX rebuilds records with placeholders such as shapes, axes or specs as leaves.
    """
    if function.__name__ == "__init__":
        return function
    calls = 0
    with_checks: Callable[..., Any] | None = None

    @functools.wraps(function)
    def sampled(*args: Any, **kwargs: Any) -> Any:
        nonlocal calls, with_checks
        calls += 1
        if calls > _FIRST_CALLS and calls % _ONE_OF:
            return function(*args, **kwargs)
        if with_checks is None:  # not before: most functions of the package are not called in a session
            with_checks = jaxtyped(function, typechecker=beartype)
        return with_checks(*args, **kwargs)

    return sampled


class _Finder(MetaPathFinder):
    """Finds the modules of the named packages, to be loaded with checks."""

    def __init__(self, packages: tuple[str, ...]) -> None:
        self._packages = packages

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        if not any(f"{fullname}.".startswith(f"{package}.") for package in self._packages):
            return None
        spec = PathFinder.find_spec(fullname, path, target)
        if spec is not None and isinstance(spec.loader, SourceFileLoader):
            spec.loader = _Loader(spec.loader.name, spec.loader.path)
        return spec


class _Loader(SourceFileLoader):
    """Loads a module whose functions and methods are checked."""

    def path_stats(self, path: Any) -> dict[str, Any]:
        raise OSError("compiled anew: bytecode in the cache would lack the checks, and ours must not get there")

    def source_to_code(self, data: Any, path: Any, *, _optimize: int = -1) -> CodeType:
        tree = ast.parse(data, path)
        for function in _outer_functions(tree):
            # Innermost, since other decorators hide the annotations.
            decorator = ast.parse(_DECORATOR, mode="eval").body
            function.decorator_list.append(ast.copy_location(decorator, function))
        return compile(ast.fix_missing_locations(tree), path, "exec", dont_inherit=True, optimize=_optimize)


def _outer_functions(node: ast.Module | ast.ClassDef) -> list[ast.FunctionDef]:
    classes = [child for child in node.body if isinstance(child, ast.ClassDef)]
    functions = [child for child in node.body if isinstance(child, ast.FunctionDef)]
    return functions + [function for each in classes for function in _outer_functions(each)]
