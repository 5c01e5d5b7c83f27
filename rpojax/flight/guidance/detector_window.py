"""Detector window: the square of the camera's frame that flight software has the detector look at."""

from dataclasses import dataclass

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from rpojax.core import lens_distortion, quaternion
from rpojax.core.pytree import pytree
from rpojax.flight.guidance.attitude_guidance import PointingState
from rpojax.flight.navigation.attitude_ekf import AttitudeEstimate
from rpojax.flight.navigation.combined_orbit_filter import OrbitEstimate
from rpojax.flight.vehicle_model import VehicleModel

Scalar = Float[Array, ""]

_TRACKING_TIMEOUT_S = 5.0
"""Time since the last accepted box [s] up to which the detector gets the window around the predicted target. A choice:
five frames at 1 Hz, after which it looks for the target in the whole frame."""
TARGET_FRACTION = 0.4
"""Fraction of the window's side that a tracked target is expected to fill: it may be off by 0.75 of its size."""
_LEAST_DEPTH = 1e-3
"""Least depth that is divided by [m], far below any range."""


@dataclass(frozen=True)
class CameraFormat:
    """Sizes of the camera's images.

    Attributes:
        width_px: of the frame
        height_px: of the frame
        input_px: side of the square image that the detector gets
    """

    width_px: int
    height_px: int
    input_px: int


@pytree
class CameraCommand:
    """Command to the camera for its next exposure.

    Attributes:
        corner_px: (2,) left and top of the detector's window in the frame [px], float32
        binning: () pixels of the frame in one of the detector's, along each axis, float32
    """

    corner_px: Array
    binning: Array


def select_window(
    camera: CameraFormat,
    vehicle: VehicleModel,
    target_size: Scalar,
    orbit: OrbitEstimate,
    attitude: AttitudeEstimate,
    pointing: PointingState,
) -> CameraCommand:
    """Window around the predicted target of `target_size` [m] while it is tracked, else the whole frame."""
    q_KN = quaternion.multiply(quaternion.normalize(vehicle.camera_mounting), attitude.q_BN)
    r_TK_K = quaternion.rotate(q_KN, orbit.relative.r_TS_N)
    depth = jnp.maximum(r_TK_K[2], _LEAST_DEPTH)
    center_px = jnp.array([0.5 * camera.width_px, 0.5 * camera.height_px], dtype=depth.dtype)
    tangents = lens_distortion.distort(vehicle.distortion, r_TK_K[0] / depth, r_TK_K[1] / depth)
    expected_px = center_px + vehicle.focal_px * jnp.stack(tangents)
    acquisition = pointing.acquisition
    tracked = acquisition.acquired & (acquisition.unseen_time < _TRACKING_TIMEOUT_S) & (r_TK_K[2] > 0.0)
    return window_around(camera, expected_px, vehicle.focal_px * target_size / depth, tracked)


def whole_frame(camera: CameraFormat) -> CameraCommand:
    """The whole frame, binned to the detector's input."""
    nowhere = jnp.zeros(2, jnp.float32)
    return window_around(camera, nowhere, jnp.zeros((), jnp.float32), jnp.zeros((), bool))


def window_around(
    camera: CameraFormat, expected_px: Float[Array, "2"], expected_size_px: Scalar, tracked: Bool[Array, ""]
) -> CameraCommand:
    """Window around the expected position of a tracked target, else the whole frame, binned to the detector's input."""
    whole = max(max(camera.width_px, camera.height_px) / camera.input_px, 1.0)
    binning = jnp.clip(expected_size_px / (TARGET_FRACTION * camera.input_px), 1.0, whole)
    binning = jnp.where(tracked, binning, whole).astype(jnp.float32)
    limits = jnp.array([camera.width_px, camera.height_px], jnp.float32)
    span = binning * camera.input_px
    # Where the window is as wide as the frame, it begins where the frame does.
    corner = jnp.clip(expected_px.astype(jnp.float32) - 0.5 * span, 0.0, jnp.maximum(limits - span, 0.0))
    return CameraCommand(corner_px=jnp.where(tracked, corner, 0.0), binning=binning)
