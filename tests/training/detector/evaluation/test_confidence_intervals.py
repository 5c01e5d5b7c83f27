"""Intervals of figures against published values and coverage."""

import numpy as np
import pytest

from rpojax.training.detector.average_precision import bootstrap_interval, match_detections, wilson_interval
from rpojax.training.detector.evaluate_detector import _intervals


def test_wilson_interval_matches_worked_values() -> None:
    # Newcombe, "Two-sided confidence intervals for the single proportion", 1998, table I, method 3.
    assert wilson_interval(81, 263) == pytest.approx((0.2553, 0.3662), abs=1e-4)
    assert wilson_interval(15, 148) == pytest.approx((0.0624, 0.1605), abs=1e-4)
    assert wilson_interval(0, 20) == pytest.approx((0.0, 0.1611), abs=1e-4)
    assert wilson_interval(0, 0) is None


def test_bootstrap_interval_of_a_mean_is_that_of_the_normal() -> None:
    values = np.random.default_rng(1).normal(size=400)
    interval = bootstrap_interval(lambda times: float(times @ values / times.sum()), len(values))
    assert interval is not None
    half = 1.96 * values.std() / 20.0
    assert interval[0] == pytest.approx(values.mean() - half, abs=0.25 * half)
    assert interval[1] == pytest.approx(values.mean() + half, abs=0.25 * half)
    assert bootstrap_interval(lambda times: float("nan"), 3) is None


@pytest.mark.parametrize(("with_box", "has_interval"), [(1, False), (9, False), (10, True)])
def test_resampled_intervals_need_ten_images_with_a_box(with_box: int, has_interval: bool) -> None:
    box, none = np.array([[10.0, 10.0, 40.0, 40.0]]), np.zeros((0, 4))
    truth = [box if number < with_box else none for number in range(20)]
    scores = [np.full(len(real), 0.9) for real in truth]
    flags = [np.zeros(len(real), dtype=bool) for real in truth]
    matches = match_detections(truth, scores, truth, flags, flags)
    found = _intervals(matches, [np.full(len(real), 0.97) for real in truth], np.zeros(20 - with_box, int))
    assert {found[name] is not None for name in ("map50", "map50_95", "median_iou")} == {has_interval}
    assert found["recall"] is not None
    assert found["recall"][0] < 1.0
