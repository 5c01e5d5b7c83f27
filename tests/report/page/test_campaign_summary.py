"""Summary of a campaign: counts of runs, statistics, provenance, strict JSON."""

import json

import numpy as np
import pytest

from rpojax.report.page.report_json import summarise

_STATISTICS = ("mean", "std", "min", "p1", "p5", "p50", "p95", "p99", "max", "p1_lower_95", "p99_upper_95")
NO_RUNS = dict.fromkeys(
    (
        "completed",
        "lost",
        "off_station",
        "unfinished",
        "diverged",
        "out_of_propellant",
        "keep_out",
        "non_finite",
        "aborted",
        "not_judged",
    ),
    0,
)
"""Number of runs by outcome, of no runs."""


def test_statistics_are_over_defined_values(campaign):
    campaign.metrics["formation_error_rms_m"][:3] = np.nan, np.inf, -np.inf
    entry = summarise(campaign)["metrics"]["formation_error_rms_m"]
    values = campaign.metrics["formation_error_rms_m"][3:]
    assert entry["unit"] == "m"
    assert entry["defined"] == len(values)
    assert entry["mean"] == pytest.approx(values.mean())
    assert entry["std"] == pytest.approx(values.std(ddof=1))
    assert [entry[key] for key in ("min", "p1", "p5", "p50", "p95", "p99", "max")] == pytest.approx(
        np.percentile(values, [0, 1, 5, 50, 95, 99, 100])
    )


def test_bound_of_p99_needs_299_runs(build):
    assert summarise(build(runs=298, seconds=30))["metrics"]["delta_v_m_s"]["p99_upper_95"] is None
    enough = build(runs=299, seconds=30)
    entry = summarise(enough)["metrics"]["delta_v_m_s"]
    assert entry["p99_upper_95"] == entry["max"]
    assert entry["p1_lower_95"] == entry["min"]


@pytest.mark.parametrize(("failed", "from_the_end"), [(0, 3), (1, 2), (2, 1), (3, None)])
def test_failed_runs_count_as_worst_in_the_bounds(build, failed, from_the_end):
    # Of 700 runs the 698th is the bound: P(Bin(700, 0.99) <= 697) = 0.971, and 0.919 for one less.
    campaign = build(runs=700, seconds=30, kept=(), failed=tuple(range(failed)))
    entry = summarise(campaign)["metrics"]["delta_v_m_s"]
    values = np.sort(campaign.metrics["delta_v_m_s"])[: 700 - failed]
    assert entry["p99_upper_95"] == (None if from_the_end is None else values[-from_the_end])
    assert entry["p1_lower_95"] == (None if from_the_end is None else values[from_the_end - 1])


def test_metric_defined_in_no_run_is_null(campaign):
    entry = summarise(campaign)["metrics"]["look_away_peak_s"]
    assert all(entry[key] is None for key in _STATISTICS)
    assert entry["defined"] == 0


def test_standard_deviation_of_one_run_and_of_equal_runs(build):
    assert summarise(build(runs=1, kept=()))["metrics"]["delta_v_m_s"]["std"] is None
    assert summarise(build(runs=9, kept=()))["metrics"]["detection_rate"]["std"] == 0.0


def test_runs_failures_and_provenance(build):
    campaign = build(runs=12, failed=(4, 9))
    summary = summarise(campaign)
    outcomes = {**NO_RUNS, "completed": 10, "keep_out": 2}
    counts = {"requested": 12, "completed": 10, "failed": 2, "not_judged": 0, "missing": 0}
    assert summary["runs"] == {**counts, "outcomes": outcomes}
    failure = {"outcome": "keep_out", "at_s": 300.0, "reason": "entered the keep-out sphere", "detail": ""}
    failure |= {"cause": "", "cause_text": ""}
    assert summary["failures"] == [{"run_id": run, **failure} for run in (4, 9)]
    assert summary["provenance"]["scenario_hash"] == campaign.info["scenario_hash"]
    assert summary["requirements"] == []


def test_runs_of_unfinished_blocks_are_missing(build):
    campaign = build(runs=12, failed=(4,))
    campaign.info["runs"] = 20
    found = summarise(campaign)["runs"]
    assert found.pop("outcomes") == {**NO_RUNS, "completed": 11, "keep_out": 1}
    assert found == {"requested": 20, "completed": 11, "failed": 1, "not_judged": 0, "missing": 8}


def test_runs_that_are_not_judged_neither_failed_nor_completed(build):
    campaign = build(runs=12, failed=(4,))
    campaign.outcomes[:3], campaign.completed[:3] = "not_judged", False
    found = summarise(campaign)
    runs = found["runs"]
    assert (runs["requested"], runs["completed"], runs["failed"], runs["not_judged"]) == (12, 8, 1, 3)
    assert runs["outcomes"] == {**NO_RUNS, "completed": 8, "keep_out": 1, "not_judged": 3}
    assert [failure["run_id"] for failure in found["failures"]] == [4]


@pytest.mark.parametrize("choices", [{}, {"runs": 1}, {"runs": 5, "failed": range(5)}, {"runs": 3, "kept": ()}])
def test_is_strict_json(build, choices):
    campaign = build(**choices)
    campaign.info["timing"] = {"run_s": np.float32(1.5), "compile_s": np.nan, "devices": np.int64(2)}
    text = json.dumps(summarise(campaign), allow_nan=False)
    assert json.loads(text)["provenance"]["timing"] == {"run_s": 1.5, "compile_s": None, "devices": 2}
