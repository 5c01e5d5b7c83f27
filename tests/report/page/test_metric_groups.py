"""Histograms by what they measure."""

from types import SimpleNamespace

from rpojax.metrics.metric_catalogue import METRICS
from rpojax.report.page.metric_groups import histogram_groups


def entry(name, chart=None):
    return {"name": name, "metric": SimpleNamespace(title=name), "chart": {} if chart is None else chart}


def test_every_metric_of_the_package_has_a_group_of_its_subject():
    groups = histogram_groups([entry(name) for name in METRICS], set())
    assert sum(len(group.entries) for group in groups) == len(METRICS)
    assert "Of plugins, and others" not in [group.title for group in groups]
    assert len(groups) == 11


def test_those_with_a_requirement_come_first_and_those_of_plugins_last():
    names = ("fuel_margin_kg", "delta_v_m_s", "min_range_m@hold", "nees_mean")
    groups = histogram_groups([entry(name) for name in names], {"nees_mean"})
    assert [(group.title, group.names) for group in groups] == [
        ("With a requirement", "nees_mean"),
        ("Range and delta-v", "delta_v_m_s, min_range_m@hold"),
        ("Of plugins, and others", "fuel_margin_kg"),
    ]
    assert histogram_groups([{**entry("nees_mean"), "chart": None}], {"nees_mean"}) == []
