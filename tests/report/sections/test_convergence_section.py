"""Convergence with the number of runs."""

import json

import pytest

from rpojax.report.page.html_report import write_report
from rpojax.report.sections import convergence_section


def test_convergence_ends_at_the_statistics_of_all_runs(build):
    campaign = build(runs=400, seconds=60, kept=(), failed=(3, 200))
    content = json.loads((write_report(campaign).parent / "report.json").read_text())
    found = content["convergence"]
    assert (found["runs"][0], found["runs"][-1]) == (10, 400)
    entry, table = found["metrics"]["delta_v_m_s"], content["metrics"]["delta_v_m_s"]
    assert entry["p50"][-1] == pytest.approx(table["p50"])
    assert entry["p99"][-1] == pytest.approx(table["p99"])
    assert [entry["p50_low_95"][-1], entry["p50_high_95"][-1]] == pytest.approx(table["p50_interval_95"])
    assert found["failure_rate"]["rate"][-1] == 2.0 / 400.0
    assert "p1" in found["metrics"]["min_range_m"]
    assert convergence_section.content(build(runs=19, seconds=60, kept=())) is None
