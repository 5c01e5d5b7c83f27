"""What is played back is what was stored: values, attitudes, light, and the camera's view of the target."""

import base64
import json

import numpy as np
import pytest
from played_run import MISALIGNMENT_DEG, SCALE, add_landmarks, hill_axes, played_campaign
from report_page_parser import page_text, rendered_page
from scipy.spatial.transform import Rotation

from rpojax.report.page import playback_geometry, run_playback
from rpojax.report.page.packed_arrays import pack_bytes, pack_floats, pack_rounded, unpack
from rpojax.report.page.run_playback import playback
from rpojax.report.page.shown_mesh import box_triangles, shown_mesh, simplified


def volume(corners: np.ndarray, triangles: np.ndarray) -> float:
    """Volume inside of a closed surface, positive for corners that are counter-clockwise from outside."""
    a, b, c = (corners[triangles[:, k]] for k in range(3))
    return float(np.sum(a * np.cross(b, c)) / 6.0)


def test_rounded_values_are_off_by_half_a_step_at_most() -> None:
    values = np.random.default_rng(1).normal([0.0, 40.0, -3.0], [1.0, 900.0, 0.0], (500, 3))
    values[7] = np.nan
    packed = pack_rounded(values)
    found = unpack(packed)
    assert np.isnan(found[7]).all()
    error = np.nanmax(np.abs(found - values), axis=0)
    span = np.ptp(np.delete(values, 7, axis=0), axis=0)
    assert (error <= 0.5 * span / 65534.0 * (1.0 + 1e-9) + 1e-12).all()
    assert error[1] > 0.3 * span[1] / 65534.0, "16 bits are used, and no more"
    assert len(base64.b64decode(packed["data"])) == 2 * values.size


def test_floats_and_bytes_are_exact() -> None:
    values = np.random.default_rng(2).normal(size=(9, 2)).astype(np.float32)
    np.testing.assert_array_equal(unpack(pack_floats(values)), values)
    np.testing.assert_array_equal(unpack(pack_bytes(np.arange(256))), np.arange(256))
    with pytest.raises(ValueError, match="found 0 to 256"):
        pack_bytes(np.arange(257))


def test_values_at_a_time_are_those_of_the_record(tmp_path) -> None:
    campaign = played_campaign(tmp_path)
    history, found = campaign.histories[0], playback(campaign, 0)
    assert found is not None
    arrays = found["servicers"][0]["arrays"]
    np.testing.assert_array_equal(unpack(found["time_s"]), history["time_s"])
    np.testing.assert_array_equal(unpack(arrays["rho_H"]), history["rho_H"].astype(np.float32))
    np.testing.assert_array_equal(unpack(arrays["delta_v_m_s"]), history["delta_v_m_s"].astype(np.float32))
    np.testing.assert_array_equal(unpack(arrays["mode"]), history["mode"])
    bits = unpack(arrays["flags"])
    for place, name in enumerate(found["flags"][:3]):
        np.testing.assert_array_equal((bits >> place & 1).astype(bool), history[name])
    box = unpack(arrays["box_px"])
    assert np.isfinite(box).all(axis=1).tolist() == history["box_present"].tolist()
    present = history["box_present"]
    np.testing.assert_allclose(box[present], history["box_px"][present], atol=0.01)
    offset = history["rho_estimate_H"] - history["rho_H"]
    step = np.ptp(offset, axis=0).max() / 65534.0
    np.testing.assert_allclose(unpack(arrays["estimate_offset_H"]), offset, atol=0.51 * step)


def test_the_target_projected_with_what_is_played_fills_the_true_outline(tmp_path) -> None:
    campaign = played_campaign(tmp_path)
    history, found = campaign.histories[0], playback(campaign, 0)
    assert found is not None
    servicer, camera = found["servicers"][0], found["servicers"][0]["camera"]
    hull = SCALE * np.array(campaign.info["scenario"]["target"]["hull_m"])
    turns = [unpack(array) for array in (found["scene"]["q_HT"], servicer["arrays"]["q_HB"])]
    outline = unpack(servicer["arrays"]["outline_px"])
    R_KB, center = np.reshape(camera["R_KB"], (3, 3)), 0.5 * np.array([camera["width"], camera["height"]])
    for tick in range(0, len(outline), 7):
        lines_H = Rotation.from_quat(turns[0][tick]).apply(hull) - history["rho_H"][tick]
        rays = Rotation.from_quat(turns[1][tick]).inv().apply(lines_H) @ R_KB.T
        ends = camera["focal"] * rays[:, :2] / rays[:, 2:] + center
        np.testing.assert_allclose(np.concatenate([ends.min(axis=0), np.ptp(ends, axis=0)]), outline[tick], atol=0.05)
    assert np.linalg.norm(MISALIGNMENT_DEG) > 0.3, "the camera's own error is part of it"


def test_attitudes_turn_without_jumps_and_axes_are_those_of_the_orbit(tmp_path) -> None:
    campaign = played_campaign(tmp_path)
    history, found = campaign.histories[0], playback(campaign, 0)
    assert found is not None
    q_HT = unpack(found["scene"]["q_HT"])
    assert (np.sum(q_HT[1:] * q_HT[:-1], axis=1) > 0.99).all()
    for step in (1, 5, 60):
        axes = playback_geometry.hill_axes(history["time_s"][::step], history["r_TN_N"][::step])
        np.testing.assert_allclose(axes, hill_axes(history["time_s"])[::step], atol=2e-6)


