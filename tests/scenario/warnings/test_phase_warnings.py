"""Warnings about phases that cannot be flown; packaged missions have none."""

import pytest

from rpojax.scenario.loading import scenario_loader
from rpojax.scenario.warnings.mission_warnings import mission_warnings

CASES = {
    "no burn in any direction": (
        ("vbar_approach", ["pointing.slew_acceleration_mrad_s2=7.0"]),
        ("pointing.look_away_limit_s", "180 deg", "0 mm/s"),
    ),
    "a fast approach": (
        ("vbar_approach", ["phases.approach.reference.max_speed_m_s=5.0"]),
        ("phases.approach.reference.max_speed_m_s", "5e+03 mm/s", "mm/s, what the thruster gives"),
    ),
    "a fast circle": (
        ("fly_around", ["phases.circle.reference.rate_deg_h=3600.0"]),
        ("phases.circle.reference.rate_deg_h", "expected at most"),
    ),
    "a phase after the run": (
        (
            "vbar_approach",
            ["duration_s=500.0", "phases.hold_100.timeout_s=500.0", "phases.hold_100.until.time_s=500.0"],
        ),
        ("phases.approach", "begins 500 s after the start", "duration_s = 500"),
    ),
    "an approach that does not look": (
        ("vbar_approach", ["phases.approach.pointing=sun_safe"]),
        ("phases.approach.pointing", "sun_safe allows no burns"),
    ),
    "a hold that turns and does not look": (
        ("capture", ["phases.capture.pointing=sun_safe"]),
        ("phases.capture.pointing", "sun_safe allows no burns"),
    ),
}


@pytest.mark.parametrize("name", CASES)
def test_phase_that_cannot_be_flown_is_warned_of(name: str) -> None:
    (scenario, overrides), words = CASES[name]
    assert any(
        all(word in line for word in words) for line in mission_warnings(scenario_loader.load(scenario, overrides))
    )


@pytest.mark.parametrize(
    "name", [name for name in scenario_loader.packaged_names() if scenario_loader.load(name).phases]
)
def test_packaged_missions_are_not_warned_of(name: str) -> None:
    assert mission_warnings(scenario_loader.load(name)) == []
