"""A team in report.json and on the page: each servicer by name, and apart from the metrics of the team."""

import json
from pathlib import Path

import numpy as np
import pytest
from report_page_parser import page_text, rendered_page
from synthetic_campaign_results import SyntheticCampaign, synthetic_campaign, synthetic_team

from rpojax.report.page.report_json import report_content
from rpojax.report.sections import failure_section, team_section
from rpojax.report.sections.dispersion_section import drawn_distributions
from rpojax.report.sections.team_section import of_servicer, relative_orbits
from rpojax.simulation.outcomes.outcome_kinds import Outcome

RUNS = 12


@pytest.fixture
def pair(tmp_path: Path) -> SyntheticCampaign:
    """Two servicers of twelve runs, of which the second has lost the target in one."""
    campaign = synthetic_team(tmp_path, runs=RUNS, seconds=120, kept=(0, 3))
    campaign.servicer_groups["status"]["failure"][4, 1] = Outcome.LOST.code
    return campaign


def tables(campaign: SyntheticCampaign) -> dict[str, list[list[str]]]:
    found = team_section.tables(report_content(campaign, drawn_distributions(campaign)))
    assert found is not None
    return found


def test_boxes_of_anybody_are_counted_in_the_kept_histories(pair: SyntheticCampaign) -> None:
    for history in pair.histories.values():
        ticks = len(history["time_s"])
        history["box_outlier"] = np.zeros((ticks, 2), bool)
        history["box_accepted"] = np.zeros((ticks, 2), bool)
        history["box_accepted"][: ticks // 4, 0] = True
        history["box_accepted"][ticks // 8 : ticks // 2, 1] = True
    found = team_section.content(pair)
    assert found is not None
    ticks = 121
    assert found["boxes"]["runs"] == 2
    assert found["boxes"]["of_each"] == pytest.approx([30 / ticks, 45 / ticks])
    assert found["boxes"]["of_anybody"] == pytest.approx(60 / ticks)
    assert found["boxes"]["of_everybody"] == pytest.approx(15 / ticks)


def test_outcomes_are_those_of_each_servicer(pair: SyntheticCampaign) -> None:
    assert [row[:3] for row in tables(pair)["outcomes"]] == [
        ["near", "12", "\N{EN DASH}"],
        ["far", "11", "1 lost the target"],
        ["team", "12", "\N{EN DASH}"],
    ]


FAULT = {"name": "camera", "kind": "none", "start_s": 0.0, "duration_s": 1e9}


def test_a_fault_is_told_of_the_servicer_that_has_it(pair: SyntheticCampaign) -> None:
    pair.info["scenario"] |= {"effects": {"faults": True}, "faults": [FAULT]}
    pair.info["scenario"]["servicers"][1]["faults"] = {
        "camera": {"kind": "camera_blackout", "start_s": 50.0, "duration_s": 20.0}
    }
    faults = [servicer["faults"] for servicer in (team_section.content(pair) or {})["servicers"]]
    assert [fault["kind"] for (fault,) in faults] == ["none", "camera_blackout"]
    assert failure_section.fault_rows(pair) == []
    assert [row[3] for row in tables(pair)["outcomes"]][1] == "camera blackout from 50 s, for 20 s"


def test_links_and_consistency_are_told(pair: SyntheticCampaign) -> None:
    found = tables(pair)
    links = {row[0]: row[1] for row in found["links"]}
    assert links["Sharing"] == "boxes"
    assert links["Loss outside of bursts"] == "30 %"
    assert links["Bursts"] == "one every 300 s on average, 20 s long, 95 % lost in it"
    assert links["Outages"] == "100 to 200 s"
    assert links["Who hears whom"] == "near hears far, far hears near"
    assert links["Share of used messages"].startswith("0.850")
    nees = found["consistency"][0]
    mean = pair.metrics["nees_relative_mean"].mean() / 6.0
    assert [float(cell) for cell in nees[1:]] == pytest.approx([mean, 1.01 * mean, mean], rel=5e-3)
    assert found["separations"][0] == ["Least distance between servicers [m]", "20", "20.1", "25"]


def test_metrics_of_each_servicer_have_a_table_of_their_own(pair: SyntheticCampaign) -> None:
    page = page_text(rendered_page(pair, run_id=3))
    table = page[page.index("metrics: statistics, intervals, meaning") : page.index("What each metric means")]
    assert "Formation error" in table
    assert "near" not in table
    assert "Run 3, servicer near is the median one" in page
    assert "2 servicers: near, far." in page
    written = json.loads((pair.directory / "report.json").read_text())
    assert {"formation_error_rms_m", "formation_error_rms_m/near", "formation_error_rms_m/far"} <= set(
        written["metrics"]
    )
    assert [each["name"] for each in written["team"]["servicers"]] == ["near", "far"]


def test_the_figure_shows_the_whole_path_of_everybody(pair: SyntheticCampaign) -> None:
    history = pair.history(0)
    history["rho_H"][60:, 1] = np.nan
    figure = relative_orbits(history, pair.servicer_names, [10.0, 16.0], "pair")
    for axes, across in zip(figure.axes, (1, 2), strict=True):
        paths = {str(line.get_label()): np.asarray(line.get_xydata()) for line in axes.get_lines()}
        np.testing.assert_array_equal(paths["near"], history["rho_H"][:, 0][:, [across, 0]])
        np.testing.assert_array_equal(paths["far"], history["rho_H"][:60, 1][:, [across, 0]])
        low, high = axes.get_xlim()
        assert low < np.nanmin(history["rho_H"][..., across]) and np.nanmax(history["rho_H"][..., across]) < high
    assert (pair.directory / "figures" / team_section.FIGURE_NAME) == team_section.write_figure(pair, 0)


def test_a_servicer_reads_as_a_campaign_of_its_own(pair: SyntheticCampaign) -> None:
    pair.drawn = {"target.mass_kg": np.ones(RUNS), "gps.noise_m/near": np.zeros(RUNS), "gps.noise_m/far": np.ones(RUNS)}
    far = of_servicer(pair, 1)
    assert far.outcomes.tolist() == ["lost" if run == 4 else "completed" for run in range(RUNS)]
    assert far.failure_reason[4] == "lost the target"
    assert {key: values[0] for key, values in far.drawn.items()} == {"target.mass_kg": 1.0, "gps.noise_m": 1.0}
    np.testing.assert_array_equal(far.metrics["delta_v_m_s"], pair.metrics["delta_v_m_s/far"])


def test_without_histories_the_page_says_so(tmp_path: Path) -> None:
    page = page_text(rendered_page(synthetic_team(tmp_path, runs=RUNS, seconds=60, kept=())))
    assert "the relative orbits are not shown" in page
    assert "accepted box, " not in page


def test_one_servicer_alone_has_no_team(tmp_path: Path) -> None:
    campaign = synthetic_campaign(tmp_path, runs=RUNS, seconds=60, kept=(0,))
    assert team_section.content(campaign) is None
    assert team_section.write_figure(campaign, 0) is None
    assert "servicers: " not in page_text(rendered_page(campaign))
