"""A campaign of one run with poses and boxes that fit each other, for playback without the simulator."""

import math
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation
from synthetic_campaign_results import SyntheticCampaign, synthetic_campaign

from rpojax.scenario.loading import scenario_loader

ORBIT_RATE = 1.107e-3
ORBIT_RADIUS_M = 6.878e6
MISALIGNMENT_DEG = (0.1, -0.2, 0.3)
SCALE = 1.25


def played_campaign(folder: Path, seconds: int = 300, failed: bool = False) -> SyntheticCampaign:
    """One run of `inspection` whose camera follows the tumbling target."""
    campaign = synthetic_campaign(folder, runs=1, seconds=seconds, kept=(0,), failed=(0,) if failed else ())
    scenario = scenario_loader.load("inspection", [f"duration_s={seconds}"])
    campaign.info["scenario"] = {**scenario.model_dump(), "requirements": []}
    campaign.drawn = {"camera.misalignment_deg": np.array([MISALIGNMENT_DEG]), "target.scale": np.array([SCALE])}
    history = campaign.histories[0]
    history.update(_poses(history))
    history.update(_boxes(history, campaign.info["scenario"]))
    return campaign


def add_landmarks(campaign: SyntheticCampaign) -> None:
    """Scenario and landmarks of `capture`: attitude known from 100 s on, off by 2 deg about x, 3 landmarks."""
    scenario = scenario_loader.load("capture").model_dump()
    campaign.info["scenario"] = {**scenario, "requirements": []}
    campaign.phase_names = [*(phase["name"] for phase in scenario["phases"]), "hold", "aborted"]
    history = campaign.histories[0]
    time, count = history["time_s"], len(history["time_s"])
    true = Rotation.from_quat(np.roll(np.nan_to_num(history["q_TN"], nan=0.5), -1, axis=1)).as_matrix()
    turn = Rotation.from_rotvec([math.radians(2.0), 0.0, 0.0]).as_matrix()
    estimate = np.where(time[:, None] < 100.0, np.nan, _scalar_first(turn @ true))
    tangents = np.where(np.arange(5) < 3, np.linspace(-0.05, 0.05, 5), np.nan)
    history |= {
        "phase": np.full(count, 4, np.int8),
        "q_TN_estimate": estimate.astype(np.float32),
        "landmarks_found": np.full(count, 3, np.int8),
        "landmarks_right_tangent": np.broadcast_to(tangents, (count, 5)).astype(np.float32),
        "landmarks_down_tangent": np.broadcast_to(-2.0 * tangents, (count, 5)).astype(np.float32),
    }


def hill_axes(time_s: np.ndarray) -> np.ndarray:
    """`R_HN` (n, 3, 3) of the circular orbit, which is inclined by 50 degrees."""
    angle, tilt = ORBIT_RATE * time_s, math.radians(50.0)
    radial = np.stack([np.cos(angle), np.sin(angle) * math.cos(tilt), np.sin(angle) * math.sin(tilt)], axis=1)
    normal = np.broadcast_to([0.0, -math.sin(tilt), math.cos(tilt)], radial.shape)
    return np.stack([radial, np.cross(normal, radial), normal], axis=1)


def _poses(history: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    time = history["time_s"]
    R_HN = hill_axes(time)
    R_TN = Rotation.from_rotvec(np.outer(time, [0.004, 0.01, -0.02])).as_matrix()
    ahead_H = -history["rho_H"] / np.linalg.norm(history["rho_H"], axis=1)[:, None]
    right_H = np.cross(ahead_H, [1.0, 0.2, 0.1])
    right_H /= np.linalg.norm(right_H, axis=1)[:, None]
    # The camera looks along x of the body.
    R_BH = np.stack([ahead_H, right_H, np.cross(ahead_H, right_H)], axis=1)
    R_BH = np.where(np.isfinite(R_BH), R_BH, np.eye(3))
    poses = {
        "r_TN_N": ORBIT_RADIUS_M * R_HN[:, 0],
        "q_TN": _scalar_first(R_TN),
        "q_BN": _scalar_first(R_BH @ R_HN),
    }
    alive = np.isfinite(history["rho_H"][:, :1])
    return {name: np.where(alive, values, np.nan).astype(np.float32) for name, values in poses.items()}


def _scalar_first(R: np.ndarray) -> np.ndarray:
    return np.roll(Rotation.from_matrix(R).as_quat(), 1, axis=1)


def _boxes(history: dict[str, np.ndarray], scenario: dict) -> dict[str, np.ndarray]:
    """True outlines of the hull, a measured box one pixel larger, and an expected one without a gate's error."""
    camera = scenario["camera"]
    focal = 0.5 * camera["width_px"] / math.tan(math.radians(0.5 * camera["field_of_view_deg"]))
    mounting = Rotation.from_quat(np.roll(camera["mounting"], -1)).as_matrix()
    R_KB = Rotation.from_rotvec(np.radians(MISALIGNMENT_DEG)).as_matrix() @ mounting
    hull = SCALE * np.array(scenario["target"]["hull_m"])
    R_HN = hill_axes(history["time_s"])
    outlines = np.full((len(R_HN), 4), np.nan)
    for tick in np.flatnonzero(np.isfinite(history["rho_H"]).all(axis=1)):
        R_TN, R_BN = (
            Rotation.from_quat(np.roll(history[name][tick].astype(float), -1)).as_matrix() for name in ("q_TN", "q_BN")
        )
        lines_N = hull @ R_TN - history["rho_H"][tick] @ R_HN[tick]
        x, y, depth = R_KB @ R_BN @ lines_N.T
        ends = np.array([x, y]) * focal / depth + 0.5 * np.array([[camera["width_px"]], [camera["height_px"]]])
        outlines[tick] = [*ends.min(axis=1), *np.ptp(ends, axis=1)]
    expected = np.concatenate([outlines[:, :2] + 0.5 * outlines[:, 2:], outlines[:, 2:3]], axis=1)
    boxes = np.where(history["box_present"][:, None], outlines + np.array([-0.5, -0.5, 1.0, 1.0]), 0.0)
    found = {"outline_px": outlines, "box_px": boxes, "expected_px": expected, "gate_px": 0.0 * expected[:, :2] + 4.0}
    return {name: values.astype(np.float32) for name, values in found.items()}
