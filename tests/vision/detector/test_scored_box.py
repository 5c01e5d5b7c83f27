"""Areas and intersections of boxes."""

import pytest

from rpojax.vision.detector.scored_box import ScoredBox


def test_intersection_over_union_of_worked_boxes() -> None:
    a, b = ScoredBox(0.0, 0.0, 2.0, 2.0, 1.0), ScoredBox(1.0, 1.0, 3.0, 2.0, 1.0)
    assert (a.area, a.intersection_area(b)) == (4.0, 1.0)
    assert a.intersection_over_union(b) == pytest.approx(1 / 5)
