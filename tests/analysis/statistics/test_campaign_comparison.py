"""Changed keys of two scenarios, and a comparison as a table."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rpojax.analysis.statistics.campaign_comparison import (
    CampaignComparison,
    KeyChange,
    changed_keys,
    defined_differently,
    relative_change,
    servicer_warnings,
)
from rpojax.analysis.statistics.paired_comparison import IntervalEstimate, MedianChange, RunMetrics, compare_paired_runs


def test_changed_keys_are_found_at_any_depth_and_on_either_side() -> None:
    one = {"a": {"b": 1, "c": [1, 2]}, "d": 4}
    other = {"a": {"b": 1, "c": [1, 3]}, "e": 5}
    assert changed_keys(one, other) == (
        KeyChange("a.c", [1, 2], [1, 3]),
        KeyChange("d", 4, None),
        KeyChange("e", None, 5),
    )


def test_a_table_has_the_change_of_every_metric_with_its_interval() -> None:
    ids, outcomes = np.arange(40), np.full(40, "completed")
    first = RunMetrics(ids, outcomes, {"range_m": 10.0 + ids / 10.0, "delta_v_m_s": np.ones(40)})
    second = RunMetrics(ids, outcomes, {"range_m": 12.0 + ids / 10.0, "delta_v_m_s": np.ones(40)})
    runs = compare_paired_runs(first, second, (), independent=True)
    found = CampaignComparison(Path("a"), Path("b"), (), True, (), runs).to_dataframe().set_index("metric")
    assert found.loc["range_m", "difference"] == pytest.approx(2.0)
    assert found.loc["range_m", "difference_low_95"] > 0.0
    assert found["changed"].to_dict() == {"range_m": True, "delta_v_m_s": False}
    assert found.loc["range_m", "second"] - found.loc["range_m", "first"] == pytest.approx(2.0)


def of_plugin(content: str, **metrics: dict[str, str]) -> dict[str, Any]:
    """What `campaign.json` tells of a plugin with such a digest and metrics."""
    return {"scenario": {"plugin_sha256": content}, "plugin": {"metrics": metrics}}


def test_metrics_of_changed_plugins_are_told_by_their_definitions() -> None:
    one, other = {"unit": "m", "sha256": "a"}, {"unit": "m", "sha256": "b"}
    without_digest = {"unit": "m"}
    first = of_plugin("x", changed=one, same=one, old=without_digest, alone=one)
    second = of_plugin("y", changed=other, same=one, old=without_digest, new=one)
    assert defined_differently(first, second) == ["changed", "old"]
    assert defined_differently(second, first) == ["changed", "old"]
    assert defined_differently(first, of_plugin("x", changed=other, old=without_digest)) == []
    assert defined_differently(first, {"scenario": {}}) == []
    assert defined_differently({"scenario": {}, "plugin": None}, second) == []


def test_servicers_of_one_campaign_alone_are_named() -> None:
    team = ["range_m", "range_m/first", "range_m/second", "delta_v_m_s/second"]
    assert servicer_warnings(team, reversed(team)) == []
    assert servicer_warnings(["range_m"], ["range_m", "delta_v_m_s"]) == []
    (line,) = servicer_warnings(team, ["range_m", "range_m/first", "range_m/other"])
    assert line.startswith("servicers differ, first, second against first, other: ")


def test_effects_are_ranked_by_their_share_of_both_medians() -> None:
    none = IntervalEstimate(None, None, None)

    def of(first: float, second: float) -> float:
        return relative_change(MedianChange("range_m", 40, first, second, none, none))

    assert [of(1.0, 1.0), of(1.0, 3.0), of(3.0, 1.0), of(-1.0, 1.0), of(0.0, 0.0)] == [0.0, 0.5, 0.5, 1.0, 0.0]


def test_the_summary_has_what_changed_and_what_came_of_it() -> None:
    ids = np.arange(40)
    metrics = {"min_range_m": 10.0 + ids / 10.0, "delta_v_m_s": np.ones(40)}
    first = RunMetrics(ids, np.full(40, "completed"), metrics)
    second = RunMetrics(ids, np.where(ids < 5, "lost", "completed"), metrics | {"min_range_m": 12.0 + ids / 10.0})
    runs = compare_paired_runs(first, second, (), independent=True)
    changed = (KeyChange("camera.edge_noise_px", 1.0, 3.0),)
    lines = repr(CampaignComparison(Path("a"), Path("b"), changed, True, ("beware",), runs)).splitlines()
    assert lines[:2] == ["a -> b: 40 pairs of runs", "  changed  camera.edge_noise_px: 1 -> 3"]
    assert lines[2].startswith("  failed   0 -> 5 of 40, p = ")
    assert lines[3].startswith("  medians  min_range_m: 11.95 -> 13.95 m (95 % of the difference 2")
    assert lines[4:] == ["  warning  beware"]
