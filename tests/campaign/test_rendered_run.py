"""Boxes that the detector finds in the images of the closed loop."""

import math

import numpy as np
from rendered_run import RenderedRun


def test_detected_boxes_are_of_the_target(rendered_run: RenderedRun) -> None:
    history = rendered_run.history
    assert history["observable"].all()
    present = history["box_present"]
    assert present.mean() > 0.8
    assert not history["box_outlier"].any()
    # At most 1.6 m; the box of a tumbling target is about half of that.
    focal_px = 160.0 / math.tan(math.radians(20.0))
    largest = 1.6 * focal_px / np.linalg.norm(history["rho_H"], axis=1)[present].min()
    sides = np.sqrt(np.prod(history["box_px"][present][:, 2:], axis=1))
    assert 0.2 * largest < np.median(sides) < 1.05 * largest


def test_detected_boxes_are_accepted_and_bound_the_error(rendered_run: RenderedRun) -> None:
    assert rendered_run.history["box_accepted"].mean() > 0.6
    assert np.linalg.norm(rendered_run.history["relative_error_H"], axis=1).max() < 10.0
