"""Error budgets in report.json and on the page: which runs count, windows, and errors of pointing."""

import json

import numpy as np
import pytest
from report_page_parser import page_text, rendered_page
from scipy.spatial.transform import Rotation
from synthetic_campaign_results import SyntheticCampaign, synthetic_team

import rpojax
from rpojax.flight.guidance.pointing_modes import Mode
from rpojax.report import drawn_scenarios
from rpojax.report.sections import error_budget_section
from rpojax.report.sections.error_budget_section import budget_tables, histories_wanted, pointing_error, windows_text


def lines(content, error: str, servicer: str = "") -> dict[str, dict]:
    """Lines of an error by index."""
    (found,) = (each for each in content["errors"] if (each["name"], each["servicer"]) == (error, servicer))
    return {line["of"]: line for line in found["indices"]}


def test_sizes_are_those_of_the_settled_part_of_the_histories(build):
    campaign = build(runs=40, seconds=600, kept=tuple(range(10)))
    # An error that grows by 1 mm a second along one axis, beside a constant of the run along another one.
    for run, history in campaign.histories.items():
        time = history["time_s"]
        history["relative_error_H"] = np.stack([1e-3 * time, np.full(len(time), 0.1 * run), 0.0 * time], axis=1)
        history["rho_H"] = np.tile(history["rho_desired_H"] + np.array([0.3, 0.0, 0.4]), (len(time), 1))
    content = error_budget_section.content(campaign)
    assert content is not None
    # 401 seconds from 200 s on: two periods of 200 s, eight windows of 25 s in each, drift over four of them.
    assert [content[key] for key in ("from_s", "to_s", "window_s", "drift_s", "period_s")] == [200, 600, 25, 100, 200]
    assert (content["runs"], content["of_runs"], content["stopped_early"]) == (10, 40, 0)
    found = lines(content, "relative_navigation")
    assert [line["index"] for line in found.values()] == ["AKE", "MKE", "RKE", "KDE", "KRE"]
    # The worst run is number 9; 95 % of the time up to 599 s is up to 579 s.
    assert found["absolute"]["temporal"] == pytest.approx(np.hypot(0.9, 0.579))
    assert found["absolute"]["ensemble"] == pytest.approx(np.hypot(0.9, 0.599))
    # The constant is no part of what changes: 12 mm to each side, 0.1 and 0.2 m apart.
    assert found["relative"]["ensemble"] == pytest.approx(0.012, rel=1e-4)
    assert found["drift"]["mixed"] == pytest.approx(0.1)
    assert found["reproducibility"]["mixed"] == pytest.approx(0.2)
    assert [line["mixed"] for line in lines(content, "formation").values()] == pytest.approx([0.5, 0.5, 0, 0, 0])
    assert found["absolute"]["ensemble_bound"] is None
    assert histories_wanted(content) == 59


def test_runs_whose_history_depends_on_results_are_no_sample(build):
    campaign = build(runs=40, seconds=600, kept=(0, 1, 2, 3, 20, 30), failed=(1, 30))
    campaign.histories[20]["relative_error_H"] = np.full((601, 3), 1e3)
    campaign.info["histories"] = {"rule": "4+failures+worst:1:nees_mean", "channels": None, "every": 1}
    content = error_budget_section.content(campaign)
    assert content is not None
    assert (content["runs"], content["stopped_early"]) == (3, 1)
    assert lines(content, "relative_navigation")["absolute"]["ensemble"] < 1e2
    assert "Left out: 1 that stopped early." in windows_text(content)
    campaign.info["histories"]["rule"] = "failures"
    assert error_budget_section.content(campaign) is None


def test_a_bound_needs_independent_runs(build):
    campaign = build(runs=60, seconds=300, kept=tuple(range(60)))
    content = error_budget_section.content(campaign)
    bound = lines(content, "servicer_navigation")["absolute"]["ensemble_bound"]
    # From 100 s on two periods of eight windows of 12 s.
    largest = [np.linalg.norm(h["servicer_error_H"][100:292], axis=1).max() for h in campaign.histories.values()]
    assert bound == pytest.approx(max(largest), rel=1e-6)
    assert histories_wanted(content) is None
    campaign.info["scenario"]["design"] = {"kind": "sobol"}
    assert lines(error_budget_section.content(campaign), "servicer_navigation")["absolute"]["ensemble_bound"] is None


def test_histories_with_few_channels_or_ticks_have_fewer_errors_or_none(build):
    campaign = build(kept=(0, 1))
    for history in campaign.histories.values():
        del history["rho_H"], history["servicer_error_H"]
    names = [each["name"] for each in error_budget_section.content(campaign)["errors"]]
    assert names == ["relative_navigation", "target_navigation"]
    campaign.histories = {
        run: {name: values[:1] if len(values) == 601 else values for name, values in history.items()}
        for run, history in campaign.histories.items()
    }
    assert error_budget_section.content(campaign) is None


def test_each_servicer_of_a_team_has_its_errors(tmp_path):
    content = error_budget_section.content(synthetic_team(tmp_path, kept=(0, 1)))
    tables = budget_tables(content)
    assert {"Formation error, near [m]", "Formation error, far [m]"} <= {table.title for table in tables}
    assert lines(content, "formation", "near") != lines(content, "formation", "far")


