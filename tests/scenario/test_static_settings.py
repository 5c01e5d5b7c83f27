"""Static settings of a scenario."""

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


def test_durations_are_integer_numbers_of_ticks_and_steps() -> None:
    file = scenario_loader.load(
        "inspection",
        ["rates.camera_hz=2.0", "rates.plant_hz=10.0", "rates.formation_period_s=150.0", "duration_s=900.0"],
    )
    static = static_settings(file)
    assert (static.ticks, static.substeps, static.formation_ticks) == (1800, 5, 300)
    assert (static.tick_s, static.step_s, static.formation_period_s) == (0.5, 0.1, 150.0)
