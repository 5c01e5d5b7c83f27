"""The three figures of one run."""

import numpy as np
import pytest
from matplotlib.image import imread

from rpojax.report.figures import FIGURES, bearing_and_range, estimation_error, relative_position, write_figures


def _lines(axes):
    return {line.get_label(): np.asarray(line.get_xydata()).T for line in axes.lines}


@pytest.mark.parametrize("failed", [(), (0,)])
def test_figures_are_written_and_show_something(build, tmp_path, failed):
    paths = write_figures(build(failed=failed).history(0), tmp_path / "figures", "inspection, run 0")
    assert list(paths) == ["bearing_and_range.png", "estimation_error.png", "relative_position.png"] == list(FIGURES)
    for path in paths.values():
        pixels = imread(path)
        assert pixels.shape[0] > 600
        assert pixels.shape[1] > 1200
        assert 0.01 < np.mean(pixels[..., :3].min(axis=2) < 0.8) < 0.6


def test_boxes_are_split_into_accepted_and_rejected(campaign):
    history = campaign.history(0)
    distance = _lines(bearing_and_range(history, "").axes[-1])
    present, accepted = history["box_present"], history["box_accepted"]
    np.testing.assert_array_equal(distance["accepted box"][0], history["time_s"][accepted])
    np.testing.assert_array_equal(distance["rejected box"][0], history["time_s"][present & ~accepted])
    np.testing.assert_allclose(distance["truth"][1], np.linalg.norm(history["rho_H"], axis=1))


def test_true_bearing_points_from_the_servicer_to_the_target(campaign):
    along_track = _lines(bearing_and_range(campaign.history(0), "").axes[1])
    assert np.min(along_track["truth"][1]) > 0.9


def test_bounds_are_three_sigma_on_both_sides(campaign):
    history = campaign.history(0)
    target_x = estimation_error(history, "").axes[0]
    error, above, below = (np.asarray(line.get_ydata()) for line in target_x.lines)
    np.testing.assert_array_equal(error, history["target_error_H"][:, 0])
    np.testing.assert_array_equal(above, 3.0 * history["target_sigma_H"][:, 0])
    np.testing.assert_array_equal(below, -above)


def test_figure_8_and_only_it_flips_the_sign_and_says_so(campaign):
    history = campaign.history(0)
    figure = relative_position(history, "")
    along_track = _lines(figure.axes[1])
    np.testing.assert_array_equal(along_track["truth"][1], -history["rho_H"][:, 1])
    np.testing.assert_array_equal(along_track["estimate"][1], -history["rho_estimate_H"][:, 1])
    assert set(along_track["desired"][1]) == {30.0}
    assert "sign flipped" in figure.axes[0].get_title()


def test_a_run_without_any_box_is_drawn(campaign, tmp_path):
    history = dict(campaign.history(0))
    history["box_present"] = np.zeros_like(history["box_present"])
    history["mode"] = np.full_like(history["mode"], 4)
    assert len(write_figures(history, tmp_path, "no box")) == 3
