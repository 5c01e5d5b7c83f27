"""`campaign.json`: what a campaign asks for, written once before anything is compiled and never again; free of jax."""

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rpojax.campaign.preflight import MAX_BLOCKS, MAX_RUN_ID, MAX_SEED
from rpojax.campaign.storage import atomic_files
from rpojax.errors import ResultError

FORMAT_VERSION = 3
FILE_NAME = "campaign.json"

_LARGEST_BYTES = 64_000_000
_REQUIRED_ENTRIES: dict[str, type] = {
    "name": str,
    "description": str,
    "scenario": dict,
    "scenario_hash": str,
    "seed": int,
    "runs": int,
    "first_run": int,
    "block_size": int,
    "histories": dict,
    "stages": dict,
    "design": dict,
    "report": bool,
    "id": str,
    "versions": dict,
}
"""What `campaign.json` must hold, and in which form."""
_RANGES = {
    "seed": (0, MAX_SEED),
    "runs": (1, MAX_RUN_ID),
    "first_run": (0, MAX_RUN_ID),
    "block_size": (1, MAX_RUN_ID),
}
_SHARED_ENTRIES = ("scenario_hash", "seed", "runs", "first_run", "block_size", "histories", "stages", "design")
"""What those who share one folder must ask for alike."""


def read(directory: Path) -> dict[str, Any]:
    """Content of a folder's `campaign.json`, its form checked.

    Raises:
        ResultError: the folder is no campaign, or not one that this version reads.
    """
    path = directory / FILE_NAME
    atomic_files.check_no_links(directory, path)
    info = atomic_files.read_json(path, "a campaign folder", _LARGEST_BYTES)
    found = info.get("format") if isinstance(info, dict) else None
    if found != FORMAT_VERSION:
        raise ResultError(f"{directory}: found format {found!r:.60}, expected {FORMAT_VERSION}")
    for key, form in _REQUIRED_ENTRIES.items():
        if not _is_valid_entry(key, info.get(key), form):
            raise ResultError(
                f"{path}: found {info.get(key)!r:.60} for {key!r}, expected the {form.__name__} of a campaign"
            )
    if block_count(info) > MAX_BLOCKS:
        raise ResultError(f"{path}: found {block_count(info)} blocks, expected at most {MAX_BLOCKS}")
    return info


def _is_valid_entry(key: str, value: Any, form: type) -> bool:
    fits = isinstance(value, form) and isinstance(value, bool) == (form is bool)
    if not fits:
        return False
    if key == "histories":
        return _is_valid_retention(value)
    if key == "scenario_hash":
        return re.fullmatch(r"[0-9a-f]{64}", value) is not None
    low, high = _RANGES.get(key, (None, None))
    return low is None or high is None or low <= value <= high


def _is_valid_retention(value: Mapping[str, Any]) -> bool:
    rule, channels, every = (value.get(name) for name in ("rule", "channels", "every"))
    named = channels is None or (isinstance(channels, list) and all(isinstance(name, str) for name in channels))
    return isinstance(rule, str) and named and isinstance(every, int) and not isinstance(every, bool) and every >= 1


def block_count(configuration: Mapping[str, Any]) -> int:
    """Number of blocks."""
    return -(-configuration["runs"] // configuration["block_size"])


def runs_in_block(configuration: Mapping[str, Any], block: int) -> int:
    """Number of runs of a block, padding left out."""
    return min(configuration["block_size"], configuration["runs"] - block * configuration["block_size"])


def check_compatible(directory: Path, found: Mapping[str, Any], expected: Mapping[str, Any]) -> None:
    """Refuses to join a campaign that asks for something else.

    Raises:
        ResultError: naming the entry that differs.
    """
    for key in _SHARED_ENTRIES:
        if found[key] != expected[key]:
            raise ResultError(
                f"{directory}: found {key} {found[key]!r:.80}, expected {expected[key]!r:.80} to share the folder"
            )
