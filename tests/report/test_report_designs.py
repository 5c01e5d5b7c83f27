"""The report on campaigns whose runs are a design, and on numbers that are drawn together or derived."""

from typing import Any

import numpy as np

from rpojax.report.page import section_records
from rpojax.report.page.campaign_summary import summarise
from rpojax.report.sections import caveats_section, dispersion_section

NO_DRAWS = "The runs follow a table of given values and are not independent of one another."


def test_what_is_declared_of_a_number_is_said_at_each_of_its_components(campaign: Any) -> None:
    covariance = np.diag([0.01, 0.01, 0.01, 0.16]).tolist()
    keys = ["camera.misalignment_deg", "servicer.mass_kg"]
    campaign.info["scenario"]["dispersions"] = [
        {"keys": keys, "kind": "correlated_normal", "covariance": covariance},
        {"key": "gps.noise_m", "kind": "derived", "offset": 1.0, "terms": []},
    ]
    campaign.info["scenario"]["design"] = {"kind": "table", "file": "", "values": {"thruster.on": [1.0] * 40}}
    declared = {entry.key: entry.declared for entry in dispersion_section.drawn_distributions(campaign)}
    text = f"correlated_normal covariance {covariance}"
    assert declared["camera.misalignment_deg[2]"] == declared["servicer.mass_kg"] == text
    assert declared["gps.noise_m"] == "derived offset 1.0, terms []"
    assert declared["thruster.on"] == "table"


def test_a_design_is_not_taken_for_independent_draws_and_its_table_is_cut_short(campaign: Any) -> None:
    assert not any("design" in sentence for sentence in caveats_section.caveat_sentences(campaign, summarise(campaign)))
    campaign.info["scenario"]["design"] = {"kind": "table", "file": "", "values": {"gps.noise_m": [0.125] * 5000}}
    assert any(
        sentence.startswith(NO_DRAWS) for sentence in caveats_section.caveat_sentences(campaign, summarise(campaign))
    )
    [column] = [
        line
        for line in section_records.scenario_lines(campaign)
        if line.startswith("design.values.gps.noise_m = [0.125,")
    ]
    assert column.endswith(" ...")
    assert len(column) < 4100