def pointing_campaign(campaign: SyntheticCampaign, scenario: str) -> SyntheticCampaign:
    campaign.info["scenario"] = rpojax.load(scenario).model_dump(mode="json")
    campaign.drawn = {"camera.misalignment_deg": np.tile([0.3, -0.2, 5.0], (40, 1))}
    return campaign


def test_pointing_is_two_angles_about_the_axes_of_the_true_camera(campaign):
    pointing_campaign(campaign, "inspection")
    (tables,) = drawn_scenarios.drawn_tables(campaign, 0)
    R_KB = drawn_scenarios.camera_axes(tables)
    turn_KN = Rotation.from_rotvec([0.4, 1.0, -0.2]).as_matrix()
    # A target 0.02 rad to the right and 0.01 rad down in the picture, seen over 100 s.
    line_K = np.array([0.02, 0.01, 1.0])
    off = np.rad2deg(np.arctan(np.hypot(0.02, 0.01)))
    q_BN = np.roll(Rotation.from_matrix(R_KB.T @ turn_KN).as_quat(), 1)
    mode = np.full(100, Mode.LOOK)
    mode[50] = Mode.TURN
    history = {
        "time_s": np.arange(100.0),
        "q_BN": np.tile(q_BN, (100, 1)),
        "r_ST_N": np.tile(-30.0 * turn_KN.T @ line_K, (100, 1)),
        "mode": mode,
    }
    error = pointing_error(history, tables)
    assert error is not None
    # After a turn it counts again once the settling time has passed.
    settle = round(tables["pointing"]["settle_time_s"])
    assert np.isnan(error[50 : 51 + settle]).all()
    counted = np.isfinite(error).all(axis=1)
    assert np.flatnonzero(~counted).tolist() == list(range(50, 51 + settle))
    assert error[counted] == pytest.approx(np.tile(off * np.array([2.0, 1.0]) / np.sqrt(5.0), (counted.sum(), 1)))
    assert pointing_error(history, None) is None


def test_pointing_through_the_wide_lens_is_about_its_own_axis(campaign):
    pointing_campaign(campaign, "final_approach")
    campaign.drawn["wide_lens.misalignment_deg"] = np.tile([0.0, 0.5, 0.0], (40, 1))
    (tables,) = drawn_scenarios.drawn_tables(campaign, 0)
    own, wide = (drawn_scenarios.camera_axes(tables, through_wide_lens=each) for each in (False, True))
    history = {
        "time_s": np.arange(4.0),
        "q_BN": np.tile([1.0, 0.0, 0.0, 0.0], (4, 1)),
        "r_ST_N": np.tile(-30.0 * own[2], (4, 1)),
        "mode": np.full(4, Mode.LOOK),
        "wide_lens": np.array([False, False, True, True]),
    }
    error = pointing_error(history, tables)
    assert error is not None
    assert error[:2] == pytest.approx(np.zeros((2, 2)), abs=1e-9)
    assert np.linalg.norm(error[2:], axis=1) == pytest.approx([0.5, 0.5], rel=1e-3)
    assert np.rad2deg(np.arccos(own[2] @ wide[2])) == pytest.approx(0.5, rel=1e-3)


def test_page_and_report_json_have_the_budgets(campaign):
    page = rendered_page(campaign)
    words = page_text(page)
    content = json.loads((campaign.directory / "report.json").read_text())["error_budgets"]
    assert content == error_budget_section.content(campaign)
    assert "Formation error [m] APE, absolute" in words
    assert "means over windows of 25 s" in words
    assert "3 of 40 runs count" in words
    assert "takes 59 runs with a history, which --histories 59 keeps" in words
    campaign.histories = {}
    assert "Error budgets" not in page_text(rendered_page(campaign))


def test_pointing_of_a_simulated_run_is_the_angle_that_it_recorded(tmp_path):
    """From attitude, position, mounting and drawn misalignment, to the single precision of the channels."""
    overrides = ("duration_s=240", "requirements=[]")
    simulated = rpojax.run_campaign(rpojax.load("inspection", overrides), runs=2, seed=4, out=tmp_path / "runs")
    assert np.ptp(simulated.drawn["camera.misalignment_deg"], axis=0).min() > 0.0
    for run in simulated.history_ids:
        history = simulated.history(run)
        angle = np.linalg.norm(pointing_error(history, drawn_scenarios.drawn_tables(simulated, run)[0]), axis=1)
        settled = np.isfinite(angle)
        assert 0.5 < settled.mean() < 1.0
        assert angle[settled] == pytest.approx(history["pointing_error_deg"][settled], abs=2e-5)
        # The same instants as those of the metric.
        p95 = simulated.metrics["pointing_error_p95_deg"][run]
        assert np.percentile(angle[settled], 95.0) == pytest.approx(p95, abs=2e-5)
    content = error_budget_section.content(simulated)
    assert content is not None
    assert content["runs"] == 2
    assert lines(content, "pointing")["absolute"]["runs"] == 2
