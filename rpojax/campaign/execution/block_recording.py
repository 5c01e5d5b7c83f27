"""What is kept of runs under way: channels that metrics need of all, all wanted channels of a few."""

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from rpojax.campaign.execution.batch_engine import PreparedRuns, Segment
from rpojax.campaign.storage import campaign_folder
from rpojax.scenario.schema import ScenarioFile
from rpojax.simulation import metrics
from rpojax.simulation import trace_channels as decimated

RECORDED_CHANNELS = (*metrics.REQUIRED_CHANNELS, "running")
"""Channels that are recorded of every run."""


class ChannelRecorder:
    """Collects channels segment by segment: those in `RECORDED` of all runs, those wanted of the runs in `rows`.

    Attributes:
        records: name -> (ticks, ..., runs), in the layout of the loop, so that they are copied in long rows
        full: name -> (rows, ticks, ...)
    """

    def __init__(self, ticks: int, history_rows: Sequence[int], keeps_channel: Callable[[str], bool]) -> None:
        self.ticks = ticks
        self.history_rows = np.array(sorted(history_rows), dtype=int)
        self.keeps_channel = keeps_channel
        self.records: dict[str, np.ndarray] = {}
        self.histories: dict[str, np.ndarray] = {}

    def add_segment(self, segment: Segment) -> None:
        """Takes the channels of the next stretch of time."""
        begin = 0
        for share in segment.device_channels:
            length, *_, count = next(iter(share.values())).shape
            ticks = slice(segment.first_tick, segment.first_tick + length)
            self._record(share, ticks, slice(begin, begin + count), len(segment.failure))
            self._keep(share, ticks, slice(begin, begin + count))
            begin += count

    def _record(self, share: Mapping[str, np.ndarray], ticks: slice, runs: slice, all_runs: int) -> None:
        for name, values in share.items():
            if name in RECORDED_CHANNELS:
                shape = (self.ticks, *values.shape[1:-1], all_runs)
                _allocated(self.records, name, shape, values.dtype)[ticks, ..., runs] = values

    def _keep(self, share: Mapping[str, np.ndarray], ticks: slice, runs: slice) -> None:
        places = slice(*np.searchsorted(self.history_rows, (runs.start, runs.stop)))
        chosen = self.history_rows[places] - runs.start
        if len(chosen) == 0:
            return
        for name, values in share.items():
            if name != "running" and self.keeps_channel(name):
                shape = (len(self.history_rows), self.ticks, *values.shape[1:-1])
                kept = np.moveaxis(values[..., chosen], -1, 0)
                _allocated(self.histories, name, shape, values.dtype)[places, ticks] = kept

    def history(self, row: int, file: ScenarioFile, failure: int, failed_at: float) -> dict[str, np.ndarray]:
        """Wanted channels of one run, time first, nan after its failure."""
        place = int(np.searchsorted(self.history_rows, row))
        channels = {name: values[place].copy() for name, values in self.histories.items()}
        time_s = np.arange(self.ticks) / file.rates.camera_hz
        if failure:
            for values in channels.values():
                if np.issubdtype(values.dtype, np.floating):
                    values[time_s > failed_at] = np.nan
        return {"time_s": time_s, "rho_desired_H": np.asarray(file.formation.desired_position_m), **channels}


def _allocated(arrays: dict[str, np.ndarray], name: str, shape: tuple[int, ...], dtype: np.dtype) -> np.ndarray:
    """The array of that name, made at its first use."""
    if name not in arrays:
        arrays[name] = np.empty(shape, dtype)
    return arrays[name]


def block_arrays(
    file: ScenarioFile,
    prepared: PreparedRuns,
    recorder: ChannelRecorder,
    failure: np.ndarray,
    failed_at: np.ndarray,
    rows: slice,
) -> dict[str, np.ndarray]:
    """Arrays of one block as they are stored; metrics of failed runs are undefined."""
    records = {name: np.moveaxis(values[..., rows], -1, 0) for name, values in recorder.records.items()}
    failed = failure[rows] > 0
    arrays: dict[str, np.ndarray] = {}
    with np.errstate(invalid="ignore"):
        for name, values in metrics.evaluate(file, records).items():
            arrays[f"metrics/{name}"] = np.where(failed, np.nan, values)
        time_s = np.arange(recorder.ticks)[:: campaign_folder.trace_stride(file)] / file.rates.camera_hz
        gone = failed[:, None] & (time_s > failed_at[rows][:, None])
        for name, values in decimated.decimated_traces(file, records, campaign_folder.trace_stride(file)).items():
            arrays[f"traces/{name}"] = np.where(gone, np.float32(np.nan), values)
    arrays["status/failure"] = failure[rows].astype(np.int8)
    arrays["status/failed_at_s"] = np.where(failed, failed_at[rows], np.nan)
    for group, values in (("drawn", prepared.drawn), ("used", prepared.used)):
        for key, array in values.items():
            arrays[f"{group}/{key}"] = array[rows]
    return arrays
