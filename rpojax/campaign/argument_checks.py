"""Checks of a campaign's numbers and folder before anything is compiled or written; free of jax."""

import json
import os
from numbers import Integral
from pathlib import Path

from rpojax.errors import OutputError, RpojaxError

MAX_SEED = 2**63 - 1
MAX_RUN_ID = 2**31 - 1
"""Random keys are made from the seed as 64 bits and from the run number as 32 bits."""
MAX_BLOCKS = 999_999
"""Manifests are numbered with six digits."""


def check_numbers(runs: int, first_run: int, seed: int, block_size: int | None) -> None:
    """Refuses counts, run numbers and seeds out of range.

    Raises:
        RpojaxError: naming the argument, what was found and what was expected.
    """
    _check_range("runs", runs, 1, MAX_RUN_ID)
    _check_range("first_run", first_run, 0, MAX_RUN_ID - runs)
    _check_range("seed", seed, 0, MAX_SEED)
    if block_size is not None:
        _check_range("block_size", block_size, 1, MAX_RUN_ID)


def _check_range(argument: str, found: int, low: int, high: int) -> None:
    is_whole = isinstance(found, Integral) and not isinstance(found, bool)
    if not is_whole or not low <= found <= high:
        raise RpojaxError.of_argument(argument, f"found {found!r}, expected a whole number from {low} to {high}")


def check_folder(directory: Path, force: bool) -> None:
    """Refuses a folder that cannot be made.

    Raises:
        OutputError: it exists and `force` is not given, it exists and is no campaign, or its parent cannot be written.
    """
    if os.path.lexists(directory):
        if not force:
            raise OutputError.of_argument(
                "out", f"found {str(directory)!r}, expected a folder that is not there yet (or force=True)"
            )
        if not is_campaign(directory):
            raise OutputError.of_argument(
                "out", f"found {str(directory)!r}, which is no campaign: force=True does not remove it"
            )
    parent = existing_parent(directory)
    if not parent.is_dir() or not os.access(parent, os.W_OK | os.X_OK):
        raise OutputError.of_argument("out", f"found {str(parent)!r}, expected a folder that can be written to")


def is_campaign(directory: Path) -> bool:
    """Whether the folder holds the `campaign.json` of a campaign."""
    try:
        content = json.loads((directory / "campaign.json").read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return False
    return isinstance(content, dict) and "scenario_hash" in content


def existing_parent(directory: Path) -> Path:
    """The nearest parent of a folder that exists."""
    return next(parent for parent in directory.absolute().parents if os.path.lexists(parent))
