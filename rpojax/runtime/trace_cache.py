"""Cache of traced functions on disk: tracing the closed loop takes longer than loading its compiled program."""

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
"""Environment variable with the folder of the cache; without it traces are not cached."""

_DIGEST_SIZE = hashlib.sha256().digest_size
_PACKAGES = ("jax", "jaxlib", "flax", "numpy", "scipy")
_JAX_SETTINGS = (
    *("jax_enable_x64", "jax_default_matmul_precision", "jax_default_prng_impl", "jax_threefry_partitionable"),
    "jax_numpy_dtype_promotion",
)
"""JAX settings that a trace depends on."""


@dataclass(frozen=True)
class Trace:
    """A traced function.

    Attributes:
        call: the traced function; tracing it again takes almost no time
        outputs: shapes and types of its results, as a pytree
    """

    call: Callable[..., Any]
    outputs: Any


def load_or_trace(function: Callable[..., Any], arguments: Sequence[Any], identity: str | None = None) -> Trace:
    """`function` traced for arguments of these shapes, from the cache if it is there.

    `identity` is everything that the trace depends on besides the shapes, this package and JAX. Without it the trace is
    not cached, and the function may have effects that cannot be serialised, such as printing.
    """
    if identity is None:
        return _trace_without_cache(function, arguments)
    folder = os.environ.get(FOLDER_VARIABLE)
    path = Path(folder) / f"{_cache_key(arguments, identity)}.trace" if folder else None
    content = _read(path) if path else None
    if content is None:
        with _no_garbage_collection():
            exported = export.export(jax.jit(function))(*arguments)
        try:
            content = bytes(exported.serialize())
        except ValueError:
            # Records of a reloaded module are not registered for serialisation.
            return _trace_of_export(exported)
        if path is not None and _source_digest() == _LOADED_SOURCE:
            with contextlib.suppress(OSError):
                _write(path, content)
    # The serialised trace is used at once, so that the first process computes the same numbers as later ones.
    return _trace_of_export(export.deserialize(bytearray(content)))


@contextlib.contextmanager
def _no_garbage_collection() -> Iterator[None]:
    """Suspends the garbage collector: tracing creates millions of live objects, and scanning them takes a fifth of it.

    If two threads trace at once, the collector resumes when the first ends.
    """
    was_enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_enabled:
            gc.enable()


def _trace_without_cache(function: Callable[..., Any], arguments: Sequence[Any]) -> Trace:
    with _no_garbage_collection():
        jaxpr, outputs = jax.make_jaxpr(function, return_shape=True)(*arguments)
    structure = jax.tree.structure(outputs)

    def call(*arguments: Any) -> Any:
        return jax.tree.unflatten(structure, core.jaxpr_as_fun(jaxpr)(*jax.tree.leaves(arguments)))

    return Trace(call, outputs)


def _trace_of_export(exported: export.Exported) -> Trace:
    outputs = [jax.ShapeDtypeStruct(each.shape, each.dtype) for each in exported.out_avals]
    return Trace(exported.call, jax.tree.unflatten(exported.out_tree, outputs))


def _cache_key(arguments: Sequence[Any], identity: str) -> str:
    leaves, structure = jax.tree.flatten(tuple(arguments))
    shapes = [(each.shape, str(each.dtype)) for each in leaves]
    versions = (_LOADED_SOURCE, export.default_export_platform(), *map(version, _PACKAGES))
    settings = [str(getattr(jax.config, name)) for name in _JAX_SETTINGS]
    return hashlib.sha256(repr((identity, shapes, str(structure), versions, settings)).encode()).hexdigest()


def _source_digest() -> str:
    """Hash of the source files of this package on disk."""
    folder = Path(rpojax.__file__).parent
    digest = hashlib.sha256()
    for path in sorted(folder.rglob("*.py")):
        digest.update(f"{path.relative_to(folder)}\0".encode() + path.read_bytes())
    return digest.hexdigest()


_LOADED_SOURCE = _source_digest()
"""Hash of the code that this process has loaded; nothing is cached after the files have changed."""


def _read(path: Path) -> bytes | None:
    """Content of a cache file, or None if it is missing or damaged."""
    try:
        stored = path.read_bytes()
    except OSError:
        return None
    digest, content = stored[:_DIGEST_SIZE], stored[_DIGEST_SIZE:]
    return content if hashlib.sha256(content).digest() == digest else None


def _write(path: Path, content: bytes) -> None:
    """Writes a cache file atomically, since several processes may read it at the same time."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.NamedTemporaryFile(dir=path.parent, suffix=".part", delete=False) as file:
        partial = Path(file.name)
    try:
        partial.write_bytes(hashlib.sha256(content).digest() + content)
        partial.replace(path)
    finally:
        partial.unlink(missing_ok=True)
