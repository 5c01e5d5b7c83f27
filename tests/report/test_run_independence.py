"""Campaigns whose runs are not independent have neither intervals nor verdicts."""

import json
from typing import Any

import pytest

from rpojax.report.page.html_report import write_report
from rpojax.report.page.report_json import report_content, summarise
from rpojax.report.sections.dispersion_section import drawn_distributions


def _intervals(value: Any, path: str = "") -> dict[str, Any]:
    """Values in `value` that require independent runs, by their paths."""
    if isinstance(value, dict):
        named = {f"{path}.{key}": item for key, item in value.items() if _needs_independence(str(key))}
        return named | {k: v for key, item in value.items() for k, v in _intervals(item, f"{path}.{key}").items()}
    if isinstance(value, list):
        return {k: v for index, item in enumerate(value) for k, v in _intervals(item, f"{path}[{index}]").items()}
    return {}


def _needs_independence(key: str) -> bool:
    ends = ("interval_95", "_p", "low_95", "high_95", "lower_95", "upper_95")
    return key.endswith(ends) or key in ("p", "success_interval", "risk_reached", "rank")


@pytest.mark.parametrize("kind", ["latin_hypercube", "sobol"])
def test_no_intervals_or_verdicts_without_independent_runs(build, kind):
    campaign = build(runs=300, seconds=300, kept=(), failed=(1, 2, 3, 50, 60))
    assert any(
        value is not None for value in _intervals(report_content(campaign, drawn_distributions(campaign))).values()
    )
    campaign.info["scenario"]["design"] = {"kind": kind}
    usual = {"metric": "delta_v_m_s", "bound": "at most", "limit": 1.0, "probability": 0.99, "consumer_risk": 0.1}
    campaign.info["scenario"]["requirements"] = [usual]
    assert summarise(campaign)["requirements"][0]["verdict"] == "not independent: no verdict"
    path = write_report(campaign)
    content = json.loads((campaign.directory / "report.json").read_text())
    assert content["design"] == {"kind": kind, "independent": False}
    stated = {place: value for place, value in _intervals(content).items() if value is not None}
    assert stated == {}
    assert {entry["says"] for entry in content["consistency"]["means"]} == {"Nothing, as the runs are not independent."}
    assert any("are not independent of one another" in sentence for sentence in content["limits"])
    assert "so there is no rank, no interval and no verdict" in path.read_text()
