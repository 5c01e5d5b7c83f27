"""Arrays as the files of a Zarr 3 store, made in memory: a file is then written once, whole, without looking at others.

Two workers that encode the same values make the same bytes, so it does not matter which of them is the last to write.
"""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import zarr
from zarr.storage import MemoryStore

_MAX_CHUNK_RUNS = 64
"""Runs in an inner chunk of a shard, at most: one of them is read without the others of its block."""
INTEGER_FILL_VALUE = -1
"""Fill value of whole numbers: that of a run that was never written."""


@dataclass(frozen=True)
class ArrayLayout:
    """How one array is laid out.

    Attributes:
        shape: of the whole array
        block: runs, or samples, in one file
        dtype: type of its values, as text
        dimensions: name of each axis
        attributes: pairs of name and text
    """

    shape: tuple[int, ...]
    rows_per_file: int
    dtype: str
    dimensions: tuple[str, ...]
    attributes: tuple[tuple[str, str], ...]


def per_run_layout(runs: int, block_size: int, group: str, values: np.ndarray, units: str) -> ArrayLayout:
    """Layout of an array with one row per run: a file per block, a shard for rows over time."""
    shape, names = (runs, *values.shape[1:]), dimension_names(group, values)
    return ArrayLayout(shape, min(block_size, runs), values.dtype.str, names, (("units", units),))


def dimension_names(group: str, values: np.ndarray) -> tuple[str, ...]:
    """Names of the axes of an array of a group, with one row per run."""
    long = ("time",) if group == "traces" else tuple(f"axis{i}_{n}" for i, n in enumerate(values.shape[1:], start=1))
    return ("run", *long)


def history_layout(name: str, values: np.ndarray, timed: bool) -> ArrayLayout:
    """Layout of a channel of one run, in one file."""
    first = ("time",) if timed else ()
    rest = tuple(f"axis{i}_{n}" for i, n in enumerate(values.shape) if not (timed and i == 0))
    block = values.shape[0] if values.ndim else 1
    return ArrayLayout(values.shape, block, values.dtype.str, (*first, *rest), (("long_name", name),))


class ArrayEncoder:
    """Encodes blocks of arrays; arrays of the same layout share what zarr prepares for it."""

    def __init__(self) -> None:
        self._templates: dict[ArrayLayout, tuple[dict[str, Any], Any]] = {}

    def metadata(self, layout: ArrayLayout) -> bytes:
        """The array's `zarr.json`."""
        return self._template(layout)[0]["zarr.json"].to_bytes()

    def encode_block(self, layout: ArrayLayout, block: int, values: np.ndarray) -> tuple[str, bytes]:
        """Path in the array's folder, and content, of the file that holds a block."""
        key = chunk_key(len(layout.shape), block)
        if not _is_sharded(layout):
            return key, _uncompressed(layout, values)
        stored, array = self._template(layout)
        begin = block * layout.rows_per_file
        array[begin : begin + len(values)] = values
        return key, stored.pop(key).to_bytes()

    def _template(self, layout: ArrayLayout) -> tuple[dict[str, Any], Any]:
        if layout not in self._templates:
            stored: dict[str, Any] = {}
            whole = (layout.rows_per_file, *layout.shape[1:])
            sharded = _is_sharded(layout)
            array = zarr.create_array(
                MemoryStore(stored),
                shape=layout.shape,
                chunks=(_chunk_runs(layout.rows_per_file), *whole[1:]) if sharded else whole,
                shards=whole if sharded else None,
                # Small files are not worth it.
                compressors="auto" if sharded else None,
                dtype=np.dtype(layout.dtype),
                fill_value=_fill_value(layout),
                dimension_names=layout.dimensions,
                attributes=dict(layout.attributes),
                # Chunks of nothing but the fill value are written too: one that is not there is one that was lost.
                config={"write_empty_chunks": True},
            )
            self._templates[layout] = (stored, array)
        return self._templates[layout]


def _is_sharded(layout: ArrayLayout) -> bool:
    """Whether an array has many samples per run."""
    return layout.dimensions[:2] == ("run", "time")


def _fill_value(layout: ArrayLayout) -> Any:
    """Value of what was never written."""
    dtype = np.dtype(layout.dtype)
    return np.nan if dtype.kind == "f" else dtype.type(INTEGER_FILL_VALUE if dtype.kind == "i" else 0)


def _uncompressed(layout: ArrayLayout, values: np.ndarray) -> bytes:
    """A block without compression, as Zarr's codec `bytes` has it: little-endian, filled up to the full size."""
    whole = np.full(
        (layout.rows_per_file, *layout.shape[1:]), _fill_value(layout), dtype=np.dtype(layout.dtype).newbyteorder("<")
    )
    whole[: len(values)] = values
    return whole.tobytes()


def _chunk_runs(block: int) -> int:
    """Largest divisor of a block's size that is at most the runs of an inner chunk."""
    return next(size for size in range(min(_MAX_CHUNK_RUNS, block), 0, -1) if block % size == 0)


def chunk_key(dimensions: int, block: int) -> str:
    """Path, in an array's folder, of the file that holds a block."""
    return "/".join(["c", str(block), *["0"] * (dimensions - 1)])


def group_metadata(attributes: Mapping[str, Any] | None = None) -> bytes:
    """The `zarr.json` of a group."""
    content = {"zarr_format": 3, "node_type": "group", "attributes": dict(attributes or {})}
    return json.dumps(content, indent=2).encode()


def digest(arrays: Mapping[str, np.ndarray]) -> str:
    """SHA-256 of names, types, shapes and values."""
    total = hashlib.sha256()
    for name in sorted(arrays):
        values = np.asarray(arrays[name])
        total.update(f"{name} {values.dtype.str} {values.shape}\n".encode())
        total.update(values.tobytes())
    return total.hexdigest()
