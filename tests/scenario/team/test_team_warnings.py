"""Warnings about teams."""

from typing import Any

import pytest

from rpojax.scenario.loading import scenario_loader
from rpojax.scenario.team.team_warnings import mission_warnings

PACKAGED = ("cooperative_inspection", "cooperative_far", "cooperative_faults")


@pytest.mark.parametrize("name", PACKAGED)
def test_there_is_no_warning_about_a_packaged_team(name: str) -> None:
    assert mission_warnings(scenario_loader.load(name)) == []


def test_what_holds_for_one_servicer_names_it(tables: dict[str, Any]) -> None:
    tables["servicers"][2]["navigation"] = {"gps_noise_m": 0.5}
    (warning,) = mission_warnings(scenario_loader.validate(tables))
    assert warning.startswith("servicers.third.navigation.gps_noise_m: the filter believes 0.5, the truth is 2 ")


def test_what_holds_for_all_is_said_once(tables: dict[str, Any]) -> None:
    tables["navigation"]["gps_noise_m"] = 0.5
    (warning,) = mission_warnings(scenario_loader.validate(tables))
    assert warning.startswith("navigation.gps_noise_m: ")


def test_the_belief_in_differences_of_positions_is_judged(tables: dict[str, Any]) -> None:
    """By code sqrt(2) 2 m = 2.83 m and sqrt(2 (1 - 0.9)) 1.2 m = 0.537 m, as `inspection` believes."""
    assert mission_warnings(scenario_loader.validate(tables)) == []
    tables["gps"]["common_share"] = 0.5
    (warning,) = mission_warnings(scenario_loader.validate(tables))
    assert warning.startswith("navigation.difference_error_sigma_m: the filter believes 0.54, the truth is 1.2 by gps.")
    tables["gps_differences"] = {"kind": "carrier"}
    found = mission_warnings(scenario_loader.validate(tables))
    assert [each.partition(":")[0] for each in found] == [
        "navigation.difference_noise_m",
        "navigation.difference_error_sigma_m",
    ]
    tables["link_range"] = {"enabled": True, "noise_m": 0.2}
    assert mission_warnings(scenario_loader.validate(tables))[2].startswith(
        "navigation.difference_range_noise_m: the filter believes 0.1, the truth is 0.2 by link_range.noise_m"
    )
    tables["navigation"]["sharing"] = "none"
    assert mission_warnings(scenario_loader.validate(tables)) == []


@pytest.mark.parametrize(
    ("overrides", "warned"),
    [
        (["link.loss=1"], ["link.loss: found 1, expected less: no message arrives"]),
        (["link.loss=1", "link.burst_loss=0.5", "link.burst_interval_s=300"], []),
        (["link.period_s=1e6"], ["link.period_s: found 1e+06 s, expected less than duration_s = 7000"]),
        (
            ["link.outages_s=[[100, 200], [7000, 8000]]"],
            ["link.outages_s: found [7000.0, 8000.0], expected one that beg"],
        ),
        (["team.lost_after_s=0.5"], []),
        (
            ["team.lost_after_s=2.5", "team.phasing='spread'", "link.delay_s=2"],
            ["team.lost_after_s: found 2.5 s, expected at least 3, link.period_s and delay_s together"],
        ),
    ],
)
def test_links_over_which_nothing_arrives_in_time_are_told(overrides: list[str], warned: list[str]) -> None:
    found = mission_warnings(scenario_loader.load("cooperative_inspection", overrides))
    assert len(found) == len(warned)
    assert all(line.startswith(start) for line, start in zip(found, warned, strict=True))
