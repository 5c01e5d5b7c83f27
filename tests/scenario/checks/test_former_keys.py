"""Keys of an earlier version that counted frames are refused with the keys that count seconds."""

from typing import Any

import pytest
from scenario_error_assertions import assert_one_line

from rpojax.errors import ScenarioError
from rpojax.scenario.loading import scenario_loader
from rpojax.scenario.schema import ScenarioFile


@pytest.mark.parametrize(
    ("former", "present"),
    [
        ("confirm_frames", "confirm_within_s"),
        ("confirm_tolerance_px", "confirm_tolerance_deg_s"),
        ("confirm_tolerance_px_s", "confirm_tolerance_deg_s"),
        ("rejections_before_recovery", "recovery_after_s"),
    ],
)
def test_a_former_key_is_refused_with_its_replacement(inspection_file: ScenarioFile, former: str, present: str) -> None:
    tables: dict[str, Any] = inspection_file.model_dump()
    assert present in tables["navigation"]
    tables["navigation"][former] = 3.0
    with pytest.raises(ScenarioError) as caught:
        scenario_loader.validate(tables)
    assert_one_line(caught.value, f"navigation.{former}", f"navigation.{present}")
    with pytest.raises(ScenarioError) as overridden:
        scenario_loader.load("inspection", [f"navigation.{former}=3"])
    assert_one_line(overridden.value, f"navigation.{former}", f"navigation.{present}")
