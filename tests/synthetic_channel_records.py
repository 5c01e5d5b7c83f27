"""Synthetic channel records of a perfect run."""

import numpy as np

from rpojax.flight.guidance.pointing_modes import Mode

TICKS = 90
SINGLE = 1e-6
"""Relative error of records in single precision."""

Records = dict[str, np.ndarray]


def perfect_run(ticks: int = TICKS, runs: int = 1) -> Records:
    """Records without errors: at the desired position, exactly estimated, always observable."""
    vector = np.zeros((runs, ticks, 3), np.float32)
    scalar = np.zeros((runs, ticks), np.float32)
    flag = np.ones((runs, ticks), bool)
    return {
        "rho_H": vector + np.array([0.0, -30.0, 0.0], np.float32),
        "relative_error_H": vector.copy(),
        "relative_sigma_H": vector + np.float32(1.0),
        "servicer_error_H": vector.copy(),
        "target_error_H": vector.copy(),
        "nees": scalar + np.float32(12.0),
        "nees_relative": scalar + np.float32(6.0),
        "nav_confident": np.ones_like(scalar, dtype=bool),
        "gps_innovation_sigmas": vector + np.float32(1.0),
        "box_innovation_sigmas": vector + np.float32(1.0),
        "range_m": scalar + np.float32(30.0),
        "box_present": flag.copy(),
        "box_accepted": flag.copy(),
        "box_outlier": ~flag,
        "observable": flag.copy(),
        "mode": np.full((runs, ticks), Mode.LOOK, np.int8),
        "pointing_error_deg": scalar + np.float32(0.5),
        "wheel_speed_fraction": vector.copy(),
        "delta_v_m_s": scalar.copy(),
    }
