"""Drawn values compared with declared distributions."""

from typing import Any

import numpy as np
import pytest

from rpojax.report.sections import dispersion_section


def test_drawn_values_are_tested_against_the_declared_distribution(build):
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


def test_declaration_is_shown_at_every_component(campaign: Any) -> None:
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
