"""Campaigns from start to finish, interrupted, resumed, and with runs that fail."""

import hashlib
import inspect
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jax
import numpy as np
import pytest

from rpojax.campaign import run_and_resume
from rpojax.campaign.options.campaign_options import CampaignOptions, Shard
from rpojax.campaign.options.history_retention import Retention
from rpojax.campaign.run_and_resume import resume_campaign, run_campaign
from rpojax.campaign.storage import atomic_files, folder_creation
from rpojax.campaign.storage.campaign_folder import Campaign
from rpojax.campaign.storage.provenance import new_configuration
from rpojax.errors import OutputError, ResultError, RpojaxError
from rpojax.flight.control import formation_law
from rpojax.flight.stages import Stages
from rpojax.metrics import metric_catalogue, surface_coverage, team
from rpojax.runtime.progress import Progress
from rpojax.scenario.loading import scenario_loader
from rpojax.scenario.schema import ScenarioFile
from rpojax.simulation.metrics import decimated_traces

ONE_DEVICE = jax.devices()[:1]

LAST_DIGITS = 1e-13

Read = Callable[[Path], dict[str, np.ndarray]]


def contents(directory: Path) -> dict[str, bytes]:
    """Path -> content of every file of a folder."""
    return {str(path): path.read_bytes() for path in sorted(directory.rglob("*")) if path.is_file()}


def test_every_run_has_every_metric_trace_and_dispersed_value(three_runs: Campaign, mission: ScenarioFile) -> None:
    assert three_runs.missing_blocks() == []
    assert three_runs.run_ids.tolist() == [0, 1, 2]
    assert not three_runs.failed.any()
    assert set(three_runs.outcomes) == {"not_judged"}
    assert np.isnan(three_runs.failed_at_s).all()
    of_others = {metric.name for metric in (*surface_coverage.METRICS, *team.METRICS)}
    of_others |= {name for name, metric in metric_catalogue.METRICS.items() if metric.needs is not None}
    assert set(three_runs.metrics) == set(metric_catalogue.UNITS) - of_others
    assert all(values.shape == (3,) for values in three_runs.metrics.values())
    assert set(three_runs.traces) == set(decimated_traces.TRACE_UNITS)
    assert all(values.shape == (3, 40) for values in three_runs.traces.values())
    np.testing.assert_array_equal(three_runs.trace_time_s, np.arange(0.0, 400.0, 10.0))
    assert set(three_runs.drawn) == {dispersion.key for dispersion in mission.dispersions}
    assert len(set(three_runs.metrics["min_range_m"])) == 3


def test_used_values_equal_drawn_values(three_runs: Campaign) -> None:
    drawn, used = three_runs.drawn, three_runs.used
    assert drawn.keys() == used.keys()
    for key in drawn:
        np.testing.assert_allclose(used[key], drawn[key], rtol=LAST_DIGITS, err_msg=key)


def test_histories_agree_with_metrics_and_traces(three_runs: Campaign) -> None:
    assert three_runs.history_ids == [0, 2]
    history = three_runs.history(2)
    np.testing.assert_array_equal(history["time_s"], np.arange(400.0))
    assert three_runs.metrics["min_range_m"][2] == history["range_m"].min()
    np.testing.assert_array_equal(three_runs.traces["range_m"][2], history["range_m"][::10])
    start = three_runs.drawn["initial.relative_position_m"][2]
    np.testing.assert_allclose(history["rho_H"][0], start, rtol=1e-6)
    with pytest.raises(ResultError, match=r"run 1.*\[0, 2\]"):
        three_runs.history(1)


def test_single_run_equals_that_of_the_campaign(three_runs: Campaign, mission: ScenarioFile, tmp_path: Path) -> None:
    alone = run_campaign(mission, 1, tmp_path / "run", first_run=2, block_size=1, devices=ONE_DEVICE)
    assert alone.run_ids.tolist() == [2]
    assert alone.history_ids == [2]
    for name, values in three_runs.metrics.items():
        np.testing.assert_array_equal(alone.metrics[name], values[2:], err_msg=name)


