"""Nominal orbits of the filter benchmark."""

from rpojax.benchmark.synthetic_filter_inputs import nominal_setup
from rpojax.scenario.schema import ScenarioFile


def test_filter_is_measured_in_double_precision_for_any_scenario(inspection_file: ScenarioFile) -> None:
    scenario, _, start = nominal_setup(inspection_file.model_copy(update={"precision": "single"}))
    assert scenario == nominal_setup(inspection_file)[0]
    assert start.servicer.orbit_low is None
