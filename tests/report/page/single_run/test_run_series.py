"""Thinned channels, burns, timeline and paths of one run, on histories made by hand."""

import numpy as np
import pytest

from rpojax.report.page.detail_values import worst_runs
from rpojax.report.page.run_page import find_burns
from rpojax.report.page.run_series import MAX_SAMPLES, path_scene, run_series, thinned_peaks
from rpojax.report.page.run_timeline import timeline


def test_thinning_keeps_every_peak():
    values = np.zeros(6001)
    values[[17, 3001, 6000]] = 9.0
    assert np.sum(thinned_peaks(values, False) == 9.0) == 3
    assert np.sum(thinned_peaks(-values, True) == -9.0) == 3
    assert len(thinned_peaks(values, False)) <= MAX_SAMPLES
    assert np.isnan(thinned_peaks(np.full(5, np.nan), False)).all()


def test_series_have_the_times_of_their_spans(campaign):
    series = run_series(campaign.history(0))
    assert {"range_m", "formation_error_m", "nav_relative_error_m", "nav_relative_sigma3_m"} <= series.keys()
    assert {len(values) for values in series.values()} == {len(series["time_s"])}


def test_burns_are_found_with_their_velocity_change():
    time = np.arange(100.0)
    spent = np.interp(time, [0, 10, 14, 60, 61], [0.0, 0.0, 0.04, 0.04, 0.05])
    history = {
        "time_s": time,
        "delta_v_m_s": spent,
        "rho_H": np.tile([0.0, -40.0, 0.0], (100, 1)),
        "rho_desired_H": np.array([0.0, -30.0, 0.0]),
    }
    burns = find_burns(history)
    assert [(burn.begin_s, burn.end_s) for burn in burns] == [(10.0, 14.0), (60.0, 61.0)]
    assert [burn.delta_v_m_s for burn in burns] == pytest.approx([0.04, 0.01])
    assert {(burn.range_m, burn.formation_error_m) for burn in burns} == {(40.0, 10.0)}
    assert find_burns({"time_s": time}) == []


def test_timeline_ends_where_the_run_was_frozen(build):
    campaign = build(runs=4, seconds=600, failed=(1,), kept=(0, 1))
    whole, frozen = (
        {row.title: row for row in timeline(campaign, run, campaign.history(run), 600.0)} for run in (0, 1)
    )
    assert {"Pointing", "Light", "Box accepted"} <= whole.keys()
    ends = [max(part.begin + part.width for part in rows["Pointing"].intervals) for rows in (whole, frozen)]
    assert ends == pytest.approx([1.0, 0.5], abs=0.01)


def test_worst_run_of_each_requirement_the_most_violated_first(build):
    campaign = build(runs=30, kept=(0, 1, 2, 3))
    campaign.metrics["delta_v_m_s"][2], campaign.metrics["min_range_m"][[1, 20]] = 9.0, [12.0, 11.0]
    content = {
        "requirements": [
            {"metric": "delta_v_m_s", "bound": "at most", "limit": 1.0, "worst": 9.0, "violations": 1},
            {"metric": "min_range_m", "bound": "at least", "limit": 15.0, "worst": 11.0, "violations": 2},
        ],
        "worst_runs": [],
    }
    near, thirsty = worst_runs(campaign, content, 0)
    assert (near.metric, near.run_id) == ("min_range_m", 1)
    assert near.remark == "run 20 is worse; its history was not kept"
    assert (thirsty.run_id, thirsty.remark) == (2, "")


def test_the_worst_run_of_a_requirement_is_on_the_side_that_violates_it(build):
    campaign = build(runs=30, kept=(0, 1, 2, 3))
    campaign.metrics["min_range_m"][[1, 2]] = [12.0, 90.0]
    entry = {"metric": "min_range_m", "bound": "at most", "limit": 80.0, "worst": 90.0, "violations": 1}
    (far,) = worst_runs(campaign, {"requirements": [entry], "worst_runs": []}, 0)
    assert (far.run_id, far.worst_id, far.remark) == (2, 2, "")


def test_scene_has_mesh_sphere_and_every_path_with_its_kind(campaign):
    hull = [[x, y, z] for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)]
    campaign.info["scenario"] |= {"target": {"hull_m": hull}}
    scene = path_scene(campaign, 1, [2])
    assert scene is not None
    assert {path["run"]: path["kind"] for path in scene["paths"]} == {0: "other", 1: "median", 2: "worst"}
    assert scene["keep_out_m"] == 10.0
    assert len(scene["target"]["triangles"]) == 3 * 12, "a cube has twelve triangles"
    rho = campaign.history(1)["rho_H"]
    points = np.array(scene["paths"][0]["points"]).reshape(-1, 3)
    np.testing.assert_allclose(points[[0, -1]], rho[[0, -1]], rtol=1e-3)
    campaign.histories = {}
    assert path_scene(campaign, None, []) is None
