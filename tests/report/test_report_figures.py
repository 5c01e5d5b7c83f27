"""The three figures of one run."""

import numpy as np
import pytest
from matplotlib.image import imread

from rpojax.report.figures.paper_figures import (
    FIGURES,
    bearing_and_range,
    estimation_error,
    relative_position,
    write_figures,
)


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


def test_boxes_are_split_into_accepted_and_rejected_and_those_beyond_the_scale_are_at_its_edge_and_counted(campaign):
    history = campaign.history(0)
    axes = bearing_and_range(history, "").axes[-1]
    distance = _lines(axes)
    present, accepted = history["box_present"], history["box_accepted"]
    inside = history["box_range_m"] <= axes.get_ylim()[1]
    np.testing.assert_array_equal(distance["accepted box"][0], history["time_s"][accepted & inside])
    np.testing.assert_array_equal(distance["rejected box"][0], history["time_s"][present & ~accepted & inside])
    beyond = present & ~accepted & ~inside
    assert 0 < beyond.sum() < (present & ~accepted).sum()
    (edge,) = (line for line in axes.lines if line.get_gid() == "rejected beyond ^")
    np.testing.assert_array_equal(edge.get_xdata(), history["time_s"][beyond])
    assert set(edge.get_ydata()) == {axes.get_ylim()[1]}
    assert [text.get_text() for text in axes.texts] == [f"beyond the scale: {beyond.sum()}"]
    np.testing.assert_allclose(distance["truth"][1], np.linalg.norm(history["rho_H"], axis=1))


def test_the_scale_of_the_bearings_is_that_of_accepted_boxes_which_lie_above_the_crosses(campaign):
    history = dict(campaign.history(0))
    history["box_bearing_H"] = history["box_bearing_H"].copy()
    history["box_bearing_H"][np.flatnonzero(history["box_present"] & ~history["box_accepted"])[0]] = 1.0, -1.0, 1.0
    for axis, axes in enumerate(bearing_and_range(history, "").axes[:3]):
        shown = history["box_bearing_H"][history["box_accepted"], axis]
        low, high = axes.get_ylim()
        assert low < shown.min() < shown.max() < high
        assert high - low < 0.5
        marks = {line.get_label(): line for line in axes.lines}
        assert marks["accepted box"].get_zorder() > marks["rejected box"].get_zorder()
        assert len(axes.texts) == 1


def test_the_error_of_the_relative_position_is_that_of_the_servicer_from_the_target(campaign):
    history = campaign.history(0)
    figure = estimation_error(history, "")
    for axis in range(3):
        axes = figure.axes[3 * axis + 2]
        np.testing.assert_array_equal(axes.lines[0].get_ydata(), -history["relative_error_H"][:, axis])
    assert figure.axes[2].get_title() == "Relative (servicer from target)"


@pytest.mark.parametrize("name", [r"$\foo$", "a $ and a {", "$$"])
def test_a_name_that_looks_like_mathematics_is_drawn_as_it_is(campaign, tmp_path, name):
    paths = write_figures(campaign.history(0), tmp_path, name)
    assert all(path.stat().st_size for path in paths.values())


def test_every_figure_says_what_it_shows_and_where_it_comes_from(campaign, tmp_path, monkeypatch):
    titles = []
    monkeypatch.setattr(
        "rpojax.report.figures.png_export.png_bytes", lambda figure: titles.append(figure.get_suptitle()) or b""
    )
    write_figures(campaign.history(0), tmp_path, "inspection, run 0")
    assert titles[0] == "Bearing and range (as Figure 6 of the paper): inspection, run 0"
    assert [title.partition("Figure ")[2][0] for title in titles] == ["6", "7", "8"]


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
