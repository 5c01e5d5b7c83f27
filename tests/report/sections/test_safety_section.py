"""Smallest ranges, keep-out entries and their intervals."""

import numpy as np
import pytest
from synthetic_campaign_results import synthetic_team

from rpojax.report import campaign_results
from rpojax.report.page import report_json
from rpojax.report.page.first_screen import verdict_tiles
from rpojax.report.sections import envelope_section, safety_section
from rpojax.simulation.outcomes.outcome_kinds import Outcome


def test_smallest_range_includes_failed_runs(build):
    campaign = build(runs=30, seconds=300, kept=(), failed=(5,))
    campaign.traces["range_m"][5, 3] = 9.5
    campaign.metrics["passive_range_m"] = np.where(np.arange(30) < 2, 8.0, 20.0)
    campaign.metrics["passive_range_m"][5] = np.nan
    found = safety_section.content(campaign)
    assert found["least_range"] == {"value": 9.5, "run_id": 5, "at_most": False}
    assert found["entries"]["run_ids"] == [5]
    # Clopper and Pearson for one of thirty: the ends solve the two binomial tails for 2.5 %.
    low, high = found["entries"]["interval_95"]
    assert 1.0 - (1.0 - low) ** 30 == pytest.approx(0.025)
    assert (1.0 - high) ** 30 + 30 * high * (1.0 - high) ** 29 == pytest.approx(0.025)
    assert (found["passive_below_keep_out"]["count"], found["passive_below_keep_out"]["runs"]) == (3, 30)
    assert found["least_passive_range"] == {"value": 8.0, "run_id": 0}
    assert found["longest_look_away"] is None


def test_range_of_a_keep_out_entry_is_at_most_the_radius(build):
    campaign = build(runs=30, seconds=300, kept=(), failed=(5,))
    found = safety_section.content(campaign)
    assert np.nanmin(campaign.traces["range_m"]) > 10.0
    assert found["least_range"] == {"value": 10.0, "run_id": 5, "at_most": True}
    assert safety_section.rows(found)[0] == ("Smallest range of any run", "at most 10 m", "run 5", False)
    campaign.info["scenario"]["limits"] = {}
    assert safety_section.content(campaign)["least_range"]["at_most"] is False


def test_drifts_into_the_sphere_are_alerts_with_their_intervals(build):
    campaign = build(runs=30, seconds=300, kept=())
    campaign.info["scenario"]["safety"] = {"horizons": ["1_orbit", "24_h"]}
    campaign.metrics["passive_range_1_orbit_m"] = np.full(30, 20.0)
    campaign.metrics["passive_range_24_h_m"] = np.where(np.arange(30) < 3, 4.0, 20.0)
    campaign.metrics["passive_unsafe_fraction"] = np.where(np.arange(30) == 2, 0.25, 0.125)
    campaign.metrics["stuck_on_range_24_h_m"] = np.full(30, np.nan)
    found = safety_section.content(campaign)
    one_orbit, day = found["free_drift"]
    assert (one_orbit["below_keep_out"]["count"], day["below_keep_out"]["count"]) == (0, 3)
    assert day["least_range"] == {"value": 4.0, "run_id": 0}
    assert (found["unsafe_share"]["median"], found["unsafe_share"]["worst"]["run_id"]) == (0.125, 2)
    alerts = {row.quantity: row.is_alert for row in safety_section.rows(found)}
    into = "Runs that could drift into the keep-out sphere of 10 m within"
    assert not alerts[f"{into} 1 orbit after a loss of thrust"]
    assert alerts[f"{into} 24 h after a loss of thrust"]
    assert not any("did not end" in quantity for quantity in alerts)


def test_runs_without_a_drift_are_not_counted_as_safe_and_it_is_said(build):
    campaign = build(runs=30, seconds=300, kept=())
    campaign.info["scenario"]["safety"] = {"horizons": ["24_h"]}
    campaign.metrics["passive_range_24_h_m"] = np.where(np.arange(30) < 4, np.nan, 20.0)
    content = {**report_json.report_content(campaign, []), "requirements": []}
    [drift] = content["safety"]["free_drift"]
    assert (drift["below_keep_out"]["runs"], drift["below_keep_out"]["without_drift"]) == (26, 4)
    words = "; 4 runs without a drift not counted"
    [row] = [row for row in safety_section.rows(content["safety"]) if "could drift" in row.quantity]
    assert row.value == "0 of 26"
    assert row.remark.endswith(words)
    tile = next(tile for tile in verdict_tiles(content) if tile.title == "Passive safety")
    assert tile.value == "holds: 26 of 26"
    assert tile.css_class == "open"
    assert tile.note.endswith(words)
    # Where all have one nothing is said.
    campaign.metrics["passive_range_24_h_m"][:] = 20.0
    found = safety_section.content(campaign)
    assert not any("not counted" in row.remark for row in safety_section.rows(found))


def test_a_run_is_judged_by_its_own_sphere(build):
    campaign = build(runs=30, seconds=300, kept=())
    campaign.info["scenario"]["safety"] = {"horizons": ["24_h"]}
    campaign.metrics["passive_range_24_h_m"] = np.full(30, 20.0)
    campaign.drawn["limits.keep_out_m"] = np.where(np.arange(30) < 4, 25.0, 5.0)
    assert safety_section.content(campaign)["free_drift"][0]["below_keep_out"]["count"] == 4


def test_each_servicer_of_a_team_keeps_out_of_its_own_sphere(tmp_path):
    campaign = synthetic_team(tmp_path, runs=12, seconds=120, kept=())
    campaign.info["scenario"]["safety"] = {"horizons": ["24_h"]}
    campaign.info["scenario"]["servicers"][1]["limits"] = {"keep_out_m": 17.0}
    near, far = np.full(12, 12.0), np.full(12, 30.0)
    far[[3, 4]] = 16.0
    for name, values in {"": np.minimum(near, far), "/near": near, "/far": far}.items():
        campaign.metrics[f"passive_range_24_h_m{name}"] = values
    found = safety_section.content(campaign)
    assert found["keep_out_m"] == [10.0, 17.0]
    assert found["free_drift"][0]["below_keep_out"]["count"] == 2
    assert any("of 10 to 17 m, each its own" in row.quantity for row in safety_section.rows(found))
    assert campaign_results.nominal_keep_out_radii(campaign) == [10.0, 17.0]
    assert "largest keep-out sphere" in str(envelope_section.envelope_charts(campaign)["range_m"][1])
    # Drawn ones, of one servicer each, come before those of the scenario.
    campaign.drawn |= {"limits.keep_out_m/near": np.full(12, 10.0), "limits.keep_out_m/far": np.full(12, 15.0)}
    assert safety_section.content(campaign)["free_drift"][0]["below_keep_out"]["count"] == 0
    campaign.outcomes[5] = Outcome.KEEP_OUT
    campaign.servicer_groups["status"]["failure"][5, 1] = Outcome.KEEP_OUT.code
    assert safety_section.content(campaign)["least_range"] == {"value": 15.0, "run_id": 5, "at_most": True}
