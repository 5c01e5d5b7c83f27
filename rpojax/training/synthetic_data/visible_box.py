"""Bounding box of the visible part of a silhouette, the label of synthetic images.

Visible are the pixels that the spacecraft covers by at least a tenth and that differ from the empty background by at
least five of 255 codes and twice the noise of the sensor. A dark spacecraft in front of a bright limb thus has its
whole box, and a part as dark as the space behind it is outside of the box, since the image does not show its edge. An
edge lies within its pixel where the covered fraction ends.
"""

import numpy as np

from rpojax.training.synthetic_data.image_sensor import ImageSensor
from rpojax.vision.imaging.srgb import linear_to_srgb_numpy

_MIN_CODE_DIFFERENCE = 5.0 / 255.0
_MIN_NOISE_SIGMAS = 2.0
_MIN_ALPHA = 0.1
_MIN_AREA_PX = 4.0


def visible_box(
    image: np.ndarray, background: np.ndarray, alpha: np.ndarray, sensor: ImageSensor | None = None
) -> np.ndarray | None:
    """Left, top, right, bottom [px] of the visible part of a silhouette, or None if hardly anything is visible.

    `image` and `background` (p, p, 3) are linear, `alpha` (p, p) is the covered fraction; without a sensor there is no
    noise.
    """
    difference = np.abs(linear_to_srgb_numpy(image) - linear_to_srgb_numpy(background)).max(axis=2)
    is_visible = difference >= _MIN_CODE_DIFFERENCE
    if sensor is not None:
        is_visible &= (np.abs(image - background) >= _MIN_NOISE_SIGMAS * sensor.noise_sigma(background)).any(axis=2)
    visible = np.where(is_visible & (alpha >= _MIN_ALPHA), alpha, 0.0)
    if visible.sum() < max(_MIN_AREA_PX, 0.2 * alpha.sum()):
        return None
    edges = []
    for axis in (0, 1):
        profile = visible.max(axis=axis)
        found = np.nonzero(profile)[0]
        first, last = int(found[0]), int(found[-1])
        edges.append((first + 1.0 - profile[first], last + profile[last]))
    (left, right), (top, bottom) = edges
    return np.array([left, top, right, bottom]) if min(right - left, bottom - top) >= 1.5 else None
