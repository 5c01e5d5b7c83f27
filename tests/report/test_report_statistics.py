"""Intervals, consistency, convergence, sensitivity and dispersions of made-up campaigns."""

import json

import numpy as np
import pytest

from rpojax.report.metric_statistics import mean_confidence_interval, summary_statistics
from rpojax.report.page.html_report import write_report
from rpojax.report.sections import (
    consistency_section,
    convergence_section,
    dispersion_section,
    failure_section,
    sensitivity_section,
)


def test_intervals_of_quantiles_are_ranks_and_hold_what_they_say():
    values = np.arange(1.0, 1001.0)
    entry = summary_statistics("delta_v_m_s", values, True)
    # Row of a table: for q = 0.99 and 1000 runs the ranks are 983 and 997.
    assert entry["p99_interval_95"] == [983.0, 997.0]
    assert summary_statistics("delta_v_m_s", values[:100], True)["p99_interval_95"][1] is None
    # For 1000 runs the interval of the deviation is 0.958012 to 1.045865 of it.
    assert np.array(entry["std_interval_95"]) / entry["std"] == pytest.approx([0.958012, 1.045865], abs=1e-6)
    assert entry["mean_interval_method"] == "normal"


def test_the_mean_is_resampled_where_runs_are_few_and_skewed():
    made = mean_confidence_interval(np.arange(1.0, 21.0))
    assert made is not None
    # scipy's BCa with 9999 resamples gives 7.95 to 12.95.
    assert made[0] == pytest.approx([7.95, 12.95], abs=0.15)
    assert made[1] == "bootstrap (BCa)"
    assert mean_confidence_interval(np.arange(9.0)) is None
    assert mean_confidence_interval(np.full(20, 3.0)) == ([3.0, 3.0], "all runs agree")
    rng = np.random.default_rng(4)
    hits = sum(
        made[0][0] <= 1.0 <= made[0][1]
        for _ in range(100)
        if (made := mean_confidence_interval(rng.exponential(1.0, 600))) is not None
    )
    assert 88 <= hits <= 100


def test_a_consistent_filter_shows_no_departure_and_a_sure_one_does(build):
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


def test_chi_square_intervals_take_one_instant_a_run_for_nees_and_every_update_for_nis(build):
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


def test_averages_at_instants_and_their_sentence(build):
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


def test_instants_outside_are_no_verdict_where_the_spread_between_runs_gives_none(build):
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
def test_whiteness_counts_the_runs_beyond_the_bound_of_their_updates(build, mean, words):
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


def test_convergence_ends_where_the_table_stands_and_hides_what_design_forbids(build):
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


def test_an_influence_that_ranks_miss_is_named_by_the_other_method(build):
    campaign = build(runs=300, seconds=60, kept=())
    errors = campaign.drawn["camera.misalignment_deg"][:, 1]
    campaign.metrics["formation_error_rms_m"] = np.square(errors / 0.1) + 0.01 * campaign.drawn["gps.noise_m"]
    campaign.metrics["delta_v_m_s"] = campaign.drawn["servicer.mass_kg"] ** 3
    found = {entry["metric"]: entry for entry in sensitivity_section.content(campaign)}
    formation = found["formation_error_rms_m"]
    assert formation["disagree"]
    assert formation["by_hsic"] == ["camera.misalignment_deg[1]"]
    assert "Only HSIC puts camera.misalignment_deg[1]" in formation["sentence"]
    assert found["delta_v_m_s"]["sentence"] == "Both methods name the same leading inputs: servicer.mass_kg."
    chart = sensitivity_section.chart(formation)
    left, right = chart["data"]
    assert left["y"] == right["y"]
    assert right["y"][-1] == "camera.misalignment_deg[1]"
    assert right["marker"]["opacity"][-1] > right["marker"]["opacity"][0]


def test_runs_of_a_design_are_ranked_by_size_without_a_word_on_chance(build):
    campaign = build(runs=60, seconds=60, kept=())
    campaign.info["scenario"]["design"] = {"kind": "sobol"}
    campaign.metrics["delta_v_m_s"] = campaign.drawn["servicer.mass_kg"] ** 3
    campaign.metrics["min_range_m"] = np.random.default_rng(1).normal(size=60)
    found = {entry["metric"]: entry for entry in sensitivity_section.content(campaign)}
    for entry in found.values():
        sizes = [abs(one["spearman"]) for one in entry["inputs"]]
        assert entry["by_spearman"] == [one["name"] for one in entry["inputs"][:3]]
        assert sizes == sorted(sizes, reverse=True)
        assert entry["disagree"] is None
        assert entry["sentence"].startswith(f"Greatest by rank correlation: {entry['by_spearman'][0]}, ")
    assert found["delta_v_m_s"]["by_hsic"][0] == "servicer.mass_kg"
    explorer = dispersion_section.scatter_explorer(campaign)
    assert explorer is not None
    assert {one["chance"] for one in explorer["metrics"].values()} == {None}
    assert "dotted lines" not in write_report(campaign).read_text()


def test_codes_of_faults_are_not_ranked(build):
    campaign = build(runs=60, seconds=60, kept=(), failed=tuple(range(20)))
    campaign.drawn |= {"fault.kind": np.repeat([3.0, 1.0, 2.0], 20), "fault.wheel": np.arange(60.0) % 3.0}
    codes = {"fault.kind", "fault.wheel"}
    assert all(
        codes.isdisjoint(one["name"] for one in entry["inputs"]) for entry in sensitivity_section.content(campaign)
    )
    assert all(codes.isdisjoint(one["input"] for one in entry["inputs"]) for entry in failure_section.content(campaign))
    explorer = dispersion_section.scatter_explorer(campaign)
    assert explorer is not None
    assert all(codes.isdisjoint(one["rank"]) for one in explorer["metrics"].values())
    assert codes <= set(explorer["inputs"])


def test_draws_are_held_against_what_the_scenario_declares(build):
    campaign = build(runs=500, seconds=60, kept=())
    campaign.info["scenario"]["dispersions"][0]["sigma"] = 0.6
    found = {one.key: one for one in dispersion_section.drawn_distributions(campaign)}
    mass, noise, constant = found["servicer.mass_kg"], found["gps.noise_m"], found["thruster.on"]
    assert mass.contradicts_declaration
    assert (mass.law_mean, mass.law_std) == (24.0, 0.6)
    assert not noise.contradicts_declaration
    assert noise.p is not None
    assert (constant.p, constant.law_mean, constant.expected_heights) == (None, None, [])
    assert len(noise.expected_heights) == len(noise.bin_heights)
    # As many runs are expected in the bins as there are.
    assert sum(noise.expected_heights) == pytest.approx(sum(noise.bin_heights), rel=0.01)
    assert max(*noise.expected_heights, *noise.bin_heights) == 1.0