def crash_when_writing(monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    """Lets the campaign die just before the file `name` is written."""
    write = atomic_files.write_json

    def die(path: Path, content: Any) -> None:
        if path.name == name:
            raise MemoryError
        write(path, content)

    monkeypatch.setattr(atomic_files, "write_json", die)


def test_resume_after_a_crash_gives_the_results_of_an_uninterrupted_campaign(
    three_runs: Campaign, mission: ScenarioFile, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, arrays: Read
) -> None:
    out = tmp_path / "runs"
    with monkeypatch.context() as patch:
        crash_when_writing(patch, "000001.json")
        with pytest.raises(MemoryError):
            run_campaign(mission, 3, out, block_size=1, histories=[0, 2], devices=ONE_DEVICE)
    interrupted = Campaign(out)
    assert interrupted.missing_blocks() == [1, 2]
    assert interrupted.run_ids.tolist() == [0]
    assert interrupted.metrics["min_range_m"].shape == (1,)
    kept = (out / "manifest" / "000000.json").read_bytes()

    reported: list[Progress] = []
    whole = resume_campaign(out, on_progress=reported.append)
    assert whole.missing_blocks() == []
    assert reported[-1].total == reported[-1].done == 2
    assert (out / "manifest" / "000000.json").read_bytes() == kept
    expected, found = arrays(three_runs.directory), arrays(out)
    assert expected.keys() == found.keys()
    for name, values in expected.items():
        np.testing.assert_array_equal(found[name], values, err_msg=name)


def test_resume_of_a_complete_campaign_changes_nothing(three_runs: Campaign) -> None:
    before = contents(three_runs.directory)
    resume_campaign(three_runs.directory)
    assert contents(three_runs.directory) == before


def test_resume_of_a_folder_without_a_campaign_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ResultError, match="expected a campaign folder"):
        resume_campaign(tmp_path)


def half_gain_law(gain: jax.Array, deviation: jax.Array) -> jax.Array:
    """A formation law that differs from the default."""
    return 0.5 * formation_law.lqr_feedback(gain, deviation)


