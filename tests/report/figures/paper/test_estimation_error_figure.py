"""Figure 7: signs and bounds of the estimation errors."""

import numpy as np

from rpojax.report.figures.paper_figures import estimation_error


def test_relative_error_is_that_of_the_servicer_from_the_target(campaign):
    history = campaign.history(0)
    figure = estimation_error(history, "")
    for axis in range(3):
        axes = figure.axes[3 * axis + 2]
        np.testing.assert_array_equal(axes.lines[0].get_ydata(), -history["relative_error_H"][:, axis])
    assert figure.axes[2].get_title() == "Relative (servicer from target)"


def test_bounds_are_three_sigma_on_both_sides(campaign):
    history = campaign.history(0)
    target_x = estimation_error(history, "").axes[0]
    error, above, below = (np.asarray(line.get_ydata()) for line in target_x.lines)
    np.testing.assert_array_equal(error, history["target_error_H"][:, 0])
    np.testing.assert_array_equal(above, 3.0 * history["target_sigma_H"][:, 0])
    np.testing.assert_array_equal(below, -above)
