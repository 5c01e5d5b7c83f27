"""Warnings of dispersions that draw what a number cannot be."""

import pytest

from rpojax.scenario.loading import scenario_loader
from rpojax.scenario.warnings.dispersed_bounds import bound_warnings
from rpojax.scenario.warnings.dispersed_reach import DispersedReach


def warnings_of(*entries: str) -> list[str]:
    file = scenario_loader.load("inspection", [f"dispersions.{each}" for each in entries])
    return bound_warnings(file, DispersedReach(file))


@pytest.mark.parametrize(
    ("entry", "told"),
    [
        ("servicer.mass_kg={kind='normal', sigma=15.0}", "found -15.0, expected what servicer.mass_kg can be: greater"),
        ("camera.miss_probability={kind='normal', sigma=0.4}", "what camera.miss_probability can be"),
        ("thruster.force_n={kind='derived', offset=-1.0, terms=[{key='gps.noise_m', factor=0.1}]}", "thruster.force_n"),
    ],
)
def test_a_number_that_three_sigma_lead_out_of_its_bounds_is_told(entry: str, told: str) -> None:
    assert any(told in each for each in warnings_of(entry)), warnings_of(entry)


def test_numbers_within_their_bounds_are_not_told() -> None:
    assert not warnings_of(
        "servicer.mass_kg={kind='normal', sigma=1.0}",
        "thruster.force_n={kind='truncated_normal', sigma=0.01, limit_sigmas=2.0}",
    )
