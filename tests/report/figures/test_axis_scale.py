"""Axes that a few runs far away do not stretch."""

import numpy as np
import pytest

from rpojax.report.figures.axis_scale import axis_ends, spans_decades
from rpojax.report.figures.plotly_charts import histogram_chart
from rpojax.report.labels import CHANNEL_LABELS, metric_label
from rpojax.report.sections.envelope_section import envelope_chart

RANGE = next(label for label in CHANNEL_LABELS if label.name == "range_m")


def test_three_of_thirty_two_runs_that_drift_kilometres_away_are_counted_at_the_edge():
    values = np.concatenate([np.linspace(0.3, 1.1, 29), [900.0, 2100.0, 5400.0]])
    assert axis_ends(values, [2.0]) == (0.3, 2.0)
    chart = histogram_chart(metric_label("formation_error_rms_m"), values)
    bars = chart["data"][0]
    assert sum(bars["y"]) == 29
    assert max(bars["x"]) < 1.2
    assert "3 beyond \N{RIGHTWARDS ARROW}" in [each.get("label", {}).get("text") for each in chart["layout"]["shapes"]]
    below = histogram_chart(metric_label("min_range_m"), -values)
    assert "\N{LEFTWARDS ARROW} 3 below" in [each.get("label", {}).get("text") for each in below["layout"]["shapes"]]


def test_a_histogram_of_which_many_runs_are_far_away_is_logarithmic():
    values = np.concatenate([np.linspace(0.3, 1.1, 13), [90.0, 210.0, 650.0]])
    chart = histogram_chart(metric_label("formation_error_rms_m"), values)
    bars = chart["data"][0]
    assert chart["layout"]["xaxis"]["type"] == "log"
    assert sum(bars["y"]) == 16
    ends = [(x - width / 2, x + width / 2) for x, width in zip(bars["x"], bars["width"], strict=True)]
    assert ends[0][0] == pytest.approx(0.3, rel=1e-3)
    assert ends[-1][1] == pytest.approx(650.0, rel=1e-3)
    ratios = [high / low for low, high in ends]
    assert ratios == pytest.approx([ratios[0]] * len(ratios), rel=1e-2)


def envelope(far):
    """Envelope of the range of 32 runs at 30 m, of which the last ones drift away."""
    values = np.full((32, 50), 30.0) + np.linspace(-1.0, 1.0, 32)[:, None]
    values[32 - far :] *= np.linspace(1.0, 100.0, 50)
    chart = envelope_chart(RANGE, np.arange(50.0), values, np.ones(32, bool), limits=(15.0,))
    assert chart is not None
    return chart["layout"]


def test_an_envelope_is_clipped_with_the_count_beyond_or_logarithmic():
    clipped = envelope(3)
    assert clipped["yaxis"]["range"][1] < 35.0
    [note] = clipped["annotations"]
    assert note["text"] == "3 runs beyond, to 3100"
    assert "type" not in clipped["yaxis"]
    many = envelope(14)
    assert (many["yaxis"]["type"], many.get("annotations")) == ("log", None)
    none = envelope(0)
    assert "range" not in none["yaxis"]
    assert "type" not in none["yaxis"]


@pytest.mark.parametrize(
    ("values", "wide"), [([1.0, 2.0, 3.0], False), ([1.0, 1.0, 60.0], True), ([-1.0, 1.0, 60.0], False)]
)
def test_positive_values_that_reach_far_beyond_their_middle_span_decades(values, wide):
    assert spans_decades(np.array(values)) is wide
    assert spans_decades(np.zeros(0)) is False
