"""Channels of several devices are recorded as if there were one device."""

from pathlib import Path

import numpy as np
import pytest

from rpojax.campaign.execution import block_recording
from rpojax.campaign.execution.batch_engine import Segment
from rpojax.campaign.execution.block_recording import ChannelRecorder
from rpojax.scenario.loading import scenario_loader

TICKS, RUNS, OF_FIRST = 5, 6, 4
WHOLE = {
    "range_m": np.arange(TICKS * RUNS, dtype=np.float32).reshape(TICKS, RUNS),
    "rho_H": np.arange(TICKS * 3 * RUNS, dtype=np.float32).reshape(TICKS, 3, RUNS),
    "box_px": -np.arange(TICKS * 4 * RUNS, dtype=np.float32).reshape(TICKS, 4, RUNS),
}
"""Channels (ticks, ..., runs); the last is recorded only of runs with a history."""


def segments() -> list[Segment]:
    """The channels in segments of three and two ticks, of two devices with four and two runs."""
    ends = np.zeros(RUNS), np.full(RUNS, np.inf)

    def share(ticks: slice, runs: slice) -> dict[str, np.ndarray]:
        return {name: values[ticks, ..., runs] for name, values in WHOLE.items()}

    return [
        Segment(ticks.start, [share(ticks, slice(0, OF_FIRST)), share(ticks, slice(OF_FIRST, RUNS))], *ends)
        for ticks in (slice(0, 3), slice(3, 5))
    ]


@pytest.mark.parametrize("memory_bytes", [10**9, 0])
@pytest.mark.parametrize("rows", [[1, 3, 5], [5, 0], [4], [], [0, 1, 2, 3, 4, 5]])
def test_records_of_two_devices_equal_those_of_one(
    rows: list[int], memory_bytes: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(block_recording, "HISTORY_MEMORY_BYTES", memory_bytes)
    recorder = ChannelRecorder(TICKS, rows, lambda _: True, spool=tmp_path)
    for segment in segments():
        recorder.add_segment(segment)
    assert set(recorder.records) == {"range_m", "rho_H"}
    for name, values in recorder.records.items():
        np.testing.assert_array_equal(values, WHOLE[name])
    assert all(isinstance(each, np.memmap) == (memory_bytes == 0) for each in recorder.other_channels.values())
    assert not list(tmp_path.iterdir())  # the file has no name, so that nothing is left of a killed process
    file = scenario_loader.load("inspection")
    for row in rows:
        history = recorder.history(row, file, {}, np.inf)
        for name, values in WHOLE.items():
            np.testing.assert_array_equal(history[name], values[..., row])


def test_channels_of_a_segment_join_devices_and_put_runs_before_components() -> None:
    first = segments()[0].channels
    assert {name: values.shape for name, values in first.items()} == {
        "range_m": (3, RUNS),
        "rho_H": (3, RUNS, 3),
        "box_px": (3, RUNS, 4),
    }
    np.testing.assert_array_equal(first["rho_H"][2, 5], WHOLE["rho_H"][2, :, 5])
