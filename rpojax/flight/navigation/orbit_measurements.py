"""Measurements of the orbit filter: GPS positions and bounding boxes."""

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from rpojax.core import quaternion
from rpojax.core.pytree import pytree, replace


@pytree
class GpsMeasurement:
    """GPS position of the servicer.

    Attributes:
        position_N: (3,) of the servicer [m]
        present: () bool
        position_low_N: (3,) low-order part of the position in single precision [m]; else None
    """

    position_N: Array
    present: Array
    position_low_N: Array | None = None


@pytree
class BoxMeasurement:
    """Bounding box of the target as bearing and angular size.

    Attributes:
        tangent: (2,) of the ray through its centre in camera axes [-]
        log_size: () log of its mean side over the focal length [-]
        log_aspect: () log of width over height [-]
        side_px: () mean side [px]
        present: () bool
        expected: () bool, the light lets the camera see the target
        truncated: () bool, cut by the frame
        half_frame_tangent: (2,) tangents of the edges of the frame [-]
        attitude_variance_change: () absolute change of the camera attitude's variance since the last frame [rad^2]
        interval: () since the frame before [s]
        weight: () of a box that is used in part, in 0..1, whether present or not; None where it is present or not
    """

    tangent: Array
    log_size: Array
    log_aspect: Array
    side_px: Array
    present: Array
    expected: Array
    truncated: Array
    half_frame_tangent: Array
    attitude_variance_change: Array
    interval: Array
    weight: Array | None = None

    def only_where(self, flag: Bool[Array, ""]) -> "BoxMeasurement":
        """The box, none where the flag is false."""
        weight = None if self.weight is None else jnp.where(flag, self.weight, 0.0)
        return replace(self, present=self.present & flag, weight=weight)


@pytree
class BoxView:
    """Bounding box with the camera that it comes from, as flight software knows it.

    Attributes:
        box: bounding box
        focal_px: () of the camera [px]
        q_KN: (4,) attitude of the camera by the attitude filter
        R_KN: (3, 3) the same
    """

    box: BoxMeasurement
    focal_px: Array
    q_KN: Array
    R_KN: Array


def box_view(box: BoxMeasurement, focal_px: Float[Array, ""], q_KN: Float[Array, "4"]) -> BoxView:
    """A box with its camera of a focal length [px] and an attitude."""
    return BoxView(box=box, focal_px=focal_px, q_KN=q_KN, R_KN=quaternion.to_matrix(q_KN))
