"""`campaign.json`, the configuration of a campaign: written once before anything is compiled; free of jax."""

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rpojax.campaign.preflight import MAX_BLOCKS, MAX_RUN_ID, MAX_SEED
from rpojax.campaign.storage import atomic_files, safe_paths
from rpojax.errors import ResultError

FORMAT_VERSION = 3
"""Version of the layout of a campaign folder."""
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
"""Entries that `campaign.json` must hold, with their types."""
_RANGES = {
    "seed": (0, MAX_SEED),
    "runs": (1, MAX_RUN_ID),
    "first_run": (0, MAX_RUN_ID),
    "block_size": (1, MAX_RUN_ID),
}
_SHARED_ENTRIES = (
    "scenario_hash",
    "seed",
    "runs",
    "first_run",
    "block_size",
    "histories",
    "stages",
    "design",
    "batching",
)
"""Entries that must be equal for processes that share one folder."""


def read(directory: Path) -> dict[str, Any]:
    """Content of a folder's `campaign.json`, with types and ranges checked.

    Raises:
        ResultError: the folder is no campaign, or not one that this version reads.
    """
    path = directory / FILE_NAME
    safe_paths.check_no_links(directory, path)
    content = atomic_files.read_json(path, "a campaign folder", _LARGEST_BYTES)
    found = content.get("format") if isinstance(content, dict) else None
    if found != FORMAT_VERSION:
        raise ResultError(f"{directory}: found format {found!r:.60}, expected {FORMAT_VERSION}")
    for key, form in _REQUIRED_ENTRIES.items():
        if not _is_valid_entry(key, content.get(key), form):
            raise ResultError(
                f"{path}: found {content.get(key)!r:.60} for {key!r}, expected the {form.__name__} of a campaign"
            )
    if block_count(content) > MAX_BLOCKS:
        raise ResultError(f"{path}: found {block_count(content)} blocks, expected at most {MAX_BLOCKS}")
    return content


def _is_valid_entry(key: str, value: Any, form: type) -> bool:
    has_type = isinstance(value, form) and isinstance(value, bool) == (form is bool)
    if not has_type:
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
    """Number of blocks of a campaign."""
    return -(-configuration["runs"] // configuration["block_size"])


def runs_in_block(configuration: Mapping[str, Any], block: int) -> int:
    """Number of runs of a block, without padding."""
    return min(configuration["block_size"], configuration["runs"] - block * configuration["block_size"])


def check_compatible(directory: Path, found: Mapping[str, Any], expected: Mapping[str, Any]) -> None:
    """Refuses to share the folder of a campaign with another configuration.

    Raises:
        ResultError: naming the entry that differs.
    """
    for key in _SHARED_ENTRIES:
        if found.get(key) != expected.get(key):
            difference = f"found {key} {found.get(key)!r:.80}, expected {expected.get(key)!r:.80}"
            raise ResultError(f"{directory}: {difference} to share the folder")
