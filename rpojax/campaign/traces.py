"""Traced functions, kept for later processes: tracing takes longer than to load what is compiled already."""

import contextlib
import functools
import hashlib
import os
import tempfile
from collections.abc import Callable, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

import jax
from jax import export
from jax.export import Exported

import rpojax

FOLDER = "RPOJAX_TRACES"
"""Environment variable with the folder where traces are kept; without it none is."""

_CHECK = hashlib.sha256().digest_size


def traced(function: Callable[..., Any], arguments: Sequence[Any], meaning: str | None = None) -> Exported:
    """`function` traced for arguments of these shapes, from an earlier process if that has left it.

    `meaning` is all that the trace depends on besides the shapes, this package and JAX; without it nothing is kept.
    """
    folder = os.environ.get(FOLDER)
    if meaning is None or not folder:
        return export.export(jax.jit(function))(*arguments)
    path = Path(folder) / f"{_key(arguments, meaning)}.trace"
    content = _read(path)
    if content is None:
        content = bytes(export.export(jax.jit(function))(*arguments).serialize())
        with contextlib.suppress(OSError):
            _write(path, content)
    # What is kept is what is used, so that the first process computes the same numbers as the next ones.
    return export.deserialize(bytearray(content))


def results(trace: Exported) -> Any:
    """Shapes and types of what a traced function gives, in its structure."""
    found = [jax.ShapeDtypeStruct(each.shape, each.dtype) for each in trace.out_avals]
    return jax.tree.unflatten(trace.out_tree, found)


def _key(arguments: Sequence[Any], meaning: str) -> str:
    leaves, structure = jax.tree.flatten(tuple(arguments))
    shapes = [(each.shape, str(each.dtype)) for each in leaves]
    versions = (_source_digest(), jax.__version__, version("jaxlib"), jax.default_backend())
    settings = (jax.config.jax_enable_x64, str(jax.config.jax_default_matmul_precision))  # pyright: ignore[reportAttributeAccessIssue]
    return hashlib.sha256(repr((meaning, shapes, str(structure), versions, settings)).encode()).hexdigest()


@functools.cache
def _source_digest() -> str:
    """Hash of this package's code: a trace made by other code is of no use."""
    folder = Path(rpojax.__file__).parent
    found = hashlib.sha256()
    for path in sorted(folder.rglob("*.py")):
        found.update(f"{path.relative_to(folder)}\0".encode() + path.read_bytes())
    return found.hexdigest()


def _read(path: Path) -> bytes | None:
    """What is kept in a file, or None where there is none or it has been damaged."""
    try:
        found = path.read_bytes()
    except OSError:
        return None
    check, content = found[:_CHECK], found[_CHECK:]
    return content if hashlib.sha256(content).digest() == check else None


def _write(path: Path, content: bytes) -> None:
    """All or nothing, since several processes may look for the same trace at the same time."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.NamedTemporaryFile(dir=path.parent, suffix=".part", delete=False) as file:
        file.write(hashlib.sha256(content).digest() + content)
    Path(file.name).replace(path)
