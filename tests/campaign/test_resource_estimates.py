"""Estimates of memory and disk cover what campaigns need."""

import shutil
import tracemalloc
from pathlib import Path

import jax
import numpy as np
import pytest

from rpojax.campaign import resource_estimates
from rpojax.campaign.execution import block_recording
from rpojax.campaign.execution.batch_engine import BatchEngine
from rpojax.campaign.options.campaign_options import CampaignOptions
from rpojax.campaign.options.history_retention import Retention
from rpojax.campaign.storage.campaign_folder import Campaign
from rpojax.errors import RpojaxError
from rpojax.scenario.loading import scenario_loader
from rpojax.scenario.schema import ScenarioFile
from rpojax.simulation.metrics import recorded_metrics


def test_too_little_memory_is_refused_with_amounts_and_remedies(
    mission: ScenarioFile, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(resource_estimates, "_available_memory", lambda: 2e9)
    resource_estimates.check_resources(mission, options(1000), 256, 2, tmp_path / "runs")
    with pytest.raises(RpojaxError, match=r"memory: found 2\.0 GB available, expected 11.*lower block_size"):
        resource_estimates.check_resources(mission, options(100_000), 100_000, 1, tmp_path / "runs")


def test_too_little_disk_is_refused_with_amounts_and_remedies(
    mission: ScenarioFile, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    usage = shutil.disk_usage(tmp_path)._replace(free=50_000_000)
    monkeypatch.setattr(shutil, "disk_usage", lambda _: usage)
    resource_estimates.check_resources(mission, options(1000), 256, 1, tmp_path / "runs")
    with pytest.raises(RpojaxError, match=r"disk: found 50 MB free, expected .*lower runs, duration_s"):
        resource_estimates.check_resources(mission, options(100_000), 256, 1, tmp_path / "runs")


def test_memory_estimate_of_records_is_tight(mission: ScenarioFile) -> None:
    engine = BatchEngine(mission, 1, jax.devices()[:1])
    segment = next(iter(engine.simulate(engine.prepare(0, np.zeros(1, int)))))
    sizes = {name: values.nbytes / len(values) for name, values in segment.channels.items()}
    recorded = sum(size for name, size in sizes.items() if name in block_recording.RECORDED_CHANNELS)
    assert recorded <= resource_estimates.RECORD_BYTES_PER_TICK <= 1.3 * recorded
    history = sum(sizes.values()) + 8.0  # with the time
    assert history <= resource_estimates.HISTORY_BYTES_PER_TICK <= 1.3 * history


def test_memory_estimate_covers_the_evaluation_of_metrics(mission: ScenarioFile) -> None:
    engine = BatchEngine(mission, 1, jax.devices()[:1])
    channels = next(iter(engine.simulate(engine.prepare(0, np.zeros(1, int))))).channels
    runs, ticks = 100, len(channels["range_m"])
    # In the layout of the recorder, with runs in the last axis of memory.
    one_run = {name: np.moveaxis(channels[name], 1, -1) for name in recorded_metrics.REQUIRED_CHANNELS}
    records = {name: np.moveaxis(np.repeat(values, runs, axis=-1), -1, 0) for name, values in one_run.items()}
    tracemalloc.start()
    recorded_metrics.evaluate(mission, records, {})
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < resource_estimates.EVALUATION_BYTES_PER_TICK * runs * ticks


def test_disk_estimate_covers_a_campaign(three_runs: Campaign, mission: ScenarioFile) -> None:
    files = [path for path in three_runs.directory.rglob("*") if path.is_file()]
    per_run = resource_estimates._RUN_BYTES + mission.duration_s * resource_estimates._TRACE_BYTES_PER_S
    histories = 2 * 400 * resource_estimates.HISTORY_BYTES_PER_TICK
    assert sum(path.stat().st_size for path in files) < resource_estimates._REPORT_BYTES + 3 * per_run + histories


def test_each_servicer_of_a_team_counts() -> None:
    team = scenario_loader.load("cooperative_inspection")
    alone = team.model_copy(update={"servicers": []})
    sizes = [resource_estimates.memory_bytes(file, options(1000), 100, 2) - 500_000_000 for file in (alone, team)]
    np.testing.assert_allclose(sizes[1] / sizes[0], 3.0, rtol=0.05)
    with_histories, without = (
        np.array([resource_estimates.disk_bytes(file, options(1000, rule), 100, 2) for file in (alone, team)])
        for rule in ("8", "none")
    )
    histories = with_histories - without
    assert histories[1] == 3 * histories[0]
    of_runs = without - 10_000_000
    assert of_runs[1] > 3 * of_runs[0]


def test_histories_selected_by_results_count_for_all_runs_of_a_batch_and_above_a_limit_on_disk() -> None:
    file = scenario_loader.load("rendezvous")  # of 48,000 ticks
    rules = [options(1000, rule) for rule in ("8", "8+requirements")]
    of_one = file.duration_s * (resource_estimates.HISTORY_BYTES_PER_TICK - resource_estimates.RECORD_BYTES_PER_TICK)
    small, large = [resource_estimates.memory_bytes(file, each, 16, 2) for each in rules]
    assert large - small == pytest.approx((2 * 2 * 16 - 8) * of_one)
    in_memory, in_files = [resource_estimates.memory_bytes(file, each, 128, 2) for each in rules]
    assert in_files - in_memory == pytest.approx(2e9 - 8 * of_one)
    on_disk = [resource_estimates.disk_bytes(file, each, 128, 2) for each in rules]
    assert on_disk[1] - on_disk[0] > 2 * 2 * 128 * of_one


def options(runs: int, histories: str = "8") -> CampaignOptions:
    return CampaignOptions(runs=runs, histories=Retention(histories))
