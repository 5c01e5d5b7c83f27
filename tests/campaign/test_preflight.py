"""What is refused before anything is compiled, and whether the estimates behind it are honest."""

import shutil
import tracemalloc
from pathlib import Path

import jax
import numpy as np
import pytest

from rpojax.campaign import preflight, resource_estimates
from rpojax.campaign.execution import block_recording
from rpojax.campaign.execution.batch_engine import BatchEngine
from rpojax.campaign.storage.campaign_folder import Campaign
from rpojax.errors import OutputError, RpojaxError
from rpojax.scenario.schema import ScenarioFile
from rpojax.simulation import metrics


@pytest.mark.parametrize(
    ("numbers", "named"),
    [
        ((0, 0, 0, None), "--runs: found 0"),
        ((-3, 0, 0, None), "--runs: found -3"),
        ((1, -1, 0, None), "--run-id: found -1"),
        ((10, 2**31 - 5, 0, None), "--run-id"),
        ((1, 0, -1, None), "--seed: found -1"),
        ((1, 0, 2**63, None), "--seed"),
        ((1, 0, 0, 0), "--block-size: found 0"),
    ],
)
def test_numbers_out_of_range_are_named(numbers: tuple[int, int, int, int | None], named: str) -> None:
    with pytest.raises(RpojaxError, match=f"{named}.*expected a whole number from"):
        preflight.check_numbers(*numbers)


def test_numbers_at_the_border_are_accepted() -> None:
    preflight.check_numbers(1, 0, 0, None)
    preflight.check_numbers(5, 2**31 - 6, 2**63 - 1, 1)


def test_a_folder_below_a_file_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError, match="expected a folder that can be written to"):
        preflight.check_folder(tmp_path / "file" / "deeper" / "runs", force=False)
    with pytest.raises(OutputError, match="expected a folder that is not there yet"):
        preflight.check_folder(tmp_path / "file", force=False)


def test_a_folder_whose_parents_are_still_to_be_made_is_accepted(tmp_path: Path) -> None:
    preflight.check_folder(tmp_path / "some" / "deeper" / "runs", force=False)
    assert list(tmp_path.iterdir()) == []


def test_a_link_that_leads_nowhere_is_not_overwritten(tmp_path: Path) -> None:
    (tmp_path / "link").symlink_to(tmp_path / "nowhere")
    with pytest.raises(OutputError, match="not there yet"):
        preflight.check_folder(tmp_path / "link", force=False)


def test_too_little_memory_is_refused_with_how_much_and_what_to_lower(
    mission: ScenarioFile, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(resource_estimates, "_available_memory", lambda: 2e9)
    resource_estimates.check_resources(mission, 1000, 256, 2, 8, tmp_path / "runs")
    with pytest.raises(RpojaxError, match=r"memory: found 2\.0 GB available, expected 10.*lower --block-size"):
        resource_estimates.check_resources(mission, 100_000, 100_000, 1, 8, tmp_path / "runs")


def test_too_little_disk_is_refused_with_how_much_and_what_to_lower(
    mission: ScenarioFile, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    usage = shutil.disk_usage(tmp_path)._replace(free=50_000_000)
    monkeypatch.setattr(shutil, "disk_usage", lambda _: usage)
    resource_estimates.check_resources(mission, 1000, 256, 1, 8, tmp_path / "runs")
    with pytest.raises(RpojaxError, match=r"disk: found 50 MB free, expected .*lower --runs, duration_s"):
        resource_estimates.check_resources(mission, 100_000, 256, 1, 8, tmp_path / "runs")


def test_the_estimate_of_memory_covers_the_records_by_little(mission: ScenarioFile) -> None:
    engine = BatchEngine(mission, 1, jax.devices()[:1])
    segment = next(iter(engine.simulate(engine.prepare(0, np.zeros(1, int)))))
    sizes = {name: values.nbytes / len(values) for name, values in segment.channels.items()}
    recorded = sum(sizes[name] for name in block_recording.RECORDED_CHANNELS)
    assert recorded <= resource_estimates.RECORD_BYTES_PER_TICK <= 1.3 * recorded
    whole = sum(sizes.values()) + 8.0  # and the time
    assert whole <= resource_estimates.HISTORY_BYTES_PER_TICK <= 1.3 * whole


def test_the_estimate_of_memory_covers_the_evaluation_of_a_block(mission: ScenarioFile) -> None:
    engine = BatchEngine(mission, 1, jax.devices()[:1])
    channels = next(iter(engine.simulate(engine.prepare(0, np.zeros(1, int))))).channels
    runs, ticks = 100, len(channels["range_m"])
    # Laid out as they are recorded: runs side by side.
    many = {name: np.repeat(np.moveaxis(channels[name], 1, -1), runs, axis=-1) for name in metrics.REQUIRED_CHANNELS}
    records = {name: np.moveaxis(values, -1, 0) for name, values in many.items()}
    tracemalloc.start()
    metrics.evaluate(mission, records)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < resource_estimates.EVALUATION_BYTES_PER_TICK * runs * ticks


def test_the_estimate_of_disk_covers_what_is_stored(three_runs: Campaign, mission: ScenarioFile) -> None:
    files = [path for path in three_runs.directory.rglob("*") if path.is_file()]
    per_run = resource_estimates._RUN_BYTES + mission.duration_s * resource_estimates._TRACE_BYTES_PER_S
    histories = 2 * 400 * resource_estimates.HISTORY_BYTES_PER_TICK
    assert sum(path.stat().st_size for path in files) < resource_estimates._REPORT_BYTES + 3 * per_run + histories
