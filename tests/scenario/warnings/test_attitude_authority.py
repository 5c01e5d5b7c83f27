"""Warnings about wheels, lever arm, search and frame: each with its two numbers, and none where it can be flown."""

import pytest

from rpojax.scenario.loading import scenario_loader
from rpojax.scenario.warnings.mission_warnings import mission_warnings

HEAVY = [
    "servicer.mass_kg=300",
    "servicer.inertia_kg_m2=[[30,0,0],[0,30,0],[0,0,25]]",
    "thruster.force_n=0.3",
    "limits.propellant_kg=30",
]
NEAR = ["formation.desired_position_m=[0,-6,0]", "limits.keep_out_m=2"]
FAULT = ["effects.faults=true", "faults.fault.kind=wheel_stuck"]


@pytest.mark.parametrize(
    ("overrides", "key", "numbers"),
    [
        (HEAVY, "pointing.slew_acceleration_mrad_s2", ("0.48", "0.025")),
        (["wheels.torque_limit_n_m=[0.025,0.002,0.025]"], "pointing.slew_acceleration_mrad_s2", ("0.0152", "0.002")),
        (["wheels.initial_speed_rad_s=[0,600,0]"], "wheels.initial_speed_rad_s", ("0.0224", "0.17")),
        (["thruster.position_m=[-0.25,0.15,0]"], "thruster.position_m", ("wheel 2", "0.502")),
        (FAULT, "faults.fault.kind", ("wheel_stuck", "three wheels")),
        (["camera.field_of_view_deg=4"], "pointing.search_pitch_deg", ("6.5", "4 deg")),
        (
            ["formation.desired_position_m=[0,-6,0]", "limits.keep_out_m=2"],
            "formation.desired_position_m",
            ("does not fit", "6 m away"),
        ),
        (["camera.miss_probability=0.9"], "navigation.miss_probability", ("0.1", "0.905")),
        (["camera.outlier_probability=0.5"], "navigation.miss_probability", ("0.1", "0.525")),
        (["effects.drag=true", "target_surface.area_m2=2"], "navigation.ballistic_sigma_m2_kg", ("0.005", "0.0361")),
        (["thruster.misalignment_deg=[0,2,0]"], "navigation.burn_direction_sigma_deg", ("0.36", "2.01")),
    ],
)
def test_what_cannot_be_flown_is_warned_of(overrides: list[str], key: str, numbers: tuple[str, ...]) -> None:
    found = [line for line in mission_warnings(scenario_loader.load("inspection", overrides)) if line.startswith(key)]
    assert len(found) >= 1
    assert all(number in found[0] for number in numbers), found


@pytest.mark.parametrize(
    "overrides",
    [
        ["thruster.position_m=[-0.25,0.05,0]"],
        ["effects.drag=true"],
        ["effects.faults=true", "faults.fault.kind=wheel_friction"],
        ["camera.field_of_view_deg=7"],
        ["wheels.torque_limit_n_m=[0.02,0.02,0.02]"],
    ],
)
def test_what_can_be_flown_is_not(overrides: list[str]) -> None:
    assert mission_warnings(scenario_loader.load("inspection", overrides)) == []
