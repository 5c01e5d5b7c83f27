"""Display order of metrics."""

import numpy as np

from rpojax.report.page.report_json import summarise


def test_metrics_are_in_display_order(campaign):
    campaign.metrics = {"of_ones_own": np.ones(40), **dict(sorted(campaign.metrics.items()))}
    names = list(summarise(campaign)["metrics"])
    assert names[:2] == ["formation_error_rms_m", "nav_relative_position_error_rms_m"]
    assert names[-2:] == ["outliers_accepted", "of_ones_own"]
    assert names.index("nees_mean") < names.index("delta_v_m_s") < names.index("boxes_rejected")
