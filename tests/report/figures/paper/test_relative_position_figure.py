"""Figure 8: the flipped sign of the relative position."""

import numpy as np

from rpojax.report.figures.paper_figures import relative_position


def test_figure_8_flips_the_sign_and_states_it(campaign):
    history = campaign.history(0)
    figure = relative_position(history, "")
    along_track = {line.get_label(): np.asarray(line.get_xydata()).T for line in figure.axes[1].lines}
    np.testing.assert_array_equal(along_track["truth"][1], -history["rho_H"][:, 1])
    np.testing.assert_array_equal(along_track["estimate"][1], -history["rho_estimate_H"][:, 1])
    assert set(along_track["desired"][1]) == {30.0}
    assert "sign flipped" in figure.axes[0].get_title()
