"""Synthetic run with the channels of the viewer, without a simulation."""

import jax.numpy as jnp
import numpy as np
from scipy.spatial.transform import Rotation

from rpojax.campaign import single_run
from rpojax.dispersions.designs.run_range import RunRange
from rpojax.flight.guidance.pointing_modes import Mode
from rpojax.interop.rerun_viewer.rrd_chunks import ViewerChannels
from rpojax.interop.run_replay import ReplayedRun
from rpojax.scenario.loading import scenario_loader
from rpojax.sensors import camera_pose

TICKS = 60
NO_BOX, REJECTED = 5, 7
BURN = slice(20, 24)


def target_pointing_attitude(rho_H: np.ndarray, R_KB: np.ndarray) -> np.ndarray:
    """Attitudes R_BH (ticks, 3, 3) with the camera pointing at the origin, its x axis along the orbit normal."""
    z = -rho_H / np.linalg.norm(rho_H, axis=1, keepdims=True)
    x = np.array([0.0, 0.0, 1.0]) - z[:, 2:] * z
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    R_KH = np.stack([x, np.cross(z, x), z], axis=1)
    return R_KB.T @ R_KH


def scalar_first(R: np.ndarray) -> np.ndarray:
    """Quaternions (ticks, 4) of direction cosine matrices (ticks, 3, 3)."""
    return np.roll(Rotation.from_matrix(R).as_quat(), 1, axis=1)


def channels_of(R_HN: np.ndarray) -> dict[str, np.ndarray]:
    """Channels of an approach from 50 m to 40 m with a burn, a tick without a box and one with a rejected box."""
    time, none = np.arange(TICKS) * 1.0, np.arange(TICKS) == NO_BOX
    rho = np.stack([0.3 * np.sin(time / 20.0), -50.0 + 10.0 * time / TICKS, 0.2 * np.cos(time / 30.0)], axis=1)
    burning = np.zeros(TICKS)
    burning[BURN] = 1e-3
    sigma = np.array([0.1, 0.4, 0.12]) * (1.0 + np.exp(-time / 20.0))[:, None]
    error = 0.7 * sigma * np.cos(time[:, None] / np.array([7.0, 9.0, 11.0]))
    covariance = np.eye(3) * sigma[:, :, None] ** 2
    covariance[:, 0, 1] = covariance[:, 1, 0] = 0.5 * np.sqrt(covariance[:, 0, 0] * covariance[:, 1, 1])
    mode = np.full(TICKS, Mode.LOOK, dtype=np.int8)
    mode[BURN] = Mode.BURN
    box = np.tile([50.0, 54.0, 28.0, 20.0], (TICKS, 1))
    return {
        "rho_H": rho,
        "rho_estimate_H": rho - error,
        "relative_error_H": error,
        "relative_sigma_H": sigma,
        "relative_covariance_H": covariance,
        "R_HN": R_HN,
        "range_m": np.linalg.norm(rho, axis=1),
        "box_present": ~none,
        "box_accepted": ~none & (np.arange(TICKS) != REJECTED),
        "box_px": box,
        "outline_px": box + 1.0,
        "expected_px": np.where(none[:, None], np.nan, np.array([64.0, 64.0, 24.0])),
        "gate_px": np.where(none[:, None], np.nan, np.array([6.0, 7.0])),
        "mode": mode,
        "pointing_error_deg": 0.1 + 0.01 * time,
        "delta_v_m_s": np.append(0.0, np.cumsum(burning)[:-1]),
        "mass_kg": np.full(TICKS, 30.0),
        "wheel_speed_fraction": 0.01 * np.sin(time[:, None] / np.array([10.0, 20.0, 30.0])),
    }


def poses_of(values: ViewerChannels, R_KB: np.ndarray) -> dict[str, np.ndarray]:
    """Poses of the same run: the camera points at the target, which turns about its x axis by 1 deg/s."""
    time, R_HN, rho = np.arange(TICKS) * 1.0, values["R_HN"], values["rho_H"]
    tumble = Rotation.from_rotvec(np.deg2rad(1.0) * time[:, None] * np.array([1.0, 0.0, 0.0])).inv().as_matrix()
    return {
        "time_s": time,
        "range_m": values["range_m"],
        "r_TN_N": 7e6 * R_HN[:, 0],
        "r_ST_N": np.einsum("tji,tj->ti", R_HN, rho),
        "q_TN": scalar_first(tumble @ R_HN),
        "q_BN": scalar_first(target_pointing_attitude(rho, R_KB) @ R_HN),
        "window_px": np.tile([0.0, 0.0, 128.0], (TICKS, 1)),
    }


def orbit_frames() -> np.ndarray:
    """Hill frames R_HN (ticks, 3, 3) of a circular orbit inclined by 60 deg."""
    angle = 0.3 + 1.1e-3 * np.arange(TICKS)
    along = Rotation.from_euler("z", -angle[:, None]).as_matrix().reshape(-1, 3, 3)
    return along @ Rotation.from_euler("x", -60.0, degrees=True).as_matrix()


def synthetic_run(*overrides: str) -> ReplayedRun[ViewerChannels]:
    """The synthetic run, with overrides of the scenario."""
    file = scenario_loader.load("inspection", overrides)
    params = single_run.nominal_parameters(file)[1]
    identity = jnp.array([1.0, 0.0, 0.0, 0.0], dtype=jnp.float64)
    q_KB = np.asarray(camera_pose.camera_attitude(params.camera, identity))
    values = channels_of(orbit_frames())
    poses = poses_of(values, Rotation.from_quat(np.roll(q_KB, -1)).as_matrix())
    return ReplayedRun(file, 1, 4, RunRange(0, 8), params, np.nan, values, poses)
