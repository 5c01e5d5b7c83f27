"""Upper estimates of the memory and disk that a campaign needs, and their comparison with what is available."""

import shutil
from pathlib import Path

from rpojax.campaign.argument_checks import MAX_BLOCKS, existing_parent
from rpojax.campaign.experiment_design import design_bytes
from rpojax.campaign.options.campaign_options import CampaignOptions
from rpojax.errors import RpojaxError
from rpojax.scenario.schema import ScenarioFile

RECORD_BYTES_PER_TICK = 164
"""Memory per run and tick for the channels that metrics and free drifts need [B]."""
POSE_BYTES_PER_TICK = 44
"""Memory per run and tick for the poses that coverage needs [B]."""
MISSION_BYTES_PER_TICK = 16
"""Memory per run and tick for the channels of phases, and in histories [B]."""
EVALUATION_BYTES_PER_TICK = 120
"""Memory per run and tick while the metrics of one block are evaluated [B]."""
HISTORY_BYTES_PER_TICK = 376
"""Memory and disk per tick of a full history [B]."""
HISTORY_MEMORY_BYTES = 1_000_000_000
"""Memory for the channels that only histories of a batch need [B]; a batch with more of them keeps them in a file."""
_BATCHES_IN_MEMORY = 2
"""Results of one batch are stored while the next one is simulated."""
_RUN_BYTES = 5376
_PHASES_BYTES = 1536
_TRACE_BYTES_PER_S = 4
_REPORT_BYTES = 10_000_000
_PROCESS_BYTES = 500_000_000


def check_resources(
    file: ScenarioFile, options: CampaignOptions, block_size: int, devices: int, directory: Path
) -> None:
    """Refuses a campaign whose records exceed the memory, whose results exceed the disk, or with too many blocks.

    Raises:
        RpojaxError: with the amount needed, the amount available and what to lower.
    """
    runs, ticks, at_once = options.runs, _tick_count(file), block_size * devices
    memory = memory_bytes(file, options, block_size, devices)
    if memory > (available := _available_memory()):
        raise RpojaxError(
            f"memory: found {_format_bytes(available)} available, expected {_format_bytes(memory)} for "
            f"{at_once} runs of {ticks} ticks at once; lower block_size, duration_s or histories"
        )
    disk = disk_bytes(file, options, block_size, devices)
    if disk > (free := shutil.disk_usage(existing_parent(directory)).free):
        raise RpojaxError(
            f"disk: found {_format_bytes(free)} free, expected {_format_bytes(disk)} for {runs} runs of "
            f"{file.duration_s:g} s and {_history_count(file, options)} full histories; "
            "lower runs, duration_s or histories"
        )

    if (blocks := -(-runs // block_size)) > MAX_BLOCKS:
        raise RpojaxError.of_argument("block_size", f"found {blocks} blocks, expected at most {MAX_BLOCKS}")


def memory_bytes(file: ScenarioFile, options: CampaignOptions, block_size: int, devices: int) -> int:
    """Upper estimate of the memory of a campaign [B]."""
    ticks = _tick_count(file)
    record_runs = max(_runs_in_memory(options, block_size, devices), block_size * devices)
    records = ticks * (record_runs * _record_bytes_per_tick(file) + block_size * EVALUATION_BYTES_PER_TICK)
    histories = min(_history_bytes(file, options, block_size, devices), _BATCHES_IN_MEMORY * HISTORY_MEMORY_BYTES)
    return _PROCESS_BYTES + servicer_count(file) * records + histories + design_bytes(file, options.runs)


def disk_bytes(file: ScenarioFile, options: CampaignOptions, block_size: int, devices: int) -> int:
    """Upper estimate of the size of a campaign folder, with what it needs while runs are simulated [B]."""
    servicers = servicer_count(file)
    stored = _history_count(file, options) * _tick_count(file) * HISTORY_BYTES_PER_TICK * servicers
    in_files = _history_bytes(file, options, block_size, devices)
    if in_files <= _BATCHES_IN_MEMORY * HISTORY_MEMORY_BYTES:
        in_files = 0
    per_run = _RUN_BYTES + (_PHASES_BYTES if file.phases else 0) + round(file.duration_s) * _TRACE_BYTES_PER_S
    # Of a team, what each servicer has is stored beside what they have together.
    of_runs = options.runs * per_run * (servicers + 1 if file.servicers else 1)
    return _REPORT_BYTES + of_runs + stored + in_files


def _history_count(file: ScenarioFile, options: CampaignOptions) -> int:
    return options.max_full_histories(len(file.requirements))


def _runs_in_memory(options: CampaignOptions, block_size: int, devices: int) -> int:
    return min(options.runs, _BATCHES_IN_MEMORY * block_size * devices)


def _record_bytes_per_tick(file: ScenarioFile) -> int:
    with_poses = RECORD_BYTES_PER_TICK + (POSE_BYTES_PER_TICK if file.coverage.enabled else 0)
    return with_poses + (MISSION_BYTES_PER_TICK if file.phases else 0)


def _history_bytes(file: ScenarioFile, options: CampaignOptions, block_size: int, devices: int) -> int:
    """Channels that only histories need, of all runs that may keep one, in the batches that are held at once [B]."""
    runs = _runs_in_memory(options, block_size, devices)
    if not options.histories.depends_on_results:  # else known only at the end of a batch
        runs = min(runs, _history_count(file, options))
    return runs * _tick_count(file) * (HISTORY_BYTES_PER_TICK - RECORD_BYTES_PER_TICK) * servicer_count(file)


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
