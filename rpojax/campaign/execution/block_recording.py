"""Recording of a batch: of every run the channels for metrics, traces and outcomes, all channels of some for histories.

`block_runner.py` turns the records into the arrays that a block stores.
"""

import math
import os
import tempfile
from collections.abc import Callable, Mapping, Sequence, Set
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from rpojax.campaign.execution import surface_coverage
from rpojax.campaign.execution.batch_engine import PreparedRuns, Segment
from rpojax.campaign.execution.surface_coverage import CoverageResults
from rpojax.campaign.options.history_retention import Retention
from rpojax.campaign.resource_estimates import HISTORY_MEMORY_BYTES
from rpojax.campaign.storage import atomic_files, campaign_folder
from rpojax.metrics.time_windows import split_name
from rpojax.runtime.rows_in_parts import in_parts
from rpojax.scenario.dispersed_numbers.values_by_run import values_of_runs
from rpojax.scenario.plugins import plugin_registry
from rpojax.scenario.schema import ScenarioFile
from rpojax.simulation.metrics import (
    decimated_traces,
    drift_starts,
    failure_signs,
    phase_records,
    recorded_metrics,
    team_metrics,
)
from rpojax.simulation.outcomes import judgement
from rpojax.simulation.outcomes.judgement import JudgedRuns

RECORDED_CHANNELS = frozenset(
    {
        *recorded_metrics.REQUIRED_CHANNELS,
        *recorded_metrics.MISSION_CHANNELS,
        *recorded_metrics.OPTIONAL_CHANNELS,
        failure_signs.LENS_CHANNEL,
        phase_records.PLACE_IN_TARGET_FRAME,
        *drift_starts.REQUIRED_CHANNELS,
        *judgement.REQUIRED_CHANNELS,
        *failure_signs.REQUIRED_CHANNELS,
        *team_metrics.TEAM_CHANNELS,
    }
)
"""Channels that are recorded of every run, if the scenario has them."""


def recorded_channels(file: ScenarioFile) -> frozenset[str]:
    """Channels that are recorded of every run of a scenario."""
    of_metrics = {name for each in plugin_registry.metrics_of(file).values() for name in each.inputs}
    of_coverage = set(surface_coverage.REQUIRED_CHANNELS) if file.coverage.enabled else set()
    return RECORDED_CHANNELS | of_coverage | of_metrics


