"""Verified reading of `results.zarr`: every array is compared with the digest that was recorded when it was written."""

import math
import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import zarr
from zarr.core.buffer import default_buffer_prototype
from zarr.storage import MemoryStore

from rpojax.campaign.storage import atomic_files, safe_paths
from rpojax.campaign.storage.arrays import array_files, zarr_encoding
from rpojax.campaign.storage.arrays.array_files import LostFile
from rpojax.campaign.storage.block_manifests import Manifest
from rpojax.campaign.storage.campaign_configuration import CampaignConfiguration
from rpojax.campaign.storage.campaign_seal import array_binding
from rpojax.errors import ResultError, RpojaxError
from rpojax.untrusted.file_reading import FileKind, is_regular, read_bytes
from rpojax.untrusted.json_reading import parse_json

_BYTES_OF_ANY_ARRAY: Final = 64_000_000
"""Most bytes of an array that may be of any shape."""
_BYTES_PER_STORED_BYTE: Final = 20_000
"""Best ratio of compression, of values that are all equal."""
_OPTIONAL_GROUPS = ("drawn", "used", "events", "coverage", "phases", "signs")
"""Groups that need not exist: without numbers that vary, coverage or phases, and in folders of older versions."""


@dataclass(frozen=True)
class Rows:
    """Rows of some blocks of an array, with the fill value for blocks that are not `stored`."""

    values: np.ndarray
    stored: frozenset[int]

    def __contains__(self, block: int) -> bool:
        return block in self.stored


def read_rows(directory: Path, path: Path, configuration: CampaignConfiguration, blocks: Iterable[int]) -> Rows:
    """Rows of some blocks of an array with one row per run, in the folder `path` of a campaign `directory`.

    Raises:
        ResultError: a file cannot be read, or the array has another shape than that of the campaign.
    """
    wanted, size = list(blocks), configuration.block_size
    metadata = _metadata(directory, path)
    chunks = _chunks(directory, path, _dimensions(path, metadata), wanted)
    _check_size(path, metadata, sum(map(len, chunks.values())))
    array = _open(path, metadata, chunks)
    if array.ndim == 0 or array.shape[0] != configuration.options.runs:
        raise ResultError(f"{path}: found shape {array.shape}, expected {configuration.options.runs} rows")
    parts = [
        _values(path, array, slice(low * size, high * size + configuration.runs_in_block(high)))
        for low, high in _consecutive_ranges(wanted)
    ]
    keys = {block: array_files.chunk_key(array.ndim, block) for block in wanted}
    return Rows(np.concatenate(parts), frozenset(block for block, key in keys.items() if key in chunks))


def read_whole(directory: Path, path: Path) -> np.ndarray:
    """Values of an array in one file, in the folder `path` of a campaign `directory`.

    Raises:
        ResultError: a file is missing or cannot be read.
    """
    metadata = _metadata(directory, path)
    dimensions = _dimensions(path, metadata)
    chunks = _chunks(directory, path, dimensions, [0])
    if not chunks:
        place = path / array_files.chunk_key(dimensions, 0)
        raise ResultError(f"{place}: missing, expected the values of a channel")
    _check_size(path, metadata, sum(map(len, chunks.values())))
    return _values(path, _open(path, metadata, chunks), slice(None))


def _metadata(directory: Path, path: Path) -> bytes:
    return _read(directory, path / "zarr.json", FileKind.ARRAY_METADATA)


def _read(directory: Path, path: Path, kind: FileKind) -> bytes:
    safe_paths.check_no_links(directory, path)
    try:
        return read_bytes(path, kind)
    except RpojaxError as error:
        raise ResultError(str(error)) from None


def _chunks(directory: Path, path: Path, dimensions: int, blocks: Iterable[int]) -> dict[str, bytes]:
    """Content of the files of some blocks, by their keys; files that do not exist are left out."""
    found = {}
    for block in blocks:
        key = array_files.chunk_key(dimensions, block)
        safe_paths.check_no_links(directory, path / key)
        if is_regular(path / key):
            found[key] = _read(directory, path / key, FileKind.ARRAY_CHUNK)
    return found


def _dimensions(path: Path, metadata: bytes) -> int:
    return len(_shape(path, _parsed(path, metadata).get("shape")))


def _parsed(path: Path, metadata: bytes) -> dict[str, Any]:
    try:
        content = parse_json(metadata)
    except RpojaxError as error:
        raise ResultError(f"{path}: found metadata of which {error}") from None
    if not isinstance(content, dict):
        raise ResultError(f"{path}: found {type(content).__name__}, expected the metadata of an array")
    return content


def _shape(path: Path, value: Any) -> list[int]:
    whole = isinstance(value, list) and all(type(length) is int and length >= 0 for length in value)
    if not whole or len(value) > 16:
        raise ResultError(f"{path}: found shape {value!r:.80}, expected whole numbers")
    return value


def _check_size(path: Path, metadata: bytes, stored: int) -> None:
    """Refuses an array, or a chunk of it, that its files cannot fill.

    Raises:
        ResultError: naming its shape.
    """
    content = _parsed(path, metadata)
    grid = content.get("chunk_grid")
    setting = grid.get("configuration") if isinstance(grid, dict) else None
    chunk = setting.get("chunk_shape") if isinstance(setting, dict) else None
    try:
        item = np.dtype(content["data_type"]).itemsize
    except (KeyError, TypeError, ValueError):
        raise ResultError(f"{path}: found type {content.get('data_type')!r:.60}, expected that of numbers") from None
    most = _BYTES_OF_ANY_ARRAY + _BYTES_PER_STORED_BYTE * stored
    for shape in (_shape(path, content.get("shape")), _shape(path, chunk)):
        if math.prod(shape) * item > most:
            raise ResultError(f"{path}: found shape {shape}, expected one that its files of {stored} bytes can hold")


