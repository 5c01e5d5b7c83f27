"""Sensitivity by rank correlation and HSIC."""

import numpy as np

from rpojax.report.figures.scatter_explorer import scatter_explorer
from rpojax.report.page import next_steps, section_findings
from rpojax.report.page.html_report import write_report
from rpojax.report.sections import sensitivity_section


def test_hsic_finds_a_nonmonotonic_influence(build):
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


def test_inputs_are_ranked_by_size_without_independent_runs(build):
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
    explorer = scatter_explorer(campaign, np.arange(len(campaign.run_ids)))
    assert explorer is not None
    assert {one["independence_limit"] for one in explorer["metrics"].values()} == {None}
    assert "dotted lines" not in write_report(campaign).read_text()


def influence(campaign, metric):
    """What a row of the first screen says of the inputs of a metric, and the line of the folded section."""
    ranked = [one for one in sensitivity_section.content(campaign) if one["metric"] == metric]
    content = {"sensitivity": ranked, "drivers": {"drivers": []}}
    return next_steps._influence(content, {"metric": metric}), section_findings._sensitivity(content, {})


def test_an_input_is_named_with_its_significance_and_chance_alone_names_none(build):
    campaign = build(runs=100, seconds=60, kept=())
    rng, mass = np.random.default_rng(2), campaign.drawn["servicer.mass_kg"]
    campaign.metrics["delta_v_m_s"] = mass + 0.2 * rng.normal(size=100)
    found, _ = influence(campaign, "delta_v_m_s")
    assert found.startswith("; it depends most on servicer.mass_kg (rank correlation 0.")
    assert "among " in found
    campaign.metrics["delta_v_m_s"] = np.square(mass - np.median(mass))
    assert influence(campaign, "delta_v_m_s")[0].startswith(
        "; it depends most on servicer.mass_kg (no steady rise or fall, HSIC 0."
    )
    told = []
    for _ in range(20):
        campaign.metrics["delta_v_m_s"] = rng.normal(size=100)
        told.append(influence(campaign, "delta_v_m_s"))
    nothing = sum("none stands out from chance" in row for row, _ in told)
    assert nothing >= 15, "each of two measures names an input by chance once in twenty"
    assert sum(line == "No input stands out" for _, line in told) >= nothing


def test_without_independent_runs_no_input_is_said_to_stand_out(build):
    campaign = build(runs=60, seconds=60, kept=())
    campaign.info["scenario"]["design"] = {"kind": "sobol"}
    campaign.metrics["min_range_m"] = np.random.default_rng(1).normal(size=60)
    row, line = influence(campaign, "min_range_m")
    assert row == ""
    assert line.startswith("Greatest, not tested against chance: ")
