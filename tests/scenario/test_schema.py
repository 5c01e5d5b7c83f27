"""Requirements of a scenario."""

from typing import Any

import pytest
from scenario_error_assertions import assert_one_line

from rpojax.errors import ScenarioError
from rpojax.scenario.loading import scenario_loader
from rpojax.scenario.schema import ScenarioFile


@pytest.fixture
def tables(inspection_file: ScenarioFile) -> dict[str, Any]:
    """Tables of the nominal scenario, free to be changed."""
    return inspection_file.model_dump()


GOOD_REQUIREMENT: dict[str, Any] = {
    "metric": "min_range_m", "bound": "at least", "limit": 15.0, "probability": 0.99, "consumer_risk": 0.1
}  # fmt: skip
BAD_REQUIREMENTS: dict[str, tuple[dict[str, Any], str, tuple[str, ...]]] = {
    "an unknown metric": ({"metric": "colour"}, "metric", ("name of a metric", "'formation_error_rms_m'")),
    "a misspelt metric": ({"metric": "min_rang_m"}, "metric", ("did you mean 'min_range_m'?",)),
    "an unknown bound": ({"bound": "about"}, "bound", ("'at most'", "'at least'")),
    "no number for a limit": ({"limit": float("nan")}, "limit", ("finite",)),
    "a sure thing": ({"probability": 1.0}, "probability", ("less than 1",)),
    "a probability of nothing": ({"probability": 0.0}, "probability", ("greater than 0",)),
    "no risk": ({"consumer_risk": 0.0}, "consumer_risk", ("greater than 0",)),
    "a confidence for a risk": ({"consumer_risk": 0.9}, "consumer_risk", ("less than 0.5",)),
}


@pytest.mark.parametrize("case", BAD_REQUIREMENTS.values(), ids=BAD_REQUIREMENTS.keys())
def test_a_bad_requirement_is_refused_with_its_index(
    tables: dict[str, Any], case: tuple[dict[str, Any], str, tuple[str, ...]]
) -> None:
    change, key, words = case
    tables["requirements"] = [GOOD_REQUIREMENT, GOOD_REQUIREMENT | change]
    with pytest.raises(ScenarioError) as caught:
        scenario_loader.validate(tables)
    assert_one_line(caught.value, f"requirements.1.{key}", *words)
