"""Names of horizons of free drift, and the metrics that belong to them."""

import pytest

from rpojax.errors import ScenarioError
from rpojax.metrics import metric_catalogue
from rpojax.metrics.passive_safety import horizon_length
from rpojax.scenario.loading import scenario_loader


def test_horizons_count_orbits_or_hours() -> None:
    assert [horizon_length(name) for name in ("1_orbit", "12_orbits", "1_h", "48_h")] == [
        (1, True), (12, True), (1, False), (48, False)
    ]  # fmt: skip


@pytest.mark.parametrize("name", ["", "orbit", "0_h", "1_orbits", "2_orbit", "1.5_h", "24h", "-1_h", "2_days"])
def test_what_is_no_horizon_is_refused(name: str) -> None:
    with pytest.raises(ScenarioError, match=r"safety\.horizons.*expected horizons such as"):
        scenario_loader.load("inspection", [f"safety.horizons=['{name}']"])


def test_any_horizon_has_a_metric_of_which_low_values_are_bad() -> None:
    assert metric_catalogue.unit_of("passive_range_7_orbits_m") == "m"
    found = metric_catalogue.find("passive_range_36_h_m")
    assert found is not None
    assert found.low_is_bad
    assert not metric_catalogue.is_of_campaigns("passive_range_1_day_m")


def test_a_requirement_on_a_horizon_that_the_scenario_does_not_have_is_refused() -> None:
    with pytest.raises(ScenarioError, match=r"requirements\.5\.metric: found 'passive_range_24_h_m', expected one of"):
        scenario_loader.load("inspection", ["safety.horizons=['1_orbit', '36_h']"])
    assert scenario_loader.load("inspection", ["safety.horizons=['24_h']"]).safety.horizons == ["24_h"]
