"""Values that are refused for other values of the scenario."""

import pytest
from scenario_error_assertions import assert_one_line

from rpojax.errors import ScenarioError
from rpojax.scenario.loading import scenario_loader

BAD_VALUES = {
    "plant slower than the camera": ("rates.plant_hz=0.5", "rates.plant_hz", "whole multiple of rates.camera_hz"),
    "plant rate that does not divide": ("rates.plant_hz=5.5", "rates.plant_hz", "whole multiple of rates.camera_hz"),
    "burn period that does not divide": (
        "rates.formation_period_s=200.3", "rates.formation_period_s", "whole number of camera periods"
    ),
    "duration that does not divide": ("duration_s=6000.5", "duration_s", "whole number of camera periods"),
    "outliers with sizes in the wrong order": (
        "camera.outlier_size_min_px=100.0", "camera.outlier_size_min_px", "camera.outlier_size_max_px"
    ),
    "looking away longer than a burn period": (
        "pointing.look_away_limit_s=500.0", "pointing.look_away_limit_s", "rates.formation_period_s"
    ),
    "a lead shorter than half a look-away": ("formation.lead_s=54.9", "formation.lead_s", "55 to 145"),
    "a look-away that runs into the next decision": ("formation.lead_s=145.1", "formation.lead_s", "55 to 145"),
    "a ratio beyond all numbers": ("rates.camera_hz=1e-308", "rates.plant_hz", "whole multiple of rates.camera_hz"),
    "a number of ticks beyond all numbers": ("rates.camera_hz=5e-324", "rates.plant_hz", "whole multiple"),
    "a place inside the keep-out sphere": (
        "formation.desired_position_m=[6.0, -8.0, 0.0]", "formation.desired_position_m", "limits.keep_out_m = 10"
    ),
    "a perigee in the atmosphere": ("orbit.eccentricity=0.06", "orbit.eccentricity", "perigee above 6.47e+06 m"),
}  # fmt: skip


@pytest.mark.parametrize("case", BAD_VALUES.values(), ids=BAD_VALUES.keys())
def test_a_bad_value_is_refused_with_its_key_and_what_was_expected(case: tuple[str, ...]) -> None:
    override, key, *words = case
    with pytest.raises(ScenarioError) as caught:
        scenario_loader.load("inspection", [override])
    assert caught.value.key == key
    assert_one_line(caught.value, key, *words)
