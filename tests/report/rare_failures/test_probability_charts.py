"""Charts of an estimate: the interval beside that of plain runs, the tail, the most likely failure."""

import math
from typing import Any

import pytest
from probability_estimates import ESTIMATE
from scipy.stats import binomtest

from rpojax.report import rare_failures


def charts(**changes: Any) -> dict[str, Any]:
    """Charts of the estimate with other content, by the end of their name."""
    found = rare_failures.charts({**ESTIMATE, **changes}, "one")
    return {each.name.removeprefix("one-"): each.chart for each in found}


def test_the_interval_stands_beside_that_of_as_many_plain_runs() -> None:
    failures, runs = 24, 2000
    chart = charts(evaluations=runs, probability=failures / runs, interval_95=[0.010, 0.014])["interval"]
    bars = {trace["name"]: trace["x"] for trace in chart["data"] if trace["mode"] == "lines"}
    exact = binomtest(failures, runs).proportion_ci(0.95, method="exact")
    assert bars["as many plain runs"] == pytest.approx([exact.low, exact.high])
    assert bars["method importance"] == [0.010, 0.014]
    points = {trace["name"]: trace["x"] for trace in chart["data"] if trace["mode"] == "markers"}
    assert points == {"as many plain runs": [failures / runs], "method importance": [failures / runs]}
    [limit] = chart["layout"]["shapes"]
    assert (limit["x0"], limit["label"]["text"]) == (1e-4, "allowed 0.0001")


def test_an_interval_from_zero_ends_at_the_edge_of_the_logarithmic_axis() -> None:
    chart = charts(evaluations=2000, probability=0.0, interval_95=[0.0, 1e-5], requirement=None)["interval"]
    edge = 10.0 ** chart["layout"]["xaxis"]["range"][0]
    lows = [trace["x"][0] for trace in chart["data"] if trace["mode"] == "lines"]
    assert lows == pytest.approx([edge, edge])
    assert 0.0 < edge < 1e-5
    assert not [trace for trace in chart["data"] if trace["mode"] == "markers"], "no point at zero on such an axis"
    assert chart["layout"]["shapes"] == []


def level(probability: float, threshold: float | None) -> dict[str, Any]:
    """A stage of an estimate."""
    return {"name": "level", "evaluations": 9, "probability": probability, "threshold": threshold, "acceptance": 0.4}


def test_the_tail_multiplies_the_conditional_probabilities_of_the_levels_of_each_search() -> None:
    levels = [level(0.1, 2.5), level(0.2, 1.5), level(0.5, 0.0), level(0.1, 2.4), level(0.3, 0.0)]
    *lines, dot = charts(levels=levels, probability=0.02)["tail"]["data"]
    assert [line["x"] for line in lines] == [[2.5, 1.5, 0.0], [2.4, 0.0]]
    assert lines[0]["y"] == pytest.approx([0.1, 0.1 * 0.2, 0.1 * 0.2 * 0.5])
    assert lines[1]["y"] == pytest.approx([0.1, 0.1 * 0.3])
    assert (dot["x"], dot["y"]) == ([0.0], [0.02])


def test_a_method_without_levels_has_no_tail() -> None:
    assert "tail" not in charts(levels=[level(0.1, None)])
    assert "tail" not in charts(levels=[level(0.5, 0.0), level(0.5, 0.0)], probability=0.3)


def test_the_most_likely_failure_is_the_first_design_point_or_else_the_first_failing_run() -> None:
    [bars] = charts()["unusual"]["data"]
    assert (bars["y"], bars["x"]) == (["servicer.mass_kg"], [4.0])
    run = {
        "distance_sigmas": 3.0,
        "command": "x",
        "dispersions": [{"name": "a", "sigmas": {"a[0]": 0.5, "a[1]": -2.0}}, {"name": "b", "sigmas": {"b": 1.0}}],
    }
    [bars] = charts(design_points=[], failing_runs=[run])["unusual"]["data"]
    assert (bars["y"], bars["x"]) == (["a[0]", "b", "a[1]"], [0.5, 1.0, -2.0]), "the farthest is drawn at the top"
    assert "unusual" not in charts(design_points=[], failing_runs=[])
    assert all(math.isfinite(value) for value in bars["x"])
