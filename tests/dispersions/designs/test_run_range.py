"""Run range of a recorded campaign."""

from typing import Any

import pytest

from rpojax.dispersions.designs.run_range import recorded_run_range
from rpojax.errors import ResultError


@pytest.mark.parametrize(
    "recorded",
    [
        None,
        3,
        [],
        {},
        {"first_run": 0},
        {"first_run": -1, "runs": 5},
        {"first_run": True, "runs": 5},
        {"first_run": 2, "runs": 5},
    ],
    ids=str,
)
def test_an_invalid_record_is_refused(recorded: Any) -> None:
    with pytest.raises(ResultError, match=r"^campaign.json: found .*expected"):
        recorded_run_range(recorded, 0, 1)
