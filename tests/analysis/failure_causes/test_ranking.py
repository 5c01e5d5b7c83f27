"""Causes are contrasted with completed runs and ranked by the failed runs that they explain."""

from collections.abc import Sequence

import numpy as np
import pytest

from rpojax.analysis.failure_causes.finding import Depth, Finding, no_words
from rpojax.analysis.failure_causes.ranking import is_contrasted, ranked_causes

FAILED = np.array([True] * 6 + [False] * 10)


def finding(name: str, strength: Sequence[float], depth: Depth = Depth.ROOT, at_s: float = np.nan) -> Finding:
    values = np.array(strength)
    return Finding(name, name, depth, values, np.full(len(values), at_s), no_words, no_words)


def test_the_cause_that_explains_most_runs_comes_first_and_runs_without_one_are_left() -> None:
    few = finding("few", [2, 2, 0, 0, 0, 0] + [0] * 10)
    many = finding("many", [0, 0, 2, 2, 2, 0] + [0] * 10)
    ranked = ranked_causes([few, many], FAILED, ~FAILED)
    assert [each.name for each in ranked.findings] == ["many", "few"]
    assert ranked.cause.tolist() == [1, 1, 0, 0, 0, -1] + [-1] * 10


def test_of_two_causes_of_a_run_the_one_farther_back_is_taken() -> None:
    gate = finding("gate", [4] * 6 + [0] * 10, Depth.MECHANISM)
    lens = finding("lens", [1.1] * 6 + [0] * 10, Depth.ROOT)
    assert [each.name for each in ranked_causes([gate, lens], FAILED, ~FAILED).findings] == ["lens"]


def test_of_two_roots_the_one_that_acts_first_is_taken() -> None:
    wheels = finding("wheels", [2] * 6 + [0] * 10, at_s=3000.0)
    lens = finding("lens", [1.5] * 6 + [0] * 10, at_s=100.0)
    assert [each.name for each in ranked_causes([wheels, lens], FAILED, ~FAILED).findings] == ["lens"]


def test_a_root_whose_time_is_unknown_is_not_the_first_one() -> None:
    unknown, early = finding("unknown", [4] * 6 + [0] * 10), finding("early", [1.1] * 6 + [0] * 10, at_s=100.0)
    assert [each.name for each in ranked_causes([unknown, early], FAILED, ~FAILED).findings] == ["early"]


@pytest.mark.parametrize(
    ("here", "there", "expected"),
    [
        ([1.5] * 6, [1.5] * 10, False),  # as much
        ([1.5] * 6, [1.5] + [0.0] * 9, True),  # more often
        ([1.9] * 6, [1.2] * 10, True),  # more strongly
        ([2.0] * 6, [2.0] * 10, True),  # far beyond the threshold in all runs, and six of sixteen fail
        ([0.9] * 6, [0.0] * 10, False),  # below the threshold
    ],
)
def test_what_completed_runs_show_as_much_is_no_cause(here: list[float], there: list[float], expected: bool) -> None:
    assert is_contrasted(finding("any", here + there), FAILED, ~FAILED) is expected


def test_what_acts_strongly_in_all_runs_is_no_cause_where_few_fail() -> None:
    failed = np.arange(16) < 2
    assert not is_contrasted(finding("any", [2.0] * 16), failed, ~failed)
