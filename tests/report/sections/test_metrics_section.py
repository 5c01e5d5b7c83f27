"""Metric tables."""

import numpy as np
import pytest

from rpojax.report.page.report_json import summarise
from rpojax.report.sections import dispersion_section, metrics_section

_DASH = "\N{EN DASH}"


def test_low_tail_is_shown_where_low_values_are_bad(campaign):
    campaign.metrics["min_range_m"] = np.linspace(20.0, 30.0, 40)
    rows = {row.name: row for row in metrics_section.metric_rows(campaign, summarise(campaign))}
    assert rows["min_range_m"].cells[4:7] == ["p5 20.50", "p1 20.10", f"p1 {_DASH}"]
    assert not any("p" in cell for cell in rows["delta_v_m_s"].cells)
    shown = {entry["name"]: entry for entry in dispersion_section.histogram_entries(campaign, summarise(campaign))}
    assert shown["min_range_m"]["tail"] == "p1 20.10"
    assert shown["min_range_m"]["chart"]["layout"]["shapes"][1]["x0"] == pytest.approx(20.1)
    assert shown["delta_v_m_s"]["tail"].startswith("p99 ")
