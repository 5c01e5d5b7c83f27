"""Pairs of spacecraft: which count, and when both are found."""

import numpy as np
import pytest

from rpojax.training.detector.average_precision import pair_kind, pair_recalls

LEFT = [10.0, 10.0, 40.0, 40.0]


@pytest.mark.parametrize(
    ("other", "kind"),
    [
        ([30.0, 20.0, 60.0, 50.0], "overlapping"),
        ([42.0, 10.0, 72.0, 40.0], "near"),
        ([60.0, 10.0, 90.0, 40.0], None),
        ([42.0, 10.0, 50.0, 18.0], None),
    ],
)
def test_kind_of_pair(other: list[float], kind: str | None) -> None:
    assert pair_kind(np.array([LEFT, other]), 16.0) == kind


def test_both_are_found_by_two_boxes_only() -> None:
    pair = np.array([LEFT, [42.0, 10.0, 72.0, 40.0]])
    around = np.array([[10.0, 10.0, 72.0, 40.0]])
    found = [pair, around, pair, pair[:1]]
    scores = [np.array([0.9, 0.8]), np.array([0.9]), np.array([0.9, 0.2]), np.array([0.9])]
    near = pair_recalls(found, scores, [pair] * 4, 0.5, 16.0)["near"]
    assert (near["images"], near["both_found"]) == (4, 0.25)
