"""Caveats on independence, undefined metrics and sources of variation."""

from typing import Any

import numpy as np
import pytest
from report_page_parser import page_text, rendered_page

from rpojax.report.page.report_json import summarise
from rpojax.report.sections import caveats_section

NO_DRAWS = "The runs follow a table of given values and are not independent of one another."


def test_dependent_runs_are_a_caveat(campaign: Any) -> None:
    assert not any("design" in sentence for sentence in caveats_section.caveat_sentences(campaign, summarise(campaign)))
    campaign.info["scenario"]["design"] = {"kind": "table", "file": "", "values": {"gps.noise_m": [0.125] * 5000}}
    assert any(
        sentence.startswith(NO_DRAWS) for sentence in caveats_section.caveat_sentences(campaign, summarise(campaign))
    )


@pytest.mark.parametrize(("undefined", "from_the_end"), [(1, 2), (3, None), (650, None)])
def test_undefined_completed_runs_count_in_the_bounds_and_are_a_caveat(build, undefined, from_the_end):
    campaign = build(runs=700, seconds=30, kept=())
    values = np.sort(campaign.metrics["delta_v_m_s"][undefined:])
    campaign.metrics["delta_v_m_s"][:undefined] = np.nan
    summary = summarise(campaign)
    entry = summary["metrics"]["delta_v_m_s"]
    assert entry["p99_upper_95"] == (None if from_the_end is None else values[-from_the_end])
    assert entry["p1_lower_95"] == (None if from_the_end is None else values[from_the_end - 1])
    said = [
        sentence
        for sentence in caveats_section.caveat_sentences(campaign, summary)
        if sentence.startswith("Undefined in some")
    ]
    assert len(said) == 1
    assert f"of the 700 runs that reached their end: Delta-v ({undefined})." in said[0]


def test_metric_defined_in_no_run_needs_no_caveat(build):
    campaign = build(runs=20, seconds=30, kept=())
    assert not any(
        "undefined" in sentence.lower() for sentence in caveats_section.caveat_sentences(campaign, summarise(campaign))
    )


def test_sources_of_variation_are_listed(build):
    campaign = build(runs=3, kept=())
    words = page_text(rendered_page(campaign))
    for cause in ("Dispersions", "hand-over", "execution errors of burns", "slowly varying errors"):
        assert cause in words.partition("From run to run vary")[2][:250]
    campaign.drawn = {}
    assert "the runs differ by the error of the hand-over" in page_text(rendered_page(campaign))