class ChannelRecorder:
    """Collects channels segment by segment: those of `recorded` of all runs, and all kept channels of `history_rows`.

    Attributes:
        records: name -> (ticks, ..., runs), in the layout of the loop, so that they are copied in long rows
        other_channels: name -> (ticks, ..., history rows), the kept channels that are not among the records
    """

    def __init__(
        self,
        ticks: int,
        history_rows: Sequence[int],
        keeps_channel: Callable[[str], bool],
        recorded: Set[str] = RECORDED_CHANNELS,
        spool: Path | None = None,
    ) -> None:
        """`spool` is the folder of the file for channels of histories that exceed `HISTORY_MEMORY_BYTES`."""
        self.ticks = ticks
        self.recorded = recorded
        self.history_rows = np.array(sorted(history_rows), dtype=int)
        self.keeps_channel = keeps_channel
        self.records: dict[str, np.ndarray] = {}
        self.other_channels: dict[str, np.ndarray] = {}
        self._spool = spool

    def add_segment(self, segment: Segment) -> None:
        """Copies the channels of the next segment."""
        begin = 0
        for channels in segment.device_channels:
            length, *_, count = next(iter(channels.values())).shape
            ticks = slice(segment.first_tick, segment.first_tick + length)
            runs = slice(begin, begin + count)
            self._add_records(channels, ticks, runs, segment.failure.shape[-1])
            self._add_histories(channels, ticks, runs)
            begin += count

    def _add_records(self, channels: Mapping[str, np.ndarray], ticks: slice, runs: slice, all_runs: int) -> None:
        for name, values in channels.items():
            if name in self.recorded:
                shape = (self.ticks, *values.shape[1:-1], all_runs)
                _allocated(self.records, name, shape, values.dtype)[ticks, ..., runs] = values

    def _add_histories(self, channels: Mapping[str, np.ndarray], ticks: slice, runs: slice) -> None:
        places = slice(*np.searchsorted(self.history_rows, (runs.start, runs.stop)))
        columns = self.history_rows[places] - runs.start
        if len(columns) == 0:
            return
        others = {
            name: values for name, values in channels.items() if self._is_kept(name) and name not in self.recorded
        }
        if not self.other_channels:
            self.other_channels = self._allocate_others(others)
        columns = columns if len(columns) < runs.stop - runs.start else slice(None)  # a slice copies long rows
        for name, values in others.items():
            self.other_channels[name][ticks, ..., places] = values[..., columns]

    def _is_kept(self, name: str) -> bool:
        return name != "running" and self.keeps_channel(name)

    def _allocate_others(self, channels: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
        """Arrays for channels that only histories need; in a file without a name if they exceed the memory for them."""
        shapes = {name: (self.ticks, *values.shape[1:-1], len(self.history_rows)) for name, values in channels.items()}
        size = sum(channels[name].dtype.itemsize * math.prod(shape) for name, shape in shapes.items())
        if self._spool is None or size <= HISTORY_MEMORY_BYTES:
            return {name: np.empty(shape, channels[name].dtype) for name, shape in shapes.items()}
        arrays = {}
        try:
            for name, shape in shapes.items():
                with tempfile.TemporaryFile(dir=self._spool) as file:  # the array keeps it open
                    if hasattr(os, "posix_fallocate"):  # a disk that fills up later would kill the process
                        os.posix_fallocate(file.fileno(), 0, channels[name].dtype.itemsize * math.prod(shape))
                    arrays[name] = np.memmap(file, channels[name].dtype, "w+", shape=shape)
        except OSError as error:
            raise atomic_files.write_error(self._spool, error) from None
        return arrays

    def records_of_runs(self, rows: slice = slice(None)) -> dict[str, np.ndarray]:
        """Recorded channels of some runs, name -> (runs, ticks, ...)."""
        return {name: np.moveaxis(values[..., rows], -1, 0) for name, values in self.records.items()}

    def history(
        self,
        row: int,
        file: ScenarioFile,
        varied: Mapping[str, np.ndarray],
        frozen_at_s: float,
        servicer: int | None = None,
    ) -> dict[str, np.ndarray]:
        """Kept channels of one run, time first, nan after it was frozen.

        `varied` are the values of all runs (runs, ...) by key, of the keys that vary; `servicer` is
        the number of one of a team.
        """
        place = int(np.searchsorted(self.history_rows, row))
        of_run = {name: values[..., row] for name, values in self.records.items() if self._is_kept(name)}
        of_run |= {name: values[..., place] for name, values in self.other_channels.items()}
        channels = {
            name: np.array(of_run[name] if servicer is None else of_run[name][..., servicer]) for name in sorted(of_run)
        }
        time_s = np.arange(self.ticks) / file.rates.camera_hz
        if np.isfinite(frozen_at_s):
            for values in channels.values():
                if np.issubdtype(values.dtype, np.floating):
                    values[time_s > frozen_at_s] = np.nan
        desired = values_of_runs(varied, "formation.desired_position_m", file.formation.desired_position_m)
        return {"time_s": time_s, "rho_desired_H": desired[row if len(desired) > 1 else 0], **channels}


def thin_history(history: Mapping[str, np.ndarray], retention: Retention, ticks: int) -> dict[str, np.ndarray]:
    """Kept channels and samples of a full history of `ticks` ticks, always with `time_s` and `rho_desired_H`."""
    channels = {name: values for name, values in history.items() if retention.keeps_channel(name)}
    sampled = {name for name, values in channels.items() if name != "rho_desired_H" and len(values) == ticks}
    return {name: values[:: retention.every] if name in sampled else values for name, values in channels.items()}


def _allocated(arrays: dict[str, np.ndarray], name: str, shape: tuple[int, ...], dtype: np.dtype) -> np.ndarray:
    """The array of that name, allocated at its first use."""
    if name not in arrays:
        arrays[name] = np.empty(shape, dtype)
    return arrays[name]


@dataclass(frozen=True)
class ServicerResults:
    """What is judged of one servicer in a batch of runs.

    Attributes:
        file: its scenario
        used: values of the runs (runs, ...) by key, of the keys that vary
        records: recorded channels (runs, ticks, ...)
        passive_safety: metrics of its free drifts
        coverage: of the target's surface
        judged: how its runs ended
    """

    file: ScenarioFile
    used: Mapping[str, np.ndarray]
    records: Mapping[str, np.ndarray]
    passive_safety: Mapping[str, np.ndarray]
    coverage: CoverageResults
    judged: JudgedRuns


def servicer_arrays(results: ServicerResults, rows: slice) -> dict[str, np.ndarray]:
    """Arrays of one servicer in some runs as `Campaign.write_block` stores them: `group/name` -> (runs, ...).

    Metrics of frozen runs are nan, those of windows that they were frozen in, and traces after they were frozen.
    """
    return in_parts(partial(_servicer_arrays, results), rows)


def _servicer_arrays(results: ServicerResults, rows: slice) -> dict[str, np.ndarray]:
    file, judged, coverage = results.file, results.judged, results.coverage
    records = {name: values[rows] for name, values in results.records.items()}
    used = {key: values[rows] for key, values in results.used.items()}
    frozen, since_s = judged.frozen[rows], judged.since_s[rows]
    stride = campaign_folder.trace_stride(file)
    arrays: dict[str, np.ndarray] = {}
    with np.errstate(invalid="ignore"):
        for name, values in recorded_metrics.evaluate(file, records, used).items():
            arrays[f"metrics/{name}"] = np.where(frozen, np.nan, values)
        for name, values in recorded_metrics.evaluate_windows(file, records, used).items():
            arrays[f"metrics/{name}"] = values
        for name, values in {**results.passive_safety, **coverage.metrics}.items():
            is_ended = frozen & (split_name(name)[1] == "")
            arrays[f"metrics/{name}"] = np.where(is_ended, np.nan, values[rows])
        ticks = records["running"].shape[1]
        time_s = np.arange(ticks)[::stride] / file.rates.camera_hz
        ended = frozen[:, None] & (time_s > since_s[:, None])
        for name, values in decimated_traces.decimated_traces(file, records, used, stride).items():
            arrays[f"traces/{name}"] = np.where(ended, np.float32(np.nan), values)
    arrays |= {f"phases/{name}": values for name, values in phase_records.evaluate(file, records, used).items()}
    arrays |= {f"signs/{name}": values for name, values in failure_signs.evaluate(file, records, used).items()}
    arrays |= {f"coverage/{name}": values[rows] for name, values in coverage.maps.items()}
    arrays["status/failure"] = judged.codes[rows]
    arrays["status/failed_at_s"] = since_s
    return arrays | {f"events/{name}": values for name, values in judged.events.stored(rows).items()}


def value_arrays(prepared: PreparedRuns, rows: slice) -> dict[str, np.ndarray]:
    """Values drawn and used in some runs."""
    return {
        f"{group}/{key}": array[rows]
        for group, values in (("drawn", prepared.drawn), ("used", prepared.used))
        for key, array in values.items()
    }
