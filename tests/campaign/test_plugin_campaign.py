"""Campaigns with metrics of one's own; the example of docs/how_to/plugins.md through campaign, report and tuning."""

import json
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest
from isolated_plugins import forgotten_plugins

import rpojax
from rpojax.campaign import run_and_resume
from rpojax.campaign.run_and_resume import resume_campaign, run_campaign
from rpojax.campaign.storage.campaign_folder import Campaign
from rpojax.cli import campaign_output
from rpojax.errors import RpojaxError
from rpojax.report.page.html_report import write_report
from rpojax.scenario.plugins import plugin_registry
from rpojax.scenario.schema import ScenarioFile

EXAMPLE = Path(__file__).parents[2] / "docs" / "examples" / "plugin" / "scenario.toml"


@pytest.fixture(autouse=True)
def isolated() -> Iterator[None]:
    with forgotten_plugins():
        yield


def docking_angle_deg(rho_H):
    """Largest angle between the track and the line to the servicer."""
    return np.degrees(np.arctan2(np.hypot(rho_H[:, 0], rho_H[:, 2]), -rho_H[:, 1])).max()


@rpojax.metric("max")
def docking_angle_of_ticks_deg(rho_H):
    """The same, by ticks."""
    import jax.numpy as jnp

    return jnp.rad2deg(jnp.arctan2(jnp.hypot(rho_H[0], rho_H[2]), -rho_H[1]))


METRICS = {"docking_angle_deg": docking_angle_deg, "docking_angle_of_ticks_deg": docking_angle_of_ticks_deg}