def _consecutive_ranges(blocks: Sequence[int]) -> list[tuple[int, int]]:
    """First and last block of every range of consecutive blocks."""
    ends = [i for i, block in enumerate(blocks) if i + 1 == len(blocks) or blocks[i + 1] != block + 1]
    starts = [0, *(end + 1 for end in ends[:-1])]
    return [(blocks[start], blocks[end]) for start, end in zip(starts, ends, strict=True)]


def _open(path: Path, metadata: bytes, chunks: Mapping[str, bytes]) -> Any:
    """Array in memory of the content of its files."""
    buffer = default_buffer_prototype().buffer
    stored = {name: buffer.from_bytes(content) for name, content in {"zarr.json": metadata, **chunks}.items()}
    try:
        return zarr.open_array(MemoryStore(stored), mode="r")
    # zarr and its codecs raise many kinds of exceptions for corrupt bytes.
    except Exception as error:
        raise _unreadable(path, error) from None


def _values(path: Path, array: Any, rows: slice) -> np.ndarray:
    try:
        return np.asarray(array[rows])
    except Exception as error:
        raise _unreadable(path, error) from None


def _unreadable(path: Path, error: Exception) -> ResultError:
    reason = " ".join(str(error).split()) or type(error).__name__
    return ResultError(f"{path}: found {reason:.200}, expected readable arrays")


def read_group(
    directory: Path, configuration: CampaignConfiguration, name: str, manifests: Mapping[int, Manifest]
) -> dict[str, np.ndarray]:
    """Arrays of a group, with the rows of the blocks in `manifests`.

    Blocks of an older version lack the arrays that it did not know: their rows have the fill value.

    Raises:
        ResultError: an array is missing, cannot be read or is not what was written.
    """
    if not any(name in entry.sha256 for entry in manifests.values()):
        if name in _OPTIONAL_GROUPS or name.startswith("servicer_") or not manifests:
            return {}
        raise ResultError(f"{directory / 'manifest'}: found no digest of {name!r}, expected one in every manifest")
    folder = directory / "results.zarr" / name
    lost = array_files.lost_of_group(directory, name, manifests)
    for block, file in lost.items():
        if file.is_there:
            raise _lost(file, block)
    found = {path: read_rows(directory, path, configuration, manifests) for path in _array_folders(directory, folder)}
    first = 0
    for block, entry in manifests.items():
        there = {path.name: rows.values[first : first + entry.count] for path, rows in found.items() if block in rows}
        binding = array_binding(configuration.seal, name, configuration.options.first_run + entry.first, entry.count)
        if (zarr_encoding.digest(there, binding) if there else None) != entry.sha256.get(name):
            if block in lost:
                raise _lost(lost[block], block)
            raise ResultError(
                f"{folder}: found other values in block {block}, expected those that its manifest names "
                "(without the manifest, a resume runs the block again)"
            )
        first += entry.count
    return {path.name: rows.values for path, rows in found.items()}


def _lost(file: LostFile, block: int) -> ResultError:
    found = "found a file cut short, expected readable arrays with" if file.is_there else "missing, expected"
    return ResultError(f"{file.path}: {found} the values of block {block} (`rpojax resume` simulates it again)")


def read_history(directory: Path, configuration: CampaignConfiguration, run_id: int) -> dict[str, np.ndarray]:
    """Channels of a run with a stored history.

    Raises:
        ResultError: a channel is missing, cannot be read or is not what was written.
    """
    folder = directory / "results.zarr" / "histories" / str(run_id)
    return _read_whole_group(directory, folder, array_binding(configuration.seal, "histories", run_id))


def read_surface(directory: Path, configuration: CampaignConfiguration) -> dict[str, np.ndarray]:
    """Facets of the target, empty if there are none: the metadata of their group, written last, say that there are.

    Raises:
        ResultError: an array is missing, cannot be read or is not what was written.
    """
    folder = directory / "results.zarr" / "surface"
    binding = array_binding(configuration.seal, "surface", 0, configuration.options.runs)
    is_complete = os.path.lexists(folder / array_files.METADATA)
    return _read_whole_group(directory, folder, binding) if is_complete else {}


def _read_whole_group(directory: Path, folder: Path, binding: str) -> dict[str, np.ndarray]:
    channels = {path.name: read_whole(directory, path) for path in _array_folders(directory, folder)}
    content = atomic_files.read_json(folder / "zarr.json", "a group of channels", FileKind.ARRAY_METADATA)
    attributes = content.get("attributes") if isinstance(content, dict) else None
    if not isinstance(attributes, dict) or attributes.get("sha256") != zarr_encoding.digest(channels, binding):
        raise ResultError(f"{folder}: found other values, expected readable arrays with the digest in its zarr.json")
    return channels


def _array_folders(directory: Path, folder: Path) -> list[Path]:
    """Folders of the arrays of a group."""
    safe_paths.check_no_links(directory, folder)
    try:
        paths = sorted(path for path in folder.iterdir() if path.is_dir() and not path.name.startswith("."))
    except OSError:
        raise ResultError(f"{folder}: missing, expected the arrays of a campaign") from None
    for path in paths:
        safe_paths.check_no_links(directory, path)
    return paths
