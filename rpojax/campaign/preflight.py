"""What a campaign asks for, checked before anything is compiled or written; free of jax."""

import json
import os
import shutil
from pathlib import Path

from rpojax.errors import OutputError, RpojaxError
from rpojax.scenario import dispersion_keys
from rpojax.scenario.schema import ScenarioFile

MAX_SEED = 2**63 - 1
MAX_RUN_ID = 2**31 - 1
"""Random keys are made from these numbers."""
MAX_BLOCKS = 999_999
"""Manifests are numbered with six digits."""

RECORD_BYTES_PER_TICK = 128
"""Memory per run and tick for the channels that metrics need [B]."""
EVALUATION_BYTES_PER_TICK = 120
"""Memory per run and tick while the metrics of one block are worked out [B]."""
HISTORY_BYTES_PER_TICK = 304
"""Memory and disk per tick of a full history [B]."""
_RUN_BYTES = 2048
_TRACE_BYTES_PER_S = 4
_REPORT_BYTES = 10_000_000
_RESERVE_BYTES = 500_000_000


def check_numbers(runs: int, first_run: int, seed: int, block_size: int | None) -> None:
    """Refuses counts and seeds out of range.

    Raises:
        RpojaxError: naming the option, what was found and what was expected.
    """
    _check_range("--runs", runs, 1, MAX_RUN_ID)
    _check_range("--run-id", first_run, 0, MAX_RUN_ID - runs)
    _check_range("--seed", seed, 0, MAX_SEED)
    if block_size is not None:
        _check_range("--block-size", block_size, 1, MAX_RUN_ID)


def _check_range(option: str, found: int, low: int, high: int) -> None:
    if not low <= found <= high:
        raise RpojaxError(f"{option}: found {found}, expected a whole number from {low} to {high}")


def check_folder(directory: Path, force: bool) -> None:
    """Refuses a folder that cannot be made.

    Raises:
        OutputError: it exists and `force` is not given, it exists and is no campaign, or its parent takes no folder.
    """
    if os.path.lexists(directory):
        if not force:
            raise OutputError(f"--out: found {str(directory)!r}, expected a folder that is not there yet (or --force)")
        if not is_campaign(directory):
            raise OutputError(f"--out: found {str(directory)!r}, which is no campaign: --force does not remove it")
    parent = _existing_parent(directory)
    if not parent.is_dir() or not os.access(parent, os.W_OK | os.X_OK):
        raise OutputError(f"--out: found {str(parent)!r}, expected a folder that can be written to")


def is_campaign(directory: Path) -> bool:
    """Whether the folder holds the description that a campaign begins with."""
    try:
        info = json.loads((directory / "campaign.json").read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return False
    return isinstance(info, dict) and "scenario_hash" in info


def check_resources(
    file: ScenarioFile, runs: int, block_size: int, devices: int, history_count: int, directory: Path
) -> None:
    """Refuses a campaign whose records do not fit into memory, or whose results do not fit onto the disk.

    Raises:
        RpojaxError: saying how much is needed, how much there is and what to lower.
    """
    ticks, at_once = _tick_count(file), block_size * devices
    memory = memory_bytes(file, runs, block_size, devices, history_count)
    if memory > (available := _available_memory()):
        raise RpojaxError(
            f"memory: found {_format_bytes(available)} available, expected {_format_bytes(memory)} for "
            f"{at_once} runs of {ticks} ticks at once; lower --block-size, duration_s or --histories"
        )
    disk = disk_bytes(file, runs, history_count)
    if disk > (free := shutil.disk_usage(_existing_parent(directory)).free):
        raise RpojaxError(
            f"disk: found {_format_bytes(free)} free, expected {_format_bytes(disk)} for {runs} runs of "
            f"{file.duration_s:g} s and {history_count} full histories; lower --runs, duration_s or --histories"
        )

    if (blocks := -(-runs // block_size)) > MAX_BLOCKS:
        raise RpojaxError(f"--block-size: found {blocks} blocks, expected at most {MAX_BLOCKS}")


def memory_bytes(file: ScenarioFile, runs: int, block_size: int, devices: int, history_count: int) -> int:
    """Memory that a campaign takes at most, by a rough count [B]."""
    ticks = _tick_count(file)
    # While runs are flown those before them are still there, being stored.
    at_once = min(runs, 2 * block_size * devices)
    records = ticks * (
        max(at_once, block_size * devices) * RECORD_BYTES_PER_TICK + block_size * EVALUATION_BYTES_PER_TICK
    )
    recorded = min(history_count, at_once) * ticks * HISTORY_BYTES_PER_TICK
    return _RESERVE_BYTES + records + recorded + dispersion_keys.design_bytes(file, runs)


def disk_bytes(file: ScenarioFile, runs: int, history_count: int) -> int:
    """Disk that a campaign takes at most, by a rough count [B]."""
    kept = history_count * _tick_count(file) * HISTORY_BYTES_PER_TICK
    return _REPORT_BYTES + runs * (_RUN_BYTES + round(file.duration_s) * _TRACE_BYTES_PER_S) + kept


def _tick_count(file: ScenarioFile) -> int:
    return round(file.duration_s * file.rates.camera_hz)


def _existing_parent(directory: Path) -> Path:
    return next(parent for parent in directory.absolute().parents if os.path.lexists(parent))


def _available_memory() -> float:
    """Memory that can be had without swapping [B]; infinite where the system does not say."""
    try:
        lines = Path("/proc/meminfo").read_text(encoding="ascii").splitlines()
        return next(1024.0 * int(line.split()[1]) for line in lines if line.startswith("MemAvailable:"))
    except (OSError, StopIteration):
        return float("inf")


def _format_bytes(count: float | int) -> str:
    return f"{count / 1e9:.1f} GB" if count >= 1e9 else f"{count / 1e6:.0f} MB"
