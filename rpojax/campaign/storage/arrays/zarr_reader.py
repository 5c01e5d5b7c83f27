"""Verified reading of `results.zarr`: every array is compared with the digest that was recorded when it was written."""

import os
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from rpojax.campaign.storage import atomic_files, safe_paths
from rpojax.campaign.storage.arrays import zarr_arrays, zarr_encoding
from rpojax.campaign.storage.block_manifests import Manifest
from rpojax.campaign.storage.campaign_configuration import CampaignConfiguration
from rpojax.campaign.storage.seal.record_seal import array_binding
from rpojax.errors import ResultError
from rpojax.untrusted.file_reading import FileKind

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
    found = {
        path: zarr_arrays.read_rows(directory, path, configuration, manifests)
        for path in _array_folders(directory, folder)
    }
    first = 0
    for block, entry in manifests.items():
        there = {path.name: rows.values[first : first + entry.count] for path, rows in found.items() if block in rows}
        binding = array_binding(configuration.seal, name, configuration.options.first_run + entry.first, entry.count)
        if (zarr_encoding.digest(there, binding) if there else None) != entry.sha256.get(name):
            for path, rows in found.items():
                if block not in rows:
                    raise ResultError(f"{path}: found nothing, expected the values of block {block}")
            raise ResultError(
                f"{folder}: found other values in block {block}, expected those that its manifest names "
                "(without the manifest, a resume runs the block again)"
            )
        first += entry.count
    return {path.name: rows.values for path, rows in found.items()}


def read_history(directory: Path, configuration: CampaignConfiguration, run_id: int) -> dict[str, np.ndarray]:
    """Channels of a run with a stored history.

    Raises:
        ResultError: a channel is missing, cannot be read or is not what was written.
    """
    folder = directory / "results.zarr" / "histories" / str(run_id)
    return _read_whole_group(directory, folder, array_binding(configuration.seal, "histories", run_id))


def read_surface(directory: Path, configuration: CampaignConfiguration) -> dict[str, np.ndarray]:
    """Facets of the target, empty if there are none.

    Raises:
        ResultError: an array is missing, cannot be read or is not what was written.
    """
    folder = directory / "results.zarr" / "surface"
    binding = array_binding(configuration.seal, "surface", 0, configuration.options.runs)
    return _read_whole_group(directory, folder, binding) if folder.exists() else {}


def _read_whole_group(directory: Path, folder: Path, binding: str) -> dict[str, np.ndarray]:
    channels = {path.name: zarr_arrays.read_whole(directory, path) for path in _array_folders(directory, folder)}
    content = atomic_files.read_json(folder / "zarr.json", "a group of channels", FileKind.ARRAY_METADATA)
    attributes = content.get("attributes") if isinstance(content, dict) else None
    if not isinstance(attributes, dict) or attributes.get("sha256") != zarr_encoding.digest(channels, binding):
        raise ResultError(f"{folder}: found other values, expected readable arrays with the digest in its zarr.json")
    return channels


def stored_history_ids(directory: Path, first_run: int, runs: int) -> list[int]:
    """Numbers of the runs with a complete history: one whose group metadata, written last, exists."""
    folder = directory / "results.zarr" / "histories"
    safe_paths.check_no_links(directory, folder)
    try:
        names = [path.name for path in folder.iterdir() if os.path.lexists(path / "zarr.json")]
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
