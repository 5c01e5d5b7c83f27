"""Histories are read once while a report is made, as far as memory allows."""

from typing import Any

import numpy as np
import pytest

from rpojax.report.page.html_report import KeptResults


class Recorded:
    """Results of runs of 10 samples with a history of 160 bytes each; counts reads."""

    failed = "some"

    def __init__(self, *servicer_names: str) -> None:
        self.servicer_names = servicer_names
        self.read: list[int] = []

    def history(self, run_id: int, servicer: int | None = None) -> dict[str, np.ndarray]:
        """Time, and the number of the run, of a team with 1000 for each further servicer."""
        assert servicer is None
        self.read.append(run_id)
        values = np.full(10, float(run_id))
        if self.servicer_names:
            values = values[:, None] + 1000.0 * np.arange(len(self.servicer_names))
        return {"time_s": np.arange(10.0), "value": values}


@pytest.mark.parametrize(("most_bytes", "read"), [(1000, [1, 2, 3]), (330, [1, 2, 3, 2]), (0, [1, 2, 1, 3, 2])])
def test_the_latest_histories_are_kept(most_bytes: int, read: list[int]) -> None:
    recorded: Any = Recorded()
    kept = KeptResults(recorded, most_bytes)
    for run in (1, 1, 2, 1, 3, 2):
        np.testing.assert_array_equal(kept.history(run)["value"], run)
    assert recorded.read == read
    assert kept.failed == "some"


def test_a_servicer_of_a_team_has_its_part_of_what_was_read() -> None:
    recorded: Any = Recorded("a", "b")
    kept = KeptResults(recorded)
    assert kept.history(7)["value"].shape == (10, 2)
    np.testing.assert_array_equal(kept.history(7, 1)["value"], 1007.0)
    np.testing.assert_array_equal(kept.history(7, 0)["time_s"], np.arange(10.0))
    assert recorded.read == [7]
