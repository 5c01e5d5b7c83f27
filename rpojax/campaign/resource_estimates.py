"""Upper estimates of the memory and disk that a campaign needs, and their comparison with what is available."""

import shutil
from pathlib import Path

from rpojax.campaign.experiment_design import design_bytes
from rpojax.campaign.preflight import MAX_BLOCKS, existing_parent
from rpojax.errors import RpojaxError
from rpojax.scenario.schema import ScenarioFile

RECORD_BYTES_PER_TICK = 160
"""Memory per run and tick for the channels that metrics and free drifts need [B]."""
POSE_BYTES_PER_TICK = 44
"""Memory per run and tick for the poses that coverage needs, and in histories [B]."""
MISSION_BYTES_PER_TICK = 16
"""Memory per run and tick for the channels of phases, and in histories [B]."""
EVALUATION_BYTES_PER_TICK = 120
"""Memory per run and tick while the metrics of one block are evaluated [B]."""
HISTORY_BYTES_PER_TICK = 328
"""Memory and disk per tick of a full history [B]."""
_RUN_BYTES = 2048
_PHASES_BYTES = 1536
_TRACE_BYTES_PER_S = 4
_REPORT_BYTES = 10_000_000
_PROCESS_BYTES = 500_000_000


def check_resources(
    file: ScenarioFile, runs: int, block_size: int, devices: int, history_count: int, directory: Path
) -> None:
    """Refuses a campaign whose records exceed the memory, whose results exceed the disk, or with too many blocks.

    Raises:
        RpojaxError: with the amount needed, the amount available and what to lower.
    """
    ticks, at_once = _tick_count(file), block_size * devices
    memory = memory_bytes(file, runs, block_size, devices, history_count)
    if memory > (available := _available_memory()):
        raise RpojaxError(
            f"memory: found {_format_bytes(available)} available, expected {_format_bytes(memory)} for "
            f"{at_once} runs of {ticks} ticks at once; lower block_size, duration_s or histories"
        )
    disk = disk_bytes(file, runs, history_count)
    if disk > (free := shutil.disk_usage(existing_parent(directory)).free):
        raise RpojaxError(
            f"disk: found {_format_bytes(free)} free, expected {_format_bytes(disk)} for {runs} runs of "
            f"{file.duration_s:g} s and {history_count} full histories; lower runs, duration_s or histories"
        )

    if (blocks := -(-runs // block_size)) > MAX_BLOCKS:
        raise RpojaxError.of_argument("block_size", f"found {blocks} blocks, expected at most {MAX_BLOCKS}")


def memory_bytes(file: ScenarioFile, runs: int, block_size: int, devices: int, history_count: int) -> int:
    """Upper estimate of the memory of a campaign [B]."""
    ticks = _tick_count(file)
    # Results of one batch are stored while the next one is simulated.
    at_once = min(runs, 2 * block_size * devices)
    record_runs = max(at_once, block_size * devices)
    record_bytes = RECORD_BYTES_PER_TICK + (POSE_BYTES_PER_TICK if file.coverage.enabled else 0)
    record_bytes += MISSION_BYTES_PER_TICK if file.phases else 0
    records = ticks * (record_runs * record_bytes + block_size * EVALUATION_BYTES_PER_TICK)
    histories = min(history_count, at_once) * ticks * HISTORY_BYTES_PER_TICK
    return _PROCESS_BYTES + servicer_count(file) * (records + histories) + design_bytes(file, runs)


def disk_bytes(file: ScenarioFile, runs: int, history_count: int) -> int:
    """Upper estimate of the size of a campaign folder [B]."""
    servicers = servicer_count(file)
    histories = history_count * _tick_count(file) * HISTORY_BYTES_PER_TICK * servicers
    per_run = _RUN_BYTES + (_PHASES_BYTES if file.phases else 0) + round(file.duration_s) * _TRACE_BYTES_PER_S
    # Of a team, what each servicer has is stored beside what they have together.
    return _REPORT_BYTES + runs * per_run * (servicers + 1 if file.servicers else 1) + histories


def servicer_count(file: ScenarioFile) -> int:
    """Number of servicers."""
    return max(1, len(file.servicers))


def _tick_count(file: ScenarioFile) -> int:
    return round(file.duration_s * file.rates.camera_hz)


def _available_memory() -> float:
    """Memory available without swapping [B]; infinite where the system does not report it."""
    try:
        lines = Path("/proc/meminfo").read_text(encoding="ascii").splitlines()
        return next(1024.0 * int(line.split()[1]) for line in lines if line.startswith("MemAvailable:"))
    except (OSError, StopIteration):
        return float("inf")


def _format_bytes(count: float | int) -> str:
    return f"{count / 1e9:.1f} GB" if count >= 1e9 else f"{count / 1e6:.0f} MB"
