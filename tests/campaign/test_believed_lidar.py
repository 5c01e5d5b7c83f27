"""A LiDAR of one plugin file that the filter believes: alone, in the dark, in teams, in the report and in tuning."""

import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from isolated_plugins import forgotten_plugins

import rpojax
from rpojax.campaign.run_and_resume import run_campaign
from rpojax.campaign.storage.campaign_folder import Campaign
from rpojax.core.declared_numbers import declared_numbers
from rpojax.errors import RpojaxError
from rpojax.flight.navigation import combined_orbit_filter
from rpojax.report.page.html_report import write_report
from rpojax.sensors.measurement_delay import MeasurementDelay
from rpojax.simulation.tick import Loop

PLUGIN = Path(__file__).parents[1] / "believed_lidar.py"
SECTION = """
[ranger]
noise_m = 0.15
angle_noise_deg = 0.3
miss_probability = 0.2
reach_m = 60.0
cone_deg = 10.0
believed_noise_m = 0.2
believed_angle_noise_deg = 0.4
"""


@pytest.fixture(autouse=True)
def isolated() -> Iterator[None]:
    with forgotten_plugins():
        yield


def load(tmp_path: Path, base: str, *overrides: str) -> rpojax.ScenarioFile:
    path = tmp_path / "mine.toml"
    path.write_text(
        f'extends = "{base}"\nname = "mine"\ndescription = "."\nplugin = "{PLUGIN.as_posix()}:setup"\n{SECTION}'
    )
    return rpojax.load(path, overrides, allow_plugin=True)


def fly(tmp_path: Path, runs: int, base: str, *overrides: str) -> Campaign:
    file = load(tmp_path, base, *overrides)
    return run_campaign(file, runs, tmp_path / "out", histories=list(range(runs)), progress=False)


def test_the_plugin_is_one_short_file() -> None:
    assert len(PLUGIN.read_text().splitlines()) <= 60


def update_without_sensors(tuning, gated, focal_px, estimate, gate, gps, q_KN, box):
    return combined_orbit_filter.update(tuning, gated, focal_px, estimate, gate, gps, q_KN, box)


def test_a_replaced_update_that_leaves_the_sensor_out_is_refused(tmp_path: Path) -> None:
    file = load(tmp_path, "inspection")
    scenario, params = rpojax.nominal_parameters(file)
    with pytest.raises(RpojaxError, match="found one without the argument `sensors`"):
        Loop(scenario, params, rpojax.Stages(orbit_update=update_without_sensors))


def test_what_is_believed_and_what_is_true_are_apart(tmp_path: Path) -> None:
    _, params = rpojax.nominal_parameters(load(tmp_path, "inspection"))
    assert set(params.flight.sensors["ranger"]) == {"believed_noise", "believed_angle_noise"}
    of_truth = set(params.additional_sensors["ranger"]) - set(declared_numbers(MeasurementDelay))
    assert of_truth == {"noise", "angle_noise", "miss_probability", "reach", "cone"}


@pytest.mark.slow
def test_in_the_dark_the_estimate_stays_as_good_and_consistent(tmp_path: Path) -> None:
    campaign = fly(tmp_path, 4, "inspection_eclipse", "duration_s=4000")
    for run in range(4):
        history = campaign.history(run)
        late = np.asarray(history["time_s"]) > 1000.0
        dark = late & ~np.asarray(history["observable"], dtype=bool)
        assert (dark & np.asarray(history["ranger_accepted"], dtype=bool)).sum() > 0.7 * dark.sum() > 500
        error = np.linalg.norm(history["relative_error_H"], axis=1)
        assert np.sqrt(np.mean(error[dark] ** 2)) < 0.1  # 0.3 to 0.7 m without
    write_report(campaign, film=False, progress=False)
    report = json.loads((tmp_path / "out" / "report.json").read_text())
    means = {entry["name"]: entry for entry in report["consistency"]["means"]}
    # The noise is believed 1.33 times as large as it is: 3 / 1.33^2.
    assert means["nis_ranger_mean"]["expected"] == 3.0
    assert means["nis_ranger_mean"]["mean"] == pytest.approx(3.0 / (4.0 / 3.0) ** 2, rel=0.05)
    assert "ranger_innovation_lag1" in {entry["name"] for entry in report["consistency"]["whiteness"]}
    assert means["nees_relative_mean"]["mean"] < 12.0


@pytest.mark.slow
@pytest.mark.parametrize("sharing", ["boxes", "estimates"])
def test_servicers_that_share_use_it(tmp_path: Path, sharing: str) -> None:
    campaign = fly(tmp_path, 2, "cooperative_inspection", "duration_s=400", f"navigation.sharing={sharing}")
    assert np.all(campaign.metrics["nav_relative_position_error_rms_m"] < 0.1)
    assert np.all(campaign.metrics["ranger_used_fraction"] > 0.5)


@pytest.mark.slow
def test_its_belief_is_tuned_towards_the_noise(tmp_path: Path) -> None:
    file = load(tmp_path, "inspection", "duration_s=300", "ranger.believed_noise_m=0.6")
    tuned = rpojax.tune(file, ["ranger.believed_noise_m"], runs=2, steps=4, validation_runs=0, progress=False)
    assert tuned.values["ranger.believed_noise_m"] < 0.5
