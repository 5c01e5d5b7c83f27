"""Places before the docking port: counts, limit and ellipse of the runs, and the figure of them."""

import json

import numpy as np
import pytest
from report_page_parser import page_text, rendered_page

from rpojax.report.sections import port_section

LIMIT = {"metric": "capture_lateral_m", "bound": "at most", "limit": 0.05, "probability": 0.9, "consumer_risk": 0.1}
COVARIANCE = np.array([[4e-4, 3e-4], [3e-4, 9e-4]])


def stays(runs):
    """Arrays of the phases of runs that are in the first one all the time."""
    by_phase = np.tile([100.0, np.nan, np.nan], (runs, 1))
    names = ("duration_s", "delta_v_m_s", "formation_error_rms_m", "nees_relative_mean", "min_range_m", "max_range_m")
    return {
        **dict.fromkeys(names, by_phase),
        "abort_reason": np.zeros(runs, np.int8),
        "unmet_conditions": np.zeros(runs, np.int8),
        "transition_count": np.ones(runs, np.int32),
        "transition_phase": np.zeros((runs, 1), np.int8),
        "transition_by": np.zeros((runs, 1), np.int8),
        "transition_at_s": np.zeros((runs, 1)),
    }


def arrived(build, runs=400, **more):
    """Runs with normally distributed places of which two never came there, and a limit on their offset."""
    campaign = build(runs=runs, **more)
    rng = np.random.default_rng(3)
    places = np.column_stack([rng.multivariate_normal([0.01, -0.02], COVARIANCE, runs), rng.normal(1.2, 0.01, runs)])
    places[[1, 5]] = np.nan
    campaign.phases = {**stays(runs), "arrival_place_P_m": places}
    campaign.metrics["capture_lateral_m"] = np.hypot(places[:, 0], places[:, 1])
    campaign.phase_names = ("capture", "hold", "aborted")
    campaign.info["scenario"] = {**campaign.info["scenario"], "requirements": [LIMIT]}
    return campaign, places


def test_the_ellipse_has_99_percent_of_a_normal_distribution(build):
    campaign, places = arrived(build)
    found = port_section.content(campaign)
    there = np.isfinite(places[:, 0])
    assert (found["runs"], found["arrived"], found["limit_m"]) == (400, 398, 0.05)
    assert found["beyond"] == np.sum(np.hypot(*places[there, :2].T) > 0.05)
    assert found["along_median_m"] == pytest.approx(np.median(places[there, 2]))
    ellipse = found["ellipse"]
    variances, axes = np.linalg.eigh(COVARIANCE)
    # The square of the distance in standard deviations has two degrees of freedom: its 99th percentile is 9.21.
    expected = np.sqrt(9.21034 * variances[::-1])
    np.testing.assert_allclose(ellipse["semi_axes_m"], expected, rtol=0.1)
    assert abs(np.dot(ellipse["first_axis"], axes[:, 1])) > 0.99
    drawn = np.random.default_rng(4).multivariate_normal(ellipse["middle_m"], np.cov(places[there, :2].T), 100_000)
    first = np.array(ellipse["first_axis"])
    along = (drawn - ellipse["middle_m"]) @ np.array([first, [-first[1], first[0]]]).T / ellipse["semi_axes_m"]
    assert np.mean(np.hypot(*along.T) <= 1.0) == pytest.approx(0.99, abs=2e-3)


def test_the_figure_has_every_run_that_came_there_and_marks_failed_ones(build):
    campaign, places = arrived(build, failed=(1, 7))
    found = port_section.content(campaign)
    chart = port_section.chart(campaign, found)
    traces = {trace["name"]: trace for trace in chart["data"]}
    assert list(traces) == ["limit of 0.05 m", "ellipse of 99 %", "runs", "failed runs"]
    assert traces["failed runs"]["text"] == [7]
    assert len(traces["runs"]["text"]) == 397
    np.testing.assert_allclose([traces["failed runs"][axis][0] for axis in "xy"], places[7, :2], rtol=1e-4)
    np.testing.assert_allclose(
        np.hypot(traces["limit of 0.05 m"]["x"], traces["limit of 0.05 m"]["y"]), 0.05, rtol=1e-4
    )
    outline = np.column_stack([traces["ellipse of 99 %"][axis] for axis in "xy"]) - found["ellipse"]["middle_m"]
    mahalanobis = np.einsum(
        "ni,ij,nj->n", outline, np.linalg.inv(np.cov(places[[0, *range(2, 5), *range(6, 400)], :2].T)), outline
    )
    np.testing.assert_allclose(mahalanobis, 9.21034, rtol=1e-3)
    assert chart["layout"]["xaxis"]["range"] == chart["layout"]["yaxis"]["range"]


def test_the_page_shows_it_for_missions_that_end_at_a_port_only(build):
    page = rendered_page(arrived(build, runs=40)[0])
    assert "38 of 40 runs came there" in page_text(page)
    assert "port" in json.loads(page.data)["charts"]
    without = rendered_page(build(runs=40))
    assert "At the docking port" not in page_text(without)
    assert "port" not in json.loads(without.data)["charts"]


def test_few_runs_have_no_ellipse_and_none_no_figure(build):
    campaign, places = arrived(build, runs=8)
    found = port_section.content(campaign)
    assert found["ellipse"] is None
    assert [trace["name"] for trace in port_section.chart(campaign, found)["data"]] == ["limit of 0.05 m", "runs"]
    campaign.phases = {"arrival_place_P_m": np.full_like(places, np.nan)}
    nobody = port_section.content(campaign)
    assert (nobody["arrived"], nobody["along_median_m"]) == (0, None)
    assert port_section.chart(campaign, nobody) is None
    assert port_section.finding(nobody) == "0 of 8 runs came there; 0 of them beyond 0.05 m from the axis"
    assert port_section.content(build(runs=8)) is None
