"""Synthetic statistical camera and view."""

import itertools

import jax.numpy as jnp
import numpy as np

from rpojax.sensors import statistical_camera_file
from rpojax.sensors.statistical_camera import OUTPUT_COUNT, CameraStatistics
from rpojax.sensors.view_features import FEATURE_COUNT
from rpojax.vision.imaging.image_formation import Scene

CORRELATED_FRACTION = 0.7
MIXING = np.linalg.cholesky(np.array([[1.0, 0.5, 0, 0], [0.5, 1.0, 0, 0], [0, 0, 1.0, -0.4], [0, 0, -0.4, 1.0]]))


def scene(away: tuple[float, float, float] = (0.0, 0.0, -30.0)) -> Scene:
    """A camera below the target that looks up, the Sun from the side."""
    return Scene(
        r_KT_T=jnp.asarray(away, jnp.float32),
        R_KT=jnp.eye(3, dtype=jnp.float32),
        sun_T=jnp.asarray([1.0, 0.0, 0.0], jnp.float32),
        sunlight=jnp.ones((), jnp.float32),
        R_KN=jnp.eye(3, dtype=jnp.float32),
        position_N=jnp.asarray([1.08, 0.0, 0.0], jnp.float32),
        sun_N=jnp.asarray([1.0, 0.0, 0.0], jnp.float32),
        earth_rotation=jnp.zeros((), jnp.float32),
    )


def fitted(true: float, false: float, bias: float = 0.0, wide: float = 0.0) -> CameraStatistics:
    """A camera whose distribution is the same for all views: only the last layer's constants differ from zero."""
    last = np.zeros(OUTPUT_COUNT, np.float32)
    none = 1.0 - true - false
    last[0], last[1] = np.log(true / none), np.log(max(false, 1e-9) / none)
    last[2:6] = bias / 0.1
    widths = statistical_camera_file.LAYER_WIDTHS
    layers = [(jnp.zeros((i, o), jnp.float32), jnp.zeros((o,), jnp.float32)) for i, o in itertools.pairwise(widths)]
    layers[-1] = (layers[-1][0], jnp.asarray(last))
    return CameraStatistics(
        mean=jnp.zeros(FEATURE_COUNT, jnp.float32),
        spread=jnp.ones(FEATURE_COUNT, jnp.float32),
        layers=tuple(layers),
        wide_share=jnp.asarray(wide, jnp.float32),
        mixing=jnp.asarray(MIXING, jnp.float32),
        lasting_share=jnp.asarray(CORRELATED_FRACTION, jnp.float32),
        lasting_angle=jnp.asarray(0.2, jnp.float32),
        false_log_side=jnp.asarray([np.log(10.0), 0.5], jnp.float32),
        false_score=jnp.asarray([0.5, 0.1], jnp.float32),
    )
