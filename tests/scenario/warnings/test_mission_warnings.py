"""Warnings before the runs: none about packaged missions, one line with both numbers about those that cannot work."""

import pytest

from rpojax.scenario.loading import scenario_loader
from rpojax.scenario.warnings.mission_warnings import mission_warnings

CASES = {
    "a larger target": (["target.scale=1.5"], "navigation.target_size_m", "1.063", "1.594", "1.5 times too near"),
    "a dispersed size": (
        ["dispersions.target.scale={kind='uniform', low=0.9, high=1.2}"],
        "navigation.target_size_m",
        "up to 1.275 m: ranges are estimated 1.2 times too near",
    ),
    "a size that is known less well than believed": (
        ["dispersions.target.scale={kind='log_normal', sigma=0.1}", "navigation.target_size_sigma=0.05"],
        "navigation.target_size_m",
        "expected at most 1.17",
    ),
    "a heavy servicer": (["servicer.mass_kg=300.0"], "thruster.force_n", "the way to the station", "mm/s"),
    "a weak thruster": (["thruster.force_n=0.003"], "thruster.force_n", "the way to the station", "mm/s"),
    "no time to turn": (["pointing.look_away_limit_s=60.0"], "thruster.force_n", "at most two thirds of 0 mm/s"),
    "a station that must be held": (
        ["formation.desired_position_m=[200.0, 0.0, 0.0]", "initial.relative_position_m=[200.0, 0.0, 0.0]"],
        "thruster.force_n",
        "holding formation.desired_position_m takes 147 mm/s",
    ),
    "a wide dead band": (["formation.dead_band_mm_s=60.0"], "formation.dead_band_mm_s", "60 mm/s", "12 m", "10"),
    "little propellant": (["limits.propellant_kg=0.001"], "limits.propellant_kg", "0.001"),
    "a distant start": (
        ["initial.relative_position_m=[0.0, -500.0, 0.0]"],
        "initial.relative_position_m",
        "never seen at the start, 506.1 m away",
        "= 4 px",
    ),
    "boxes too small": (["camera.minimum_size_px=30.0"], "formation.desired_position_m", "% of attitudes", "= 30 px"),
    "a start of which leap seconds are not known": (
        ['epoch_utc="2046-03-20T14:46:00"'], "epoch_utc", "found 2046, expected a year to 20", "not known"
    ),
    "a low Sun": (["orbit.raan_deg=0.0"], "initial.relative_position_m", "% of the starts", "eclipse"),
    "a camera that stands no light": (
        ["camera.sun_exclusion_deg=120.0"], "formation.desired_position_m", "of an orbit at the station", "at most 75 %"
    ),
    "a start beside the keep-out sphere": (
        ["initial.relative_position_m=[0.0, -12.0, 0.0]"],
        "initial.relative_position_m",
        "drifts",
        "limits.keep_out_m = 10",
    ),
    "a noisy GPS": (["gps.noise_m=20.0"], "navigation.gps_noise_m", "believes 2,", "is 20 ", "10 times"),
    "a steady GPS error": (["gps.bias_time_constant_s=7000.0"], "navigation.gps_error_time_constant_s", "700", "7000"),
    "noisy boxes": (["camera.edge_noise_px=2.0"], "navigation.edge_noise_px", "believes 1,", "is 2 "),
    "a belief far too large": (["navigation.edge_noise_px=5.0"], "navigation.edge_noise_px", "the 5th part"),
    "a noisy star tracker": (
        ["star_tracker.noise_deg=[0.01, 0.003, 0.03]"], "attitude_filter.star_tracker_noise_deg", "0.003", "0.03"
    ),
    "a noisy pressure sensor": (
        ["chamber_pressure={enabled=true, noise=0.1}"], "navigation.pressure_noise", "believes 0.03,", "is 0.1 "
    ),
    "a thruster that varies": (
        ["chamber_pressure.enabled=true", "thruster.magnitude_noise=0.03"],
        "navigation.thrust_sigma",
        "believes 0.02,",
        "is 0.03162 by thruster.magnitude_noise and force_scale",
    ),
    "a servicer of another mass than flight software knows": (
        ["dispersions.servicer.mass_kg={kind='uniform', low=36.0, high=38.0}"],
        "navigation.burn_magnitude_sigma",
        "the truth is 0.1898 by",
        "servicer.mass_kg",
    ),
    "air that is denser than flight software knows": (
        ["effects.drag=true", "dispersions.atmosphere.density_kg_m3={kind='uniform', low=1e-11, high=5e-11}"],
        "navigation.ballistic_sigma_m2_kg",
        # (0.6 / 45 - 0.25 / 30) m2/kg times 3e-11 / 5e-13
        "the truth is 0.3 by",
    ),
    "an area that is known badly": (
        ["effects.drag=true", "dispersions.target_surface.area_m2={kind='uniform', low=0.0, high=2.8}"],
        "navigation.ballistic_sigma_m2_kg",
        # The root of squares of 1.4 / 45 - 0.25 / 30 and 2.8 / 6 / 45, and of a servicer's mass that is known to 1 %
        "the truth is 0.02503 by",
    ),
    "a thruster that fails without a sensor for it": (
        ["effects.faults=true", "faults.fault.kind='thruster_off'"], "chamber_pressure.enabled", "'thruster_off'"
    ),
    "a thruster that fails in some runs": (
        [
            "effects.faults=true",
            "faults.fault.kind=none",
            "dispersions.faults.fault.kind={kind='choice', values=['gps_outage', 'thruster_weak']}",
        ],
        "chamber_pressure.enabled",
        "'thruster_weak'",
    ),
    "a thruster that fails in a case of a grid": (
        [
            "effects.faults=true",
            "faults.fault.kind=none",
            "design={kind='grid', values={'faults.fault.kind'=['none', 'thruster_off']}}",
        ],
        "chamber_pressure.enabled",
        "'thruster_off'",
    ),
    "a crooked thruster": (
        ["thruster.misalignment_deg=[0.0, 1.0, 0.0]"], "navigation.burn_direction_sigma_deg", "1.02"
    ),
    "a worse hand-over": (
        ["initial.handover.relative_position_sigma_m=3.0"],
        "navigation.initial_relative_position_sigma_m",
        "believes 1.5,",
        "is 3 ",
        "2 times",
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", scenario_loader.packaged_names())
def test_there_is_no_warning_about_a_packaged_mission(name: str) -> None:
    assert mission_warnings(scenario_loader.load(name)) == []


@pytest.mark.parametrize("name", CASES)
def test_a_mission_that_cannot_work_is_warned_about_in_one_line(name: str) -> None:
    overrides, key, *words = CASES[name]
    warnings = mission_warnings(scenario_loader.load("inspection", overrides))
    found = [each for each in warnings if each.startswith(f"{key}: ") and all(word in each for word in words)]
    assert len(found) == 1, warnings
    assert "\n" not in found[0]
    assert ", expected " in found[0]


@pytest.mark.parametrize(
    "overrides",
    [
        ["formation.desired_position_m=[0.0, -200.0, 0.0]"],
        ["formation.desired_position_m=[0.0, -10.0, 0.0]", "limits.keep_out_m=4.0"],
        ["formation.desired_position_m=[0.0, 0.0, 30.0]"],
        ["orbit.eccentricity=0.1", "orbit.semi_major_axis_m=7.8e6"],
        ["camera.edge_noise_px=1.4"],
        ["navigation.target_size_m=1.15"],
        ["target.scale=1.5", "navigation.target_size_sigma=0.5"],
        ["target.scale=1.2", "navigation.target_size_sigma=0.2"],
        ["dispersions.target.scale={kind='log_normal', sigma=0.05}", "navigation.target_size_sigma=0.05"],
        ["chamber_pressure={enabled=false, noise=0.1}", "thruster.magnitude_noise=0.015"],
        ["effects.faults=true", "faults.fault.kind='gps_outage'"],
        ["effects.faults=false", "faults.fault.kind='thruster_off'"],
        ["effects.faults=true", "faults.fault.kind='thruster_off'", "chamber_pressure.enabled=true"],
        ["dispersions=[]", "gps.noise_m=0.0", "thruster.magnitude_noise=0.0", "camera.edge_noise_px=0.0"],
    ],
)
def test_there_is_no_warning_about_a_mission_that_works(overrides: list[str]) -> None:
    assert mission_warnings(scenario_loader.load("inspection", overrides)) == []


def test_a_grid_is_judged_by_its_worst_value() -> None:
    design = "design={kind='grid', values={'gps.noise_m'=[1.0, 20.0]}}"
    (warning,) = mission_warnings(scenario_loader.load("inspection", [design]))
    assert "the truth is 20 by gps.noise_m" in warning


def test_a_belief_of_zero_has_no_ratio() -> None:
    overrides = ["navigation.burn_magnitude_sigma=0.0", "navigation.burn_scale_sigma=0.0"]
    (warning,) = mission_warnings(scenario_loader.load("inspection", overrides))
    assert warning.startswith("navigation.burn_magnitude_sigma: the filter believes 0, the truth is 0.01732 by ")
    assert warning.endswith("servicer.mass_kg, expected at most 1.5 times as much")


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(
    "override",
    [
        "limits.arrive_by_s=1e9",
        "limits.arrive_by_s=0.0",
        "thruster.force_n=1e-9",
        "servicer.mass_kg=1e9",
        "initial.relative_position_m=[0.0, -30.0, 0.0]",
        "initial.relative_position_m=[0.0, -1e8, 0.0]",
        "attitude_filter.bias_walk_deg_s_sqrt_s=0.0",
        "navigation.burn_magnitude_sigma=0.0",
        "target.hull_m=[[0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]]",
    ],
)
def test_extreme_numbers_give_finite_ones(override: str) -> None:
    for warning in mission_warnings(scenario_loader.load("inspection", [override])):
        assert not {"nan", "inf"} & set(warning.replace(",", " ").split())