def test_estimated_axes_and_found_landmarks_are_those_of_the_record(tmp_path) -> None:
    campaign = played_campaign(tmp_path)
    before = playback(campaign, 0)
    assert before is not None
    assert not {"q_HT_estimate", "landmarks", "landmarks_px"} & before["servicers"][0]["arrays"].keys()
    add_landmarks(campaign)
    found = playback(campaign, 0)
    assert found is not None
    arrays, camera = found["servicers"][0]["arrays"], found["servicers"][0]["camera"]
    estimate, known = unpack(arrays["q_HT_estimate"]), campaign.histories[0]["time_s"] >= 100.0
    np.testing.assert_array_equal(np.isfinite(estimate).all(axis=1), known)
    off = Rotation.from_quat(estimate[known]).inv() * Rotation.from_quat(unpack(found["scene"]["q_HT"])[known])
    np.testing.assert_allclose(off.as_rotvec(degrees=True), np.tile([2.0, 0.0, 0.0], (known.sum(), 1)), atol=0.02)
    np.testing.assert_array_equal(unpack(arrays["landmarks"]), 3)
    places = unpack(arrays["landmarks_px"])[0].reshape(5, 2)
    assert np.isfinite(places).tolist() == [[True, True]] * 3 + [[False, False]] * 2
    middle = 0.5 * np.array([camera["width"], camera["height"]])
    np.testing.assert_allclose(places[0], middle + camera["focal"] * np.array([-0.05, 0.1]), atol=0.01)


def test_light_is_that_of_the_sun_behind_or_beside_the_earth() -> None:
    epoch = "2026-03-20T14:46:00Z"
    noon, midnight = np.array([7.0e6, 0.0, 0.0]), np.array([-7.0e6, 0.0, 0.0])
    towards, visible = playback_geometry.sunlight(epoch, np.zeros(2), np.array([noon, midnight]))
    # At the equinox the Sun stands along x of the equator.
    np.testing.assert_allclose(towards, [[1.0, 0.0, 0.0]] * 2, atol=0.01)
    np.testing.assert_array_equal(visible, [1.0, 0.0])


def test_a_failed_run_is_played_up_to_its_failure(tmp_path) -> None:
    found = playback(played_campaign(tmp_path, failed=True), 0)
    assert found is not None
    assert (found["end_s"], found["duration_s"]) == (150.0, 300.0)
    assert unpack(found["time_s"])[-1] == 150.0


def test_long_runs_are_thinned_to_their_last_tick_within_the_bytes(tmp_path, monkeypatch) -> None:
    monkeypatch.setattr(run_playback, "MAX_BYTES", 10_000)
    campaign = played_campaign(tmp_path)
    found = playback(campaign, 0)
    assert found is not None
    time = unpack(found["time_s"])
    assert time[-1] == campaign.histories[0]["time_s"][-1]
    assert len(set(np.diff(time))) == 1
    arrays = [*found["servicers"][0]["arrays"].values(), *found["scene"].values(), found["time_s"]]
    assert 7_000 < sum(len(array["data"]) for array in arrays) < 10_000


def test_without_poses_or_a_readable_scenario_places_are_played(build) -> None:
    found = playback(build(runs=1, kept=(0,)), 0)
    assert found is not None
    assert (found["scene"], found["servicers"][0]["camera"]) == ({}, None)
    assert "q_HB" not in found["servicers"][0]["arrays"]
    page = rendered_page(build(runs=1, kept=(0,)))
    ids = {attributes.get("id") for _, attributes in page.tags}
    assert {"play-scene", "play-slider"} <= ids
    assert "play-frame" not in ids


def test_page_has_player_and_says_so_without_a_history(tmp_path, build) -> None:
    page = rendered_page(played_campaign(tmp_path / "played"))
    ids = {attributes.get("id") for _, attributes in page.tags}
    assert {"play-scene", "play-slider", "play-frame", "play-close", "play-state", "play-button"} <= ids
    assert json.loads(page.data)["playback"]["keep_out"] == 10.0
    words = page_text(rendered_page(build(runs=1, kept=())))
    assert "No history with positions was kept, so there is nothing to play." in words


def test_a_large_mesh_is_simplified_and_keeps_its_shape() -> None:
    angles, heights = np.meshgrid(np.linspace(0.0, 2.0 * np.pi, 80, endpoint=False), np.linspace(0.0, np.pi, 60))
    corners = np.stack([np.sin(heights) * np.cos(angles), np.sin(heights) * np.sin(angles), np.cos(heights)], axis=-1)
    row, column = np.meshgrid(np.arange(59), np.arange(80), indexing="ij")
    a, b = row * 80 + column, row * 80 + (column + 1) % 80
    triangles = np.concatenate([np.stack([a, a + 80, b], -1), np.stack([b, a + 80, b + 80], -1)]).reshape(-1, 3)
    full = corners.reshape(-1, 3)
    assert volume(full, triangles) == pytest.approx(4.0 / 3.0 * np.pi, rel=0.01)
    fewer, numbers = simplified(full, triangles, 1000)
    assert 500 < len(numbers) <= 1000
    assert volume(fewer, numbers) == pytest.approx(4.0 / 3.0 * np.pi, rel=0.04)
    assert np.linalg.norm(fewer, axis=1).max() <= 1.0 + 1e-9


def test_a_flat_outline_is_drawn_as_a_box() -> None:
    box = box_triangles(np.array([-1.0, -2.0, -3.0]), np.array([1.0, 2.0, 3.0]))
    assert volume(box.reshape(-1, 3), np.arange(36).reshape(-1, 3)) == pytest.approx(48.0)
    flat = [[x, y, 0.0] for x in (-1.0, 1.0) for y in (-1.0, 1.0)]
    found = shown_mesh({"target": {"hull_m": flat}}, 2.0)
    assert found is not None
    assert np.ptp(np.reshape(found["corners"], (-1, 3)), axis=0).tolist() == [4.0, 4.0, 0.0]
    assert shown_mesh({}) is None
