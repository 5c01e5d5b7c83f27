"""Worst runs of the key metrics."""

import numpy as np

from rpojax.report.sections import metrics_section


def test_five_worst_runs_of_each_key_metric_on_the_bad_side(build):
    campaign = build(runs=30, seconds=60, kept=(), failed=(7,))
    campaign.metrics["min_range_m"] = np.linspace(20.0, 30.0, 30)
    found = {
        entry["metric"]: [run["run_id"] for run in entry["runs"]] for entry in metrics_section.worst_runs(campaign)
    }
    assert found["min_range_m"] == [0, 1, 2, 3, 4]
    expected = np.argsort(-np.nan_to_num(campaign.metrics["delta_v_m_s"], nan=-1.0))[:5]
    assert found["delta_v_m_s"] == expected.tolist()
    rows = metrics_section.worst_run_rows(metrics_section.worst_runs(campaign))
    assert "Minimum range 20 m (worst)" in dict(rows)[0]
    assert len(rows[0][1]) == max(len(places) for _, places in rows)
