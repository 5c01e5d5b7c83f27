"""Encoding of arrays as the files of a Zarr 3 store in memory, so that each file can be written once and whole.

Equal values are encoded as equal bytes by every process, so several may write the same block.
"""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import zarr
from zarr.storage import MemoryStore

from rpojax.campaign.storage.arrays.array_files import chunk_key
from rpojax.metrics import metric_catalogue
from rpojax.scenario.numbers import key_units
from rpojax.simulation.metrics import decimated_traces, phase_records

_MAX_CHUNK_RUNS = 64
"""Largest number of runs in an inner chunk of a shard, which can be read without the rest of the block."""
NOT_RECORDED = -1
"""Fill value of integers, for runs that were never written."""
CHANNEL_UNITS = {
    **dict.fromkeys(("rho_H", "rho_estimate_H", "rho_desired_H", "r_ST_N", "r_TN_N"), "m"),
    **dict.fromkeys(("relative_error_H", "servicer_error_H", "target_error_H"), "m"),
    **dict.fromkeys(("relative_sigma_H", "servicer_sigma_H", "target_sigma_H"), "m"),
    "v_ST_N": "m/s",
}
"""Units of the channels of histories whose names do not end with them."""


@dataclass(frozen=True)
class ArrayLayout:
    """Shape, chunks and metadata of one array.

    Attributes:
        shape: of the whole array
        rows_per_file: runs, or samples, in one file
        dtype: NumPy's code of the data type
        dimensions: name of each axis
        attributes: pairs of name and text
    """

    shape: tuple[int, ...]
    rows_per_file: int
    dtype: str
    dimensions: tuple[str, ...]
    attributes: tuple[tuple[str, str], ...]


def per_run_layout(runs: int, block_size: int, group: str, values: np.ndarray, units: str) -> ArrayLayout:
    """Layout of an array with one row per run: one file per block, a shard if the rows are time series."""
    shape, names = (runs, *values.shape[1:]), dimension_names(group, values)
    return ArrayLayout(shape, min(block_size, runs), values.dtype.str, names, (("units", units),))


def dimension_names(group: str, values: np.ndarray) -> tuple[str, ...]:
    """Names of the axes of an array with one row per run."""
    components = tuple(f"axis{i}_{n}" for i, n in enumerate(values.shape[1:], start=1))
    return ("run", *(("time",) if group == "traces" else components))


def history_layout(name: str, values: np.ndarray, is_time_series: bool) -> ArrayLayout:
    """Layout of a channel of one run, in one file."""
    first = ("time",) if is_time_series else ()
    rest = tuple(f"axis{i}_{n}" for i, n in enumerate(values.shape) if not (is_time_series and i == 0))
    rows = values.shape[0] if values.ndim else 1
    return ArrayLayout(values.shape, rows, values.dtype.str, (*first, *rest), (("long_name", name),))


class ArrayEncoder:
    """Encodes blocks of arrays; arrays of the same layout share one zarr array in memory."""

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
        """Files of an array in memory, and the array."""
        if layout not in self._templates:
            stored: dict[str, Any] = {}
            block_shape = (layout.rows_per_file, *layout.shape[1:])
            sharded = _is_sharded(layout)
            array = zarr.create_array(
                MemoryStore(stored),
                shape=layout.shape,
                chunks=(_chunk_runs(layout.rows_per_file), *block_shape[1:]) if sharded else block_shape,
                shards=block_shape if sharded else None,
                # Compression does not pay for small files.
                compressors="auto" if sharded else None,
                dtype=np.dtype(layout.dtype),
                fill_value=_fill_value(layout),
                dimension_names=layout.dimensions,
                attributes=dict(layout.attributes),
                # Chunks that hold only the fill value are written too, so that a missing file means lost data.
                config={"write_empty_chunks": True},
            )
            self._templates[layout] = (stored, array)
        return self._templates[layout]


def _is_sharded(layout: ArrayLayout) -> bool:
    """Whether an array has many samples per run."""
    return layout.dimensions[:2] == ("run", "time")


def _fill_value(layout: ArrayLayout) -> Any:
    """Value of elements that were never written."""
    dtype = np.dtype(layout.dtype)
    return np.nan if dtype.kind == "f" else dtype.type(NOT_RECORDED if dtype.kind == "i" else 0)


def _uncompressed(layout: ArrayLayout, values: np.ndarray) -> bytes:
    """A block as Zarr's codec `bytes` encodes it: little-endian, without compression, padded to the full size."""
    shape, dtype = (layout.rows_per_file, *layout.shape[1:]), np.dtype(layout.dtype).newbyteorder("<")
    padded = np.full(shape, _fill_value(layout), dtype=dtype)
    padded[: len(values)] = values
    return padded.tobytes()


def _chunk_runs(block_size: int) -> int:
    """Largest divisor of the block size that is at most `_MAX_CHUNK_RUNS`."""
    return next(size for size in range(min(_MAX_CHUNK_RUNS, block_size), 0, -1) if block_size % size == 0)


def group_metadata(attributes: Mapping[str, Any] | None = None) -> bytes:
    """The `zarr.json` of a group."""
    content = {"zarr_format": 3, "node_type": "group", "attributes": dict(attributes or {})}
    return json.dumps(content, indent=2).encode()


def digest(arrays: Mapping[str, np.ndarray], binding: str = "") -> str:
    """SHA-256 of names, types, shapes and values, and of the text that binds them to their place in a campaign."""
    total = hashlib.sha256(binding.encode())
    for name in sorted(arrays):
        values = np.asarray(arrays[name])
        total.update(f"{name} {values.dtype.str} {values.shape}\n".encode())
        total.update(values.tobytes())
    return total.hexdigest()


def array_units(group: str, name: str) -> str:
    """Unit of an array of a group as text; 1 for dimensionless quantities."""
    match group.removeprefix("servicer_"):
        case "metrics":
            unit = metric_catalogue.unit_of(name)
        case "traces":
            unit = decimated_traces.TRACE_UNITS.get(name, "-")
        case "status" | "events":
            unit = "s" if name.endswith("_s") else "-"
        case "phases":
            unit = phase_records.UNITS.get(name, "-")
        case "coverage" | "signs":
            unit = "-"
        case "histories":
            unit = CHANNEL_UNITS.get(name) or key_units.unit_symbol(name)
        case _:
            unit = key_units.unit_symbol(name)
    return "1" if unit == "-" else unit
