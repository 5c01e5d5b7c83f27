"""NEES, NIS, coverage and whiteness: intervals and their interpretation."""

import numpy as np
import pytest
from report_page_parser import page_text, rendered_page

from rpojax.report.sections import consistency_section


def test_departures_are_found_only_for_inconsistent_filters(build):
    campaign = build(runs=200, seconds=300, kept=())
    campaign.metrics["sigma3_coverage"] = np.random.default_rng(3).binomial(900, 0.9973, 200) / 900.0
    found = {entry["name"]: entry for entry in consistency_section.content(campaign)["means"]}
    for name in ("nees_mean", "nees_relative_mean", "sigma3_coverage"):
        assert found[name]["says"].startswith("No departure")
    campaign.metrics["nees_mean"] = campaign.metrics["nees_mean"] * 2.0
    campaign.metrics["nees_relative_mean"] = campaign.metrics["nees_relative_mean"] / 2.0
    campaign.metrics["sigma3_coverage"] = campaign.metrics["sigma3_coverage"] - 0.02
    found = {entry["name"]: entry for entry in consistency_section.content(campaign)["means"]}
    assert "Above" in found["nees_mean"]["says"]
    assert "too sure of itself" in found["nees_mean"]["says"]
    assert "Below" in found["nees_relative_mean"]["says"]
    assert "cautious" in found["nees_relative_mean"]["says"]
    assert "leave 3 sigma more often" in found["sigma3_coverage"]["says"]


def test_chi_square_intervals_use_one_instant_per_run_for_nees_and_every_update_for_nis(build):
    campaign = build(runs=100, seconds=600, kept=())
    campaign.info["scenario"]["rates"] = {"camera_hz": 1.0}
    campaign.metrics = {name: np.full(100, 3.0) for name in ("nees_mean", "nees_relative_mean", "nis_gps_mean")}
    found = {entry["name"]: entry for entry in consistency_section.content(campaign)["means"]}
    # Tables for 100 runs of 12 and of 6 components.
    assert found["nees_mean"]["chance_interval_95"] == pytest.approx([11.05890, 12.97898], abs=1e-5)
    assert found["nees_relative_mean"]["chance_interval_95"] == pytest.approx([5.34019, 6.69769], abs=1e-5)
    # One run of 600 updates would have 2.80718 to 3.19913; a hundred runs have a tenth of its width.
    low, high = found["nis_gps_mean"]["chance_interval_95"]
    assert high - low == pytest.approx((3.19913 - 2.80718) / 10.0, rel=1e-3)


def test_instants_outside_the_interval_and_their_interpretation(build):
    campaign = build(runs=100, seconds=600, kept=())
    first, second = consistency_section.content(campaign)["over_time"]
    assert (first["name"], first["components"], second["components"]) == ("nees", 12, 6)
    assert first["interval_95"] == pytest.approx([11.05890, 12.97898], abs=1e-5)
    assert first["inside"] == pytest.approx(0.95, abs=0.05)
    assert first["inside"] + first["above"] + first["below"] == pytest.approx(1.0)
    assert first["says"].startswith("No departure can be told")
    nees = campaign.traces["nees"]
    for factor, words in ((1.5, "Mostly above: errors are larger"), (0.6, "Mostly below: errors are smaller")):
        campaign.traces["nees"] = nees * np.float32(factor)
        assert consistency_section.content(campaign)["over_time"][0]["says"].startswith(words)


def test_instants_alone_show_no_departure(build):
    # A few runs with lasting large errors put the average above at every instant.
    campaign = build(runs=100, seconds=600, kept=())
    campaign.traces["nees"] = np.full_like(campaign.traces["nees"], 12.0)
    campaign.traces["nees"][:2] = 120.0
    entry = consistency_section.content(campaign)["over_time"][0]
    assert entry["above"] == 1.0
    assert entry["says"] == "No departure can be told from the shares of instants alone."


@pytest.mark.parametrize(
    ("mean", "words"), [(0.0, "No departure can be told from white"), (0.2, "resemble"), (-0.2, "alternate")]
)
def test_whiteness_counts_runs_beyond_their_bound(build, mean, words):
    campaign = build(runs=400, seconds=600, kept=())
    campaign.info["scenario"]["rates"] = {"camera_hz": 1.0}
    rng = np.random.default_rng(9)
    campaign.metrics["gps_innovation_lag1"] = mean + rng.normal(size=400) / np.sqrt(1800.0)
    campaign.metrics["visible_fraction"] = np.full(400, 0.25)
    campaign.metrics["box_innovation_lag1"] = rng.normal(size=400) / np.sqrt(450.0)
    gps, boxes = consistency_section.content(campaign)["whiteness"]
    assert gps["bound"] == pytest.approx(1.96 / np.sqrt(1800.0))
    assert boxes["bound"] == pytest.approx(1.96 / np.sqrt(450.0))
    assert words in gps["says"]
    assert "No departure can be told from white" in boxes["says"]
    assert gps["outside"] == pytest.approx(0.05 if mean == 0.0 else 1.0, abs=0.03)


def test_runs_with_a_low_coverage_are_counted_beside_the_mean(build):
    campaign = build(runs=40, kept=())
    campaign.metrics["sigma3_coverage"][:] = 0.999
    campaign.metrics["sigma3_coverage"][:5] = [0.9499, 0.5, 0.95, np.nan, 0.2]
    found = consistency_section.content(campaign)
    assert found["sigma3_coverage_low_runs_fraction"] == pytest.approx(3 / 39)
    words = page_text(rendered_page(campaign))
    assert "below 0.95 in 7.7 % of runs" in words
    assert words.index("NEES / 6, relative") < words.index("NEES / 12")
