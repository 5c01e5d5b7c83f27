"""Keys that vary from run to run, and the order in which their values are computed."""

from scenario_variants import correlated, derived, with_sections

from rpojax.scenario.dispersed_numbers import dispersion_keys
from rpojax.scenario.schema import ScenarioFile


def test_derived_components_are_evaluated_after_those_that_they_depend_on(inspection_file: ScenarioFile) -> None:
    entries = [
        derived("thruster.position_m[2]", "thruster.position_m[1]"),
        derived("thruster.position_m[1]", "thruster.position_m[0]"),
        correlated(["thruster.position_m[0]", "gps.noise_m"], [[1e-6, 1e-6], [1e-6, 1e-6]]),
    ]
    file = with_sections(inspection_file, dispersions=entries)
    assert [entry.name for entry in dispersion_keys.evaluation_order(file)] == [
        "thruster.position_m[0]+gps.noise_m",
        "thruster.position_m[1]",
        "thruster.position_m[2]",
    ]
    assert dispersion_keys.varied_keys(file) == ["thruster.position_m", "gps.noise_m"]