def test_metrics_from_python_are_those_of_the_histories_and_change_nothing_else(
    three_runs: Campaign, mission: ScenarioFile, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    found = run_campaign(mission, 3, tmp_path / "own", 0, metrics=METRICS, block_size=1, histories=[0, 1, 2])
    for row in range(3):
        angle = docking_angle_deg(found.history(row)["rho_H"].astype(float))
        np.testing.assert_allclose(found.metrics["docking_angle_deg"][row], angle, rtol=1e-12)
    ticks = found.metrics["docking_angle_of_ticks_deg"]
    np.testing.assert_allclose(ticks, found.metrics["docking_angle_deg"], rtol=1e-12)
    for name, values in three_runs.metrics.items():
        np.testing.assert_array_equal(found.metrics[name], values, err_msg=name)
    recorded = json.loads((tmp_path / "own" / "campaign.json").read_text())
    assert recorded["plugin"]["metrics"]["docking_angle_deg"]["unit"] == "deg"
    assert recorded["scenario"]["plugin"] == "python"
    campaign_output.conclude(found, report=False, as_json=False)
    printed = capsys.readouterr().out
    assert printed.count("Docking angle") == 2


def test_a_resume_needs_the_same_metrics(
    mission: ScenarioFile, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(run_and_resume, "simulate_missing_blocks", lambda *_: None)
    run_campaign(mission, 3, tmp_path / "own", 0, metrics=METRICS, block_size=1, progress=False)
    plugin_registry._KNOWN.clear()
    for other in (None, {"docking_angle_deg": docking_angle_of_ticks_deg}):
        with pytest.raises(RpojaxError, match="metrics given again in Python"):
            resume_campaign(tmp_path / "own", progress=False, metrics=other)
    assert resume_campaign(tmp_path / "own", metrics=METRICS, progress=False).missing_blocks() == [0, 1, 2]


@pytest.mark.slow
def test_a_resume_with_the_same_metrics_has_the_same_results(mission: ScenarioFile, tmp_path: Path) -> None:
    found = run_campaign(mission, 3, tmp_path / "own", 0, metrics=METRICS, block_size=1, histories=[0, 1, 2])
    before = found.metrics["docking_angle_deg"].copy()
    (tmp_path / "own" / "manifest" / "000000.json").unlink()
    plugin_registry._KNOWN.clear()
    again = resume_campaign(tmp_path / "own", metrics=METRICS, progress=False)
    np.testing.assert_array_equal(again.metrics["docking_angle_deg"], before)


def test_a_metric_that_cannot_be_evaluated_leaves_no_folder(mission: ScenarioFile, tmp_path: Path) -> None:
    def of_an_unknown_channel_m(rho):
        return rho[0]

    @rpojax.metric("mean")
    def of_three_numbers_m(rho_H):
        return rho_H

    @rpojax.metric("max")
    def of_a_complex_number_m(rho_H):
        return rho_H[0].astype(jnp.complex128)

    for function, expected in (
        (
            of_an_unknown_channel_m,
            r"found the argument 'rho', expected channels of the scenario \(did you mean 'rho_H'",
        ),
        (of_three_numbers_m, r"found shape \(3,\) at a tick, expected one number"),
        (of_a_complex_number_m, "found a complex number at a tick, expected a real one"),
    ):
        with pytest.raises(RpojaxError, match=expected):
            run_campaign(mission, 3, tmp_path / "own", metrics={"mine_m": function}, block_size=1)
    assert not (tmp_path / "own").exists()


@pytest.mark.slow
def test_the_example_goes_through_campaign_report_and_tuning(tmp_path: Path) -> None:
    def rpojax_command(*words: str) -> None:
        subprocess.run([sys.executable, "-m", "rpojax", *words], check=True, cwd=tmp_path, timeout=900)

    settings = ("--allow-plugin", "--set", "duration_s=300")
    rpojax_command("campaign", str(EXAMPLE), *settings, "--runs", "4", "--workers", "2", "--out", "runs")
    found = Campaign(tmp_path / "runs")
    for row in range(4):
        history = found.history(row)
        angle = docking_angle_deg(history["rho_H"].astype(float))
        np.testing.assert_allclose(found.metrics["docking_angle_deg"][row], angle, rtol=1e-12)
        hits = (history["ranger_m"] > 0.0).mean()
        np.testing.assert_allclose(found.metrics["ranger_hit_fraction"][row], hits, rtol=1e-12)
        seen = np.isfinite(history["ranger_m"])
        assert np.all(np.abs(history["ranger_m"] - history["range_m"])[seen] < 6.0 * 0.1)
    assert set(found.configuration.stages) == {"formation_law"}
    write_report(found)
    content = json.loads((tmp_path / "runs" / "report.json").read_text())
    assert content["metrics"]["docking_angle_deg"]["unit"] == "deg"
    assert any(each["metric"] == "docking_angle_deg" for each in content["requirements"])
    assert "Largest angle off the track" in (tmp_path / "runs" / "report.html").read_text()
    rpojax_command(
        *("tune", str(EXAMPLE), "--allow-plugin", "--parameters", "navigation.gps_noise_m", "--runs", "4"),
        *("--steps", "2", "--horizon", "120", "--judge", "0", "--out", "tuned.toml"),
    )
    steps = json.loads((tmp_path / "tuned.json").read_text())["steps"]
    assert np.isfinite(steps[0]["parts"]["docking_angle_deg"])


@pytest.mark.slow
def test_a_worst_case_of_a_metric_of_the_example_is_found_and_repeated(tmp_path: Path) -> None:
    def rpojax_command(*words: str) -> dict:
        command = [sys.executable, "-m", "rpojax", *words, "--allow-plugin", "--json"]
        done = subprocess.run(command, check=True, cwd=tmp_path, timeout=1800, capture_output=True, text=True)
        return json.loads(done.stdout)

    found = rpojax_command(
        *("worst-case", str(EXAMPLE), "--requirement", "docking_angle_deg", "--set", "duration_s=120"),
        *("--starts", "2", "--budget", "60", "--out", "worst"),
    )
    assert found["unit"] == "deg"
    assert found["value_flown"] > 8.0  # the median run has less than 4 deg
    assert found["value_flown"] == pytest.approx(found["value"], rel=1e-6)
    assert any(entry["name"] == "ranger.noise_m" for entry in found["dispersions"])
    numbers = ("--seed", "0", "--run-id", str(found["run_id"]))
    rpojax_command("run", "worst/worst_case.toml", *numbers, "--out", "again")
    assert Campaign(tmp_path / "again").metrics["docking_angle_deg"][0] == pytest.approx(found["value_flown"], rel=1e-9)
