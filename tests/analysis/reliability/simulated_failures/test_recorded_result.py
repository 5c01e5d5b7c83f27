"""A result of an estimate is shown only if it has what a result has."""

import copy
from pathlib import Path
from typing import Any

import pytest

from rpojax.analysis.reliability.simulated_failures.estimate_folder import RESULT_NAME, EstimateFolder, read_result
from rpojax.errors import ResultError
from rpojax.report.page.probability_page import write_page

DISPERSION = {"name": "initial.position_m", "sigmas": {"0": 2.0}, "values": {"0": 1.0}, "nominal": {"0": [0.0, 1.0]}}
RESULT: dict[str, Any] = {
    "scenario": "inspection",
    "scenario_hash": "ab" * 32,
    "seed": 3,
    "probability": 1e-3,
    "interval_95": [5e-4, 2e-3],
    "coefficient_of_variation": None,
    "evaluations": 10,
    "method": "plain",
    "trusted": False,
    "warnings": ["few failures"],
    "reason": "asked for",
    "remark": "",
    "noise": "drawn",
    "unmapped": [],
    "plain_runs_for_equal_accuracy": None,
    "failure": {"metric": None, "words": "outcome keep_out"},
    "requirement": {"allowed_probability_of_failure": 0.01, "verdict": "open"},
    "levels": [{"name": "plain", "evaluations": 10, "probability": 0.1, "threshold": None, "acceptance": None}],
    "design_points": [{"distance_sigmas": 3.0, "share": 1.0, "dispersions": [DISPERSION]}],
    "failing_runs": [{"distance_sigmas": 3.0, "command": "rpojax run x", "dispersions": [DISPERSION]}],
}


def test_a_result_is_read_and_shown(tmp_path: Path) -> None:
    EstimateFolder(tmp_path).write(RESULT_NAME, RESULT)
    assert "outcome keep_out" in write_page(read_result(tmp_path), tmp_path).read_text()


def changes() -> list[tuple[str, Any]]:
    """Each key, without it and with a value of another kind."""
    return [(key, value) for key in RESULT for value in (None, {"a": 1})]


@pytest.mark.parametrize(("key", "value"), changes())
def test_what_is_missing_or_of_another_kind_is_refused_or_shown(tmp_path: Path, key: str, value: Any) -> None:
    content = copy.deepcopy(RESULT)
    if value is None:
        del content[key]
    else:
        content[key] = value
    EstimateFolder(tmp_path).write(RESULT_NAME, content)
    with pytest.raises(ResultError, match=key) as error:
        read_result(tmp_path)
    assert "\n" not in str(error.value)
