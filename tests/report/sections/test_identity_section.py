"""Identity of a campaign: lines of its scenario."""

from typing import Any

from rpojax.report.sections import identity_section


def test_long_lines_of_the_scenario_are_truncated(campaign: Any) -> None:
    campaign.info["scenario"]["design"] = {"kind": "table", "file": "", "values": {"gps.noise_m": [0.125] * 5000}}
    [column] = [
        line
        for line in identity_section.scenario_lines(campaign)
        if line.startswith("design.values.gps.noise_m = [0.125,")
    ]
    assert column.endswith(" ...")
    assert len(column) < 4100
