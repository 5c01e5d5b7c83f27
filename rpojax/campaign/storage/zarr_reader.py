"""Verified reading of `results.zarr`: every array is compared with the digest that was recorded when it was written."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import zarr

from rpojax.campaign.storage import atomic_files, safe_paths, zarr_encoding
from rpojax.campaign.storage.block_manifests import Manifest
from rpojax.campaign.storage.campaign_configuration import CampaignConfiguration
from rpojax.errors import ResultError, RpojaxError

_OPTIONAL_GROUPS = ("drawn", "used", "events", "coverage", "phases")
"""Groups that need not exist: without numbers that vary, coverage or phases, and in folders of older versions."""


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
    found = {path: _read_rows(directory, path, configuration, manifests) for path in _array_folders(directory, folder)}
    first = 0
    for block, entry in manifests.items():
        there = {path.name: rows.values[first : first + entry.count] for path, rows in found.items() if block in rows}
        if (zarr_encoding.digest(there) if there else None) != entry.sha256.get(name):
            for path, rows in found.items():
                if block not in rows:
                    raise ResultError(f"{path}: found nothing, expected the values of block {block}")
            raise ResultError(
                f"{folder}: found other values in block {block}, expected those that its manifest names "
                "(without the manifest, a resume runs the block again)"
            )
        first += entry.count
    return {path.name: rows.values for path, rows in found.items()}


def read_history(directory: Path, run_id: int) -> dict[str, np.ndarray]:
    """Channels of a run with a stored history.

    Raises:
        ResultError: a channel is missing, cannot be read or is not what was written.
    """
    return _read_whole_group(directory, directory / "results.zarr" / "histories" / str(run_id))


def read_surface(directory: Path) -> dict[str, np.ndarray]:
    """Facets of the target, empty if there are none.

    Raises:
        ResultError: an array is missing, cannot be read or is not what was written.
    """
    folder = directory / "results.zarr" / "surface"
    return _read_whole_group(directory, folder) if folder.exists() else {}


def _read_whole_group(directory: Path, folder: Path) -> dict[str, np.ndarray]:
    channels = {path.name: _read_array(directory, path) for path in _array_folders(directory, folder)}
    content = atomic_files.read_json(folder / "zarr.json", "a group of channels", 1_000_000)
    attributes = content.get("attributes") if isinstance(content, dict) else None
    if not isinstance(attributes, dict) or attributes.get("sha256") != zarr_encoding.digest(channels):
        raise ResultError(f"{folder}: found other values, expected readable arrays with the digest in its zarr.json")
    return channels


def stored_history_ids(directory: Path, first_run: int, runs: int) -> list[int]:
    """Numbers of the runs with a complete history: one whose group metadata, written last, exists."""
    folder = directory / "results.zarr" / "histories"
    safe_paths.check_no_links(directory, folder)
    try:
        names = [path.name for path in folder.iterdir() if (path / "zarr.json").is_file()]
    except OSError:
        return []
    numbers = [int(name) for name in names if name.isdecimal() and name.isascii() and len(name) <= 10]
    return sorted(number for number in numbers if str(number) in names and first_run <= number < first_run + runs)


def _array_folders(directory: Path, folder: Path) -> list[Path]:
    """Folders of the arrays of a group."""
    safe_paths.check_no_links(directory, folder)
    try:
        paths = sorted(path for path in folder.iterdir() if path.is_dir() and not path.name.startswith("."))
    except OSError:
        raise ResultError(f"{folder}: found nothing, expected the arrays of a campaign") from None
    for path in paths:
        safe_paths.check_no_links(directory, path)
    return paths


@dataclass(frozen=True)
class _Rows:
    """Rows of some blocks of an array, with the fill value for blocks that are not `stored`."""

    values: np.ndarray
    stored: frozenset[int]

    def __contains__(self, block: int) -> bool:
        return block in self.stored


def _read_rows(directory: Path, path: Path, configuration: CampaignConfiguration, blocks: Iterable[int]) -> _Rows:
    """Rows of some blocks of an array."""
    array, wanted = _open_array(path), list(blocks)
    if array.ndim == 0 or array.shape[0] != configuration.options.runs:
        raise ResultError(f"{path}: found shape {array.shape}, expected {configuration.options.runs} rows")
    size = configuration.block_size
    parts = [
        _read_values(path, array, slice(low * size, high * size + configuration.runs_in_block(high)))
        for low, high in _consecutive_ranges(wanted)
    ]
    files = {block: path / zarr_encoding.chunk_key(array.ndim, block) for block in wanted}
    for file in files.values():
        safe_paths.check_no_links(directory, file)
    return _Rows(np.concatenate(parts), frozenset(block for block, file in files.items() if file.is_file()))


def _consecutive_ranges(blocks: Sequence[int]) -> list[tuple[int, int]]:
    """First and last block of every range of consecutive blocks."""
    ends = [i for i, block in enumerate(blocks) if i + 1 == len(blocks) or blocks[i + 1] != block + 1]
    starts = [0, *(end + 1 for end in ends[:-1])]
    return [(blocks[start], blocks[end]) for start, end in zip(starts, ends, strict=True)]


def _read_array(directory: Path, path: Path) -> np.ndarray:
    array = _open_array(path)
    _check_file(directory, path / zarr_encoding.chunk_key(array.ndim, 0), "the values of a channel")
    return _read_values(path, array, slice(None))


def _check_file(directory: Path, path: Path, expected: str) -> None:
    safe_paths.check_no_links(directory, path)
    if not path.is_file():
        raise ResultError(f"{path}: found nothing, expected {expected}")


def _open_array(path: Path) -> Any:
    try:
        return zarr.open_array(str(path), mode="r")
    # zarr and its codecs raise many kinds of exceptions for corrupt bytes.
    except Exception as error:
        raise _unreadable(path, error) from None


def _read_values(path: Path, array: Any, rows: slice) -> np.ndarray:
    try:
        return np.asarray(array[rows])
    except RpojaxError:
        raise
    except Exception as error:
        raise _unreadable(path, error) from None


def _unreadable(path: Path, error: Exception) -> ResultError:
    reason = " ".join(str(error).split()) or type(error).__name__
    return ResultError(f"{path}: found {reason:.200}, expected readable arrays")
