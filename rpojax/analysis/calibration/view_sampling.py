"""Random views of the target for the calibration of a camera: geometry, Sun, and the Earth behind.

Views come from all directions and at every attitude, under every Sun under which the camera may see the target, before
space and before the Earth, in the middle of the frame and cut by its edges.
"""

from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np

from rpojax.core import quaternion
from rpojax.core.constants import RADIUS_EARTH
from rpojax.scenario.schema import ScenarioFile
from rpojax.scenario.trained import fitted_camera, image_sampling

_CENTERED_FRACTION = 0.7
_POINTING_DEG = 0.5
_PENUMBRA_FRACTION = 0.1
"""Fraction of views with a Sun that the Earth hides in part."""
RANGE_FACTORS = (0.6, 1.5)
"""Range of the views over the nearest and the farthest of start and station."""


@dataclass(frozen=True)
class Views:
    """Geometry of views.

    Attributes:
        r_ST_N: (n, 3) camera from target [m]
        q_TN: (n, 4) attitude of the target
        q_KN: (n, 4) attitude of the camera
        sun_N: (n, 3) direction of the Sun
        sunlight: (n,) visible fraction of the Sun
        place_N: (n, 3) position [Earth radii]
        earth_turn: (n,) rotation of the Earth [rad]
    """

    r_ST_N: np.ndarray
    q_TN: np.ndarray
    q_KN: np.ndarray
    sun_N: np.ndarray
    sunlight: np.ndarray
    place_N: np.ndarray
    earth_turn: np.ndarray


def sample_views(file: ScenarioFile, count: int, seed: int) -> Views:
    """Random views in a somewhat wider range than that of the runs of a scenario."""
    rng = np.random.default_rng(seed)
    near, far = image_sampling.range_limits(file.model_dump())
    distance = np.exp(rng.uniform(np.log(RANGE_FACTORS[0] * near), np.log(RANGE_FACTORS[1] * far), count))
    away = random_directions(rng, count)
    place = random_directions(rng, count) * file.orbit.semi_major_axis_m / RADIUS_EARTH
    sun = _sun_directions(rng, file, away, place)
    offset = np.radians(_POINTING_DEG) * rng.normal(size=(count, 2))
    across_frame = 0.6 * np.radians(file.camera.field_of_view_deg) * rng.uniform(-1.0, 1.0, (count, 2))
    offset = np.where(rng.random((count, 1)) < _CENTERED_FRACTION, offset, across_frame)
    return Views(
        r_ST_N=distance[:, None] * away,
        q_TN=_unit(rng.normal(size=(count, 4))),
        q_KN=np.stack(
            [_camera_attitude(-a, o, r) for a, o, r in zip(away, offset, rng.uniform(0, 2 * np.pi, count), strict=True)]
        ),
        sun_N=sun,
        sunlight=np.where(rng.random(count) < _PENUMBRA_FRACTION, rng.uniform(0.5, 1.0, count), 1.0),
        place_N=place,
        earth_turn=rng.uniform(0.0, 2.0 * np.pi, count),
    )


def view_limits(file: ScenarioFile) -> dict[str, tuple[float, float]]:
    """Smallest and largest values of the sampled quantities, by the keys of `fitted_camera.view_limits`."""
    found = fitted_camera.view_limits(file.model_dump())
    near, far = found[fitted_camera.RANGE_KEY]
    return {**found, fitted_camera.RANGE_KEY: (RANGE_FACTORS[0] * near, RANGE_FACTORS[1] * far)}


def _unit(values: np.ndarray) -> np.ndarray:
    return values / np.linalg.norm(values, axis=-1, keepdims=True)


def random_directions(rng: np.random.Generator, count: int) -> np.ndarray:
    """Unit vectors (count, 3), uniform on the sphere."""
    return _unit(rng.normal(size=(count, 3)))


def _sun_directions(rng: np.random.Generator, file: ScenarioFile, away: np.ndarray, place: np.ndarray) -> np.ndarray:
    """Directions (count, 3) of the Sun without eclipse, within the limits of phase angle and Sun exclusion."""
    sun = np.zeros_like(away)
    missing = np.ones(len(away), bool)
    lowest = max(np.cos(np.radians(file.camera.phase_limit_deg)), -np.cos(np.radians(file.camera.sun_exclusion_deg)))
    while missing.any():
        sun[missing] = random_directions(rng, int(missing.sum()))
        height = np.sum(sun * place, axis=1)
        shadowed = (height < 0.0) & (np.sum(place**2, axis=1) - height**2 < 1.0)
        missing = shadowed | (np.sum(sun * away, axis=1) < lowest)
    return sun


def _camera_attitude(line: np.ndarray, offset: np.ndarray, roll: float) -> np.ndarray:
    """`q_KN` of a camera that sees the direction `line` at small angles from its boresight, rolled about it."""
    helper = np.eye(3)[np.argmin(np.abs(line))]
    x = _unit(np.cross(line, helper))
    rows = np.stack([x, np.cross(line, x), line])
    turn = np.array([[np.cos(roll), np.sin(roll), 0.0], [-np.sin(roll), np.cos(roll), 0.0], [0.0, 0.0, 1.0]])
    q = quaternion.from_matrix(jnp.asarray(turn @ rows))
    return np.asarray(quaternion.multiply(quaternion.exp(jnp.asarray([*offset, 0.0])), q))
