"""Figure 6: boxes and truth, scales and markers."""

import numpy as np

from rpojax.report.figures.paper_figures import bearing_and_range


def _lines(axes):
    return {line.get_label(): np.asarray(line.get_xydata()).T for line in axes.lines}


def test_accepted_and_rejected_boxes_and_those_beyond_the_scale(campaign):
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
    assert set(np.asarray(edge.get_ydata()).tolist()) == {axes.get_ylim()[1]}
    assert [text.get_text() for text in axes.texts] == [f"beyond the scale: {beyond.sum()}"]
    np.testing.assert_allclose(distance["truth"][1], np.linalg.norm(history["rho_H"], axis=1))


def test_bearing_scale_fits_accepted_boxes(campaign):
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


def test_true_bearing_points_from_the_servicer_to_the_target(campaign):
    along_track = _lines(bearing_and_range(campaign.history(0), "").axes[1])
    assert np.min(along_track["truth"][1]) > 0.9
