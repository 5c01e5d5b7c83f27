"""Independent numpy versions of basic mathematics, and random inputs."""

import numpy as np
from hypothesis import strategies

MU, RADIUS, J2 = 3.986004418e14, 6378137.0, 1.08262668e-3
"""Earth: gravitational parameter [m^3/s^2], equatorial radius [m], second zonal harmonic [-]."""

IDENTITY = np.array([1.0, 0.0, 0.0, 0.0])

SEEDS = strategies.integers(0, 2**32 - 1)
"""Hypothesis draws seeds, numpy makes arrays from them: shapes stay fixed, and compiled functions are reused."""


def unit(vector: np.ndarray) -> np.ndarray:
    """Vector of length one along `vector`."""
    return vector / np.linalg.norm(vector)


def random_unit(rng: np.random.Generator, size: int = 3) -> np.ndarray:
    """Direction or quaternion, uniform over its sphere."""
    return unit(rng.normal(size=size))


def random_position(rng: np.random.Generator) -> np.ndarray:
    """Position [m] from low to geostationary orbit."""
    return rng.uniform(6.6e6, 4.2e7) * random_unit(rng)


def axis_angle_quaternion(axis: np.ndarray, angle: float) -> np.ndarray:
    """Quaternion that turns a vector by `angle` [rad] about `axis`."""
    return np.concatenate([[np.cos(0.5 * angle)], np.sin(0.5 * angle) * unit(np.asarray(axis, dtype=float))])


def rotation_matrix(q: np.ndarray) -> np.ndarray:
    """Rotation matrix of a unit quaternion by Rodrigues' formula."""
    angle = 2.0 * np.arctan2(np.linalg.norm(q[1:]), q[0])
    if angle == 0.0:
        return np.eye(3)
    x, y, z = unit(q[1:])
    K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + np.sin(angle) * K + (1.0 - np.cos(angle)) * K @ K


def attitude_difference(q: np.ndarray, p: np.ndarray) -> float:
    """Angle [rad] between two attitudes, accurate also when it is small."""
    chord = min(np.linalg.norm(q - p), np.linalg.norm(q + p))
    return 4.0 * float(np.arcsin(min(0.5 * chord, 1.0)))


def rate_between(before: np.ndarray, after: np.ndarray, dt: float) -> np.ndarray:
    """Mean rate [rad/s], in body axes, that takes the attitude `q_BN` from one to another nearby in `dt` [s]."""
    step = rotation_matrix(after) @ rotation_matrix(before).T
    return np.array([step[1, 2] - step[2, 1], step[2, 0] - step[0, 2], step[0, 1] - step[1, 0]]) / (2.0 * dt)


def gravity(r: np.ndarray) -> np.ndarray:
    """Two-body and J2 acceleration [m/s^2], Vallado's component form."""
    distance = np.linalg.norm(r)
    factor = 1.5 * J2 * MU * RADIUS**2 / distance**5
    ratio = 5.0 * (r[2] / distance) ** 2
    return -MU * r / distance**3 - factor * r * np.array([1.0 - ratio, 1.0 - ratio, 3.0 - ratio])


def random_covariance(rng: np.random.Generator, sigma: np.ndarray) -> np.ndarray:
    """Well-conditioned correlated covariance with the given 1-sigma values."""
    n = len(sigma)
    factor = rng.normal(size=(n, 3 * n))
    sample = factor @ factor.T
    scale = sigma / np.sqrt(np.diag(sample))
    return scale[:, None] * sample * scale[None, :]


def relative_error(found: np.ndarray, expected: np.ndarray) -> float:
    """Largest difference over the largest expected magnitude."""
    return float(np.max(np.abs(np.asarray(found) - expected)) / np.max(np.abs(expected)))
