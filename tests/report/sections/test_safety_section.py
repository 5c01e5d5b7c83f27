"""Smallest ranges, keep-out entries and their intervals."""

import numpy as np
import pytest

from rpojax.report.sections import safety_section


def test_smallest_range_includes_failed_runs(build):
    campaign = build(runs=30, seconds=300, kept=(), failed=(5,))
    campaign.traces["range_m"][5, 3] = 9.5
    campaign.metrics["passive_range_m"] = np.where(np.arange(30) < 2, 8.0, 20.0)
    campaign.metrics["passive_range_m"][5] = np.nan
    found = safety_section.content(campaign)
    assert found["least_range"] == {"value": 9.5, "run_id": 5, "at_most": False}
    assert found["entries"]["run_ids"] == [5]
    # Clopper and Pearson for one of thirty: the ends solve the two binomial tails for 2.5 %.
    low, high = found["entries"]["interval_95"]
    assert 1.0 - (1.0 - low) ** 30 == pytest.approx(0.025)
    assert (1.0 - high) ** 30 + 30 * high * (1.0 - high) ** 29 == pytest.approx(0.025)
    assert (found["passive_below_keep_out"]["count"], found["passive_below_keep_out"]["runs"]) == (3, 30)
    assert found["least_passive_range"] == {"value": 8.0, "run_id": 0}
    assert found["longest_look_away"] is None


def test_range_of_a_keep_out_entry_is_at_most_the_radius(build):
    campaign = build(runs=30, seconds=300, kept=(), failed=(5,))
    found = safety_section.content(campaign)
    assert np.nanmin(campaign.traces["range_m"]) > 10.0
    assert found["least_range"] == {"value": 10.0, "run_id": 5, "at_most": True}
    assert safety_section.rows(found)[0] == ("Smallest range of any run", "at most 10 m", "run 5", False)
    campaign.info["scenario"]["limits"] = {}
    assert safety_section.content(campaign)["least_range"]["at_most"] is False
