"""The line of each folded section says what one would find in it."""

import re

import numpy as np
from report_page_parser import page_text, rendered_page


def findings(page):
    """Line of each section by its title."""
    words = page_text(page)
    return lambda title, text: re.search(rf"{re.escape(title)} {text}", words)


def test_lines_are_made_of_what_was_found(build):
    campaign = build(runs=40, failed=(3, 7))
    campaign.metrics["nees_relative_mean"] = np.full(40, 2.7)
    campaign.metrics["sigma3_coverage"] = np.full(40, 0.9999)
    found = findings(rendered_page(campaign))
    assert found("Filter consistency", r"NEES / 6 0\.450 \(1 is consistent\), 99\.99 % of errors inside 3 sigma")
    assert found("Failed runs", "2 of 40: 2 entered the keep-out sphere")
    assert found("Convergence", r"Failure rate 5 % \(95 % interval 0\.61 to 17 %\)")
    assert found("Requirements", "None are stated")
    assert found("Headline numbers", r"Medians: formation error [\d.]+ m, relative navigation error [\d.]+ m, delta-v")
    assert found("Distributions", r"\d+ histograms in \d groups")
    assert found("Dispersions as drawn", r"\d+ numbers? drawn; none contradicts what is declared")
    assert found("Single runs", r"Median run \d; worst runs of the requirements: ")
    assert found("Scenario", r"\d+ values, defaults included")
    assert found("Envelopes over time", "Bands of all runs: formation error, relative navigation error, range")


def test_lines_of_a_campaign_without_anything_say_so(build):
    campaign = build(runs=3, kept=())
    campaign.drawn, campaign.traces, campaign.info = {}, {}, {"name": "bare"}
    found = findings(rendered_page(campaign))
    assert found("Failed runs", "None failed")
    assert found("Convergence", "Needs at least twenty runs")
    assert found("Dispersions as drawn", "Nothing was dispersed")
    assert found("Single runs", "No full history was kept")
    assert found("Sensitivity", "Needs at least ten runs and a dispersed input")


def test_requirements_are_counted_by_verdict(build):
    campaign = build(runs=60, kept=())
    common = {"bound": "at most", "probability": 0.9, "consumer_risk": 0.1}
    campaign.info["scenario"]["requirements"] = [
        {"metric": "delta_v_m_s", "limit": 1e3, **common},
        {"metric": "formation_error_rms_m", "limit": 1e-6, **common},
        {"metric": "nees_mean", "limit": 1e-6, **common},
    ]
    assert findings(rendered_page(campaign))("Requirements", "1 verified, 2 violated")
