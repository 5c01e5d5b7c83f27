"""Range and error over time of two runs, for campaigns without histories."""

import numpy as np
from report_page_parser import page_text, rendered_page

from rpojax.report.page import report_json
from rpojax.report.sections import trace_section
from rpojax.simulation.outcomes.outcome_kinds import Outcome


def test_the_worst_run_is_a_failed_one_with_its_moment_and_the_limits(build):
    campaign = build(runs=9, failed=(4,), kept=())
    limit = {"metric": "min_range_m", "bound": "at least", "limit": 15.0, "probability": 0.9, "consumer_risk": 0.1}
    campaign.info["scenario"]["requirements"] = [limit]
    content = report_json.report_content(campaign, [])
    found = trace_section.charts(campaign, content)
    assert [each.name for each in found] == ["trace-range_m", "trace-formation_error_m"]
    errors = campaign.metrics["formation_error_rms_m"]
    median = int(
        np.argsort(np.where(np.isfinite(errors), -errors, np.inf), kind="stable")[np.isfinite(errors).sum() // 2]
    )
    range_chart = found[0].chart
    assert [trace["name"] for trace in range_chart["data"]] == [f"median run {median}", "failed run 4"]
    texts = [shape["label"]["text"] for shape in range_chart["layout"]["shapes"]]
    assert texts[0] == "limit 15 m"
    assert texts[-1].startswith(f"run 4: {Outcome(str(campaign.outcomes[4])).reason}, ")
    words = page_text(rendered_page(campaign))
    assert "Range between the spacecraft [m] over time" in words


def test_the_run_beside_the_median_is_called_what_it_is(build):
    def shown(failed):
        campaign = build(runs=9, failed=failed, kept=())
        content = report_json.report_content(campaign, [])
        return trace_section.charts(campaign, content)[0].chart["data"][-1]["name"], campaign

    # Which failed run is the worst one, nothing says; without failures it is the one with the greatest error.
    assert shown((4, 6))[0] == "run 4, one of 2 that failed"
    name, campaign = shown(())
    assert name == f"worst run {campaign.run_ids[np.nanargmax(campaign.metrics['formation_error_rms_m'])]}"


def test_a_page_with_paths_has_no_traces_beside_them(build):
    assert "Range between the spacecraft [m] over time" not in page_text(rendered_page(build(runs=9)))