def test_resume_needs_the_same_stages(mission: ScenarioFile, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    stages = Stages(formation_law=half_gain_law)
    used: list[Stages] = []
    monkeypatch.setattr(
        run_and_resume, "simulate_missing_blocks", lambda _, local, *__: used.append(local.engine.stages)
    )
    begun = run_campaign(mission, 2, tmp_path / "own", block_size=1, devices=ONE_DEVICE, stages=stages)
    source = hashlib.sha256(inspect.getsource(half_gain_law).encode()).hexdigest()
    record = begun.info["stages"]["formation_law"]
    assert list(begun.info["stages"]) == ["formation_law"]
    assert (record["function"], record["source_sha256"]) == (f"{__name__}.half_gain_law", source)
    for others in (None, Stages(formation_law=lambda gain, deviation: half_gain_law(gain, deviation))):
        with pytest.raises(
            RpojaxError, match=r"^stages: found .* for formation_law, expected .*half_gain_law.*stages="
        ) as no:
            resume_campaign(begun.directory, stages=others)
        assert "\n" not in str(no.value)
    resume_campaign(begun.directory, stages=stages)
    assert used == [stages, stages]

    plain = run_campaign(mission, 2, tmp_path / "plain", block_size=1, devices=ONE_DEVICE)
    assert plain.info["stages"] == {}
    with pytest.raises(RpojaxError, match="expected the default"):
        resume_campaign(plain.directory, stages=stages)


def test_progress_begins_with_compilation_and_never_decreases(mission: ScenarioFile, tmp_path: Path) -> None:
    reported: list[Progress] = []
    run_campaign(mission, 2, tmp_path / "runs", block_size=1, devices=ONE_DEVICE, on_progress=reported.append)
    assert [entry.compiled for entry in reported[:2]] == [False, True]
    assert [entry.done for entry in reported] == [0.0, 0.0, 0.5, 1.0, 1.5, 2.0]
    assert {entry.total for entry in reported} == {2}
    assert {entry.failed for entry in reported} == {0}


def test_refused_requests_leave_no_files(mission: ScenarioFile, tmp_path: Path) -> None:
    with pytest.raises(RpojaxError, match="runs: found 0"):
        run_campaign(mission, 0, tmp_path / "runs")
    with pytest.raises(RpojaxError, match="histories: found run 3"):
        run_campaign(mission, 3, tmp_path / "runs", histories=[3])
    with pytest.raises(OutputError, match="expected a folder that can be written to"):
        run_campaign(mission, 3, Path("/dev/null/runs"))
    assert list(tmp_path.iterdir()) == []


@pytest.fixture(scope="module")
def dangerous(mission: ScenarioFile) -> ScenarioFile:
    """The mission with runs that drift into the target, and runs whose tumble rate overflows."""
    replaced = {
        "initial.relative_velocity_m_s": {"kind": "choice", "values": [[0.0, 0.0, 0.0], [0.0, 0.5, 0.0]]},
        "target.tumble_rate_deg_s": {"kind": "choice", "values": [1.0, 1.0, 1e300]},
    }
    tables = mission.model_dump()
    for entry in tables["dispersions"]:
        if entry["key"] in replaced:
            key = entry["key"]
            entry.clear()
            entry.update({"key": key, **replaced[key]})
    return scenario_loader.validate(tables)


@pytest.fixture(scope="module")
def survivors(dangerous: ScenarioFile, tmp_path_factory: pytest.TempPathFactory) -> Campaign:
    """Eight runs of the dangerous mission in eight blocks."""
    out = tmp_path_factory.mktemp("dangerous") / "runs"
    return run_campaign(dangerous, 8, out, seed=1, block_size=1, devices=ONE_DEVICE)


def test_failed_runs_have_a_reason_and_others_complete(survivors: Campaign) -> None:
    overflowing = survivors.drawn["target.tumble_rate_deg_s"] > 1.0
    approaching = survivors.drawn["initial.relative_velocity_m_s"][:, 1] == 0.5
    expected = np.where(overflowing, "non-finite state", np.where(approaching, "entered the keep-out sphere", ""))
    assert set(expected) == {"", "non-finite state", "entered the keep-out sphere"}
    np.testing.assert_array_equal(survivors.failure_reason, expected)
    np.testing.assert_array_equal(survivors.failed, expected != "")
    assert survivors.missing_blocks() == []


def test_failure_time_is_when_the_limit_was_violated(survivors: Campaign) -> None:
    inside = survivors.failure_reason == "entered the keep-out sphere"
    for run in np.flatnonzero(inside):
        history, failed_at = survivors.history(int(run)), survivors.failed_at_s[run]
        assert 60.0 < failed_at < 120.0  # 40 m at half a metre per second
        ended = history["time_s"] > failed_at
        assert np.isnan(history["range_m"][ended]).all()
        assert 10.0 < history["range_m"][~ended].min() < 11.0
    assert np.isnan(survivors.failed_at_s[~survivors.failed]).all()


def test_metrics_of_failed_runs_are_undefined_and_traces_end(survivors: Campaign) -> None:
    failed = survivors.failed
    for name, values in survivors.metrics.items():
        assert np.isnan(values[failed]).all(), name
    for name in ("formation_error_rms_m", "min_range_m", "delta_v_m_s"):
        assert np.isfinite(survivors.metrics[name][~failed]).all(), name
    ended = survivors.trace_time_s > np.where(failed, survivors.failed_at_s, np.inf)[:, None]
    for name, values in survivors.traces.items():
        assert np.isnan(values[ended]).all(), name
        assert np.isfinite(values[~failed]).all(), name


def test_shard_without_missing_blocks_leaves_selected_histories_to_the_last_one(
    mission: ScenarioFile, tmp_path: Path
) -> None:
    retention = Retention("worst:1:min_range_m")
    configuration = new_configuration(mission, CampaignOptions(4, block_size=2, histories=retention))
    folder_creation.create_folder(tmp_path / "runs", configuration, force=False)
    assert resume_campaign(tmp_path / "runs", shard=Shard.parse("3/3")).missing_blocks() == [0, 1]
