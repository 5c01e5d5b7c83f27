"""Static settings of a scenario."""

import pytest

from rpojax.physics.plant_options import Effects
from rpojax.scenario.loading import scenario_loader
from rpojax.scenario.static_settings import static_settings


def test_model_switches_of_plant_and_filter_are_static_settings() -> None:
    nominal = static_settings(scenario_loader.load("inspection"))
    assert nominal.effects == Effects()
    plant = ["effects.drag=true", "effects.integrator=rk8", "effects.zonal_degree=6", "effects.faults=true"]
    filter_model = ["navigation.zonal_degree=4", "navigation.luni_solar=true"]
    changed = static_settings(scenario_loader.load("inspection", [*plant, *filter_model]))
    assert changed.effects == Effects(drag=True, integrator="rk8", zonal_degree=6, faults=True)
    assert (changed.navigation_zonal_degree, changed.navigation_luni_solar) == (4, True)
    assert (nominal.navigation_zonal_degree, nominal.navigation_luni_solar) == (2, False)
    assert hash(changed) != hash(nominal)


@pytest.mark.parametrize(
    ("utc", "days", "leap_s"),
    [
        ("2000-01-01T12:00:00", 0.0, 32.0),
        ("2000-01-02T12:00", 1.0, 32.0),
        ("2010-06-01T12:00:00", 3804.0, 34.0),
        ("2026-03-20T14:46:00", 9575.0 + 2.0 / 24.0 + 46.0 / 1440.0, 37.0),
        ("2026-03-20T15:46:00+01:00", 9575.0 + 2.0 / 24.0 + 46.0 / 1440.0, 37.0),
        ("2026-03-20", 9574.5, 37.0),
    ],
)
def test_the_epoch_is_terrestrial_time_since_2000_01_01_noon(utc: str, days: float, leap_s: float) -> None:
    for written in (f'"{utc}"', utc):  # as text, and as the date that TOML knows
        static = static_settings(scenario_loader.load("inspection", [f"epoch_utc={written}"]))
        # IERS Bulletin C: TAI-UTC is 32 s in 2000, 34 s in 2010, 37 s since 2017; TT-TAI is 32.184 s.
        assert static.epoch_s == pytest.approx(days * 86400.0 + leap_s + 32.184, abs=1e-6)


@pytest.mark.parametrize(
    ("utc", "seconds"),
    [
        ("2026-079T14:46:00Z", 827_289_960.0 + 69.184),
        ("2026-03-20T14:46:00.123456789012345", 827_289_960.123456789 + 69.184),
        # Midnight that follows is 17 years of 365 days, 5 leap days and 12 hours less after noon: 536500800 s of UTC.
        ("2016-12-31T23:59:60.5", 536_500_800.0 - 0.5 + 69.184),
        ("2017-01-01T02:59:60+03:00", 536_500_800.0 - 1.0 + 69.184),
        ("1972-01-01T00:00:00", -883_656_000.0 + 42.184),
    ],
)
def test_an_epoch_is_read_as_dates_of_messages_are(utc: str, seconds: float) -> None:
    static = static_settings(scenario_loader.load("inspection", [f'epoch_utc="{utc}"']))
    assert static.epoch_s == pytest.approx(seconds, abs=2e-7)


def test_durations_are_integer_numbers_of_ticks_and_steps() -> None:
    file = scenario_loader.load(
        "inspection",
        ["rates.camera_hz=2.0", "rates.plant_hz=10.0", "rates.formation_period_s=150.0", "duration_s=900.0"],
    )
    static = static_settings(file)
    assert (static.ticks, static.substeps, static.formation_ticks) == (1800, 5, 300)
    assert (static.tick_s, static.step_s, static.formation_period_s) == (0.5, 0.1, 150.0)
