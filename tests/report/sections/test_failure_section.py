"""Failure reasons and the inputs that distinguish failed runs."""

import numpy as np
from report_page_parser import page_text, rendered_page

from rpojax.report.sections import driver_section, failure_section
from rpojax.simulation.outcomes.outcome_events import OutcomeEvent
from rpojax.simulation.outcomes.outcome_kinds import Outcome


def test_distinguishing_inputs_are_named_for_each_outcome(build):
    failed = tuple(range(0, 60, 3))
    campaign = build(runs=200, seconds=60, kept=(), failed=failed)
    campaign.drawn["gps.noise_m"][list(failed)] += 5.0
    campaign.outcomes[0] = "non_finite"
    found = failure_section.content(campaign)
    assert [(one["outcome"], one["reason"], one["runs"]) for one in found] == [
        ("keep_out", "entered the keep-out sphere", 19),
        ("non_finite", "non-finite state", 1),
    ]
    drivers = driver_section.content(campaign)
    # One run alone proves nothing.
    assert {one["event"] for one in drivers["drivers"]} == {"entered the keep-out sphere"}
    assert drivers["drivers"][0]["inputs"] == ["gps.noise_m"]
    assert drivers["drivers"][0]["count"] == [0, 0, 19]
    words = page_text(rendered_page(campaign))
    assert "gps.noise_m" in words.partition("Drivers")[2]


def test_without_a_completed_run_outcomes_are_told_from_each_other(build):
    campaign = build(runs=40, seconds=60, kept=(), failed=tuple(range(40)))
    assert [one["compared_with"] for one in failure_section.content(campaign)] == [0]
    campaign.outcomes[:20] = "lost"
    campaign.drawn["gps.noise_m"][:20] += 5.0
    found = failure_section.content(campaign)
    assert [(one["outcome"], one["runs"], one["compared_with"]) for one in found] == [
        ("lost", 20, 20),
        ("keep_out", 20, 20),
    ]
    leading = driver_section.content(campaign)["drivers"][:2]
    assert [one["inputs"] for one in leading] == [["gps.noise_m"]] * 2


def test_flags_that_were_raised_and_cleared_are_listed(build):
    campaign = build(runs=12, kept=())
    assert "Flags on the way" not in page_text(rendered_page(campaign))
    campaign.events = [OutcomeEvent(3, Outcome.LOST, 700.0, 900.0), OutcomeEvent(4, Outcome.LOST, 800.0, None)]
    entries = failure_section.event_entries(campaign)
    assert entries[0] == {"run_id": 3, "outcome": "lost", "raised_at_s": 700.0, "cleared_at_s": 900.0}
    words = page_text(rendered_page(campaign))
    assert "lost the target: raised in 2 runs, cleared in 1." in words


def test_failed_runs_are_named_by_reason_the_most_frequent_first():
    counts = {**dict.fromkeys(map(str, Outcome), 0), "completed": 5, "lost": 1, "off_station": 2}
    assert failure_section.outcomes_text(counts) == "2 off station, 1 lost the target"
    assert np.sum(list(counts.values())) == 8


def test_medians_of_telling_metrics_are_given_for_failed_and_completed_runs(build):
    campaign = build(runs=40, seconds=60, kept=())
    campaign.outcomes[:10] = "lost"
    campaign.completed[:10] = False
    campaign.metrics["detection_rate"][:10] = 0.125
    campaign.metrics["detection_rate"][9] = np.nan
    (found,) = failure_section.content(campaign)
    assert found["signs"][0] == {"metric": "detection_rate", "median": 0.125, "others": 0.95}
    assert failure_section.sign_rows(found)[0] == ["Detection rate", "0.1250", "0.9500"]
    # Frozen runs have no metrics.
    campaign.outcomes[:10] = "keep_out"
    for values in campaign.metrics.values():
        values[:10] = np.nan
    assert failure_section.content(campaign)[0]["signs"] == []
