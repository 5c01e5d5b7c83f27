"""Traced functions, kept for later processes: tracing takes longer than to load what is compiled already."""

import contextlib
import gc
import hashlib
import os
import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

import jax
from jax import export
from jax.extend import core

import rpojax

FOLDER_VARIABLE = "RPOJAX_TRACES"
"""Environment variable with the folder where traces are kept; without it none is."""

_DIGEST_SIZE = hashlib.sha256().digest_size
_PACKAGES = ("jax", "jaxlib", "flax", "numpy", "scipy")
_JAX_SETTINGS = (
    *("jax_enable_x64", "jax_default_matmul_precision", "jax_default_prng_impl", "jax_threefry_partitionable"),
    "jax_numpy_dtype_promotion",
)
"""Of JAX, on which it depends what is traced."""


@dataclass(frozen=True)
class Trace:
    """A traced function.

    Attributes:
        call: the function; tracing that once more takes next to no time
        results: shapes and types of what it gives, in its structure
    """

    call: Callable[..., Any]
    outputs: Any


def load_or_trace(function: Callable[..., Any], arguments: Sequence[Any], identity: str | None = None) -> Trace:
    """`function` traced for arguments of these shapes, from an earlier process if that has left it.

    `meaning` is all that the trace depends on besides the shapes, this package and JAX; without it nothing is kept,
    and the function may do what cannot be kept, such as print.
    """
    if identity is None:
        return _trace_without_cache(function, arguments)
    folder = os.environ.get(FOLDER_VARIABLE)
    path = Path(folder) / f"{_cache_key(arguments, identity)}.trace" if folder else None
    content = _read(path) if path else None
    if content is None:
        with _no_garbage_collection():
            made = export.export(jax.jit(function))(*arguments)
        try:
            content = bytes(made.serialize())
        except ValueError:
            # Records of a module that was loaded anew have no name that could be kept.
            return _trace_of_export(made)
        if path is not None and _source_digest() == _LOADED_SOURCE:
            with contextlib.suppress(OSError):
                _write(path, content)
    # What is kept is what is used, so that the first process computes the same numbers as the next ones.
    return _trace_of_export(export.deserialize(bytearray(content)))


@contextlib.contextmanager
def _no_garbage_collection() -> Iterator[None]:
    """Tracing makes millions of objects that stay, and looking through them for garbage takes a fifth of its time.

    Where two threads trace at once, the one that ends first ends it for both.
    """
    collecting = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if collecting:
            gc.enable()


def _trace_without_cache(function: Callable[..., Any], arguments: Sequence[Any]) -> Trace:
    with _no_garbage_collection():
        found, results = jax.make_jaxpr(function, return_shape=True)(*arguments)
    structure = jax.tree.structure(results)

    def call(*arguments: Any) -> Any:
        return jax.tree.unflatten(structure, core.jaxpr_as_fun(found)(*jax.tree.leaves(arguments)))

    return Trace(call, results)


def _trace_of_export(made: export.Exported) -> Trace:
    results = [jax.ShapeDtypeStruct(each.shape, each.dtype) for each in made.out_avals]
    return Trace(made.call, jax.tree.unflatten(made.out_tree, results))


def _cache_key(arguments: Sequence[Any], identity: str) -> str:
    leaves, structure = jax.tree.flatten(tuple(arguments))
    shapes = [(each.shape, str(each.dtype)) for each in leaves]
    versions = (_LOADED_SOURCE, export.default_export_platform(), *map(version, _PACKAGES))
    settings = [str(getattr(jax.config, name)) for name in _JAX_SETTINGS]
    return hashlib.sha256(repr((identity, shapes, str(structure), versions, settings)).encode()).hexdigest()


def _source_digest() -> str:
    """Hash of this package's code as it lies on the disk."""
    folder = Path(rpojax.__file__).parent
    found = hashlib.sha256()
    for path in sorted(folder.rglob("*.py")):
        found.update(f"{path.relative_to(folder)}\0".encode() + path.read_bytes())
    return found.hexdigest()


_LOADED_SOURCE = _source_digest()
"""The code that this process has loaded: a trace of other code is of no use, and none is kept once it has changed."""


def _read(path: Path) -> bytes | None:
    """What is kept in a file, or None where there is none or it has been damaged."""
    try:
        found = path.read_bytes()
    except OSError:
        return None
    check, content = found[:_DIGEST_SIZE], found[_DIGEST_SIZE:]
    return content if hashlib.sha256(content).digest() == check else None


def _write(path: Path, content: bytes) -> None:
    """All or nothing, since several processes may look for the same trace at the same time."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.NamedTemporaryFile(dir=path.parent, suffix=".part", delete=False) as file:
        part = Path(file.name)
    try:
        part.write_bytes(hashlib.sha256(content).digest() + content)
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)
