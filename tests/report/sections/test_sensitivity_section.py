"""Sensitivity by rank correlation and HSIC."""

import numpy as np

from rpojax.report.figures.scatter_explorer import scatter_explorer
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
