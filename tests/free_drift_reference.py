"""Least distance of free drift by step-wise propagation of the Clohessy-Wiltshire equations."""

import numpy as np
import scipy.linalg


def dynamics(n: float) -> np.ndarray:
    """Matrix of the Clohessy-Wiltshire equations."""
    A = np.zeros((6, 6))
    A[:3, 3:] = np.eye(3)
    A[3, 0], A[3, 4], A[4, 3], A[5, 2] = 3.0 * n * n, 2.0 * n, -2.0 * n, -n * n
    return A


def least_drift_distance(n: float, state: np.ndarray, steps: int) -> float:
    """Least distance over one orbit at `steps + 1` times, by matrix exponentials."""
    transition = scipy.linalg.expm(dynamics(n) * 2.0 * np.pi / n / steps)
    least = np.inf
    for _ in range(steps + 1):
        least = min(least, float(np.linalg.norm(state[:3])))
        state = transition @ state
    return least
