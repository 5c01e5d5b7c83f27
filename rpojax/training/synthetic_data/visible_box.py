"""Bounding box of the visible part of a silhouette, the label of synthetic images.

Visible are the pixels that the spacecraft covers by at least a tenth and that differ from the empty background by at
least five of 255 codes and twice the noise of the sensor. A dark spacecraft in front of a bright limb thus has its
whole box, and a part as dark as the space behind it is outside of the box, since the image does not show its edge. An
edge lies within its pixel where the covered fraction ends.

An edge is known if the image shows it: after blur, it must differ there from what it hides by more than noise and
the clutter around. The others are in the label, but left out of the loss of a training.
"""

import cv2
import numpy as np

from rpojax.training.synthetic_data.image_sensor import ImageSensor
from rpojax.vision.imaging.srgb import linear_to_srgb_numpy

_MIN_CODE_DIFFERENCE = 5.0 / 255.0
_MIN_NOISE_SIGMAS = 2.0
_MIN_ALPHA = 0.1
_MIN_AREA_PX = 4.0
_CLEAR_CODE_DIFFERENCE = 10.0 / 255.0
_CLEAR_CLUTTERS = 0.7
_BLUR_PX = 0.7
_CLUTTER_WINDOW_PX = 9
_KNOWN_WITHIN_PX = 1.0
_KNOWN_WITHIN_FRACTION = 0.05
"""An edge is known if the clear part ends so near to it; the larger of the two, the fraction by the box's side."""


def visible_box(
    image: np.ndarray, background: np.ndarray, alpha: np.ndarray, sensor: ImageSensor | None = None
) -> np.ndarray | None:
    """Left, top, right, bottom [px] of the visible part of a silhouette, or None if hardly anything is visible.

    `image` and `background` (p, p, 3) are linear, `alpha` (p, p) is the covered fraction; without a sensor there is no
    noise.
    """
    return box_of_visible(visible_coverage(image, background, alpha, sensor), alpha)


def box_of_visible(visible: np.ndarray, alpha: np.ndarray) -> np.ndarray | None:
    """Box of a `visible_coverage` (p, p) of a silhouette (p, p), or None if too little of it is visible."""
    if visible.sum() < max(_MIN_AREA_PX, 0.2 * alpha.sum()):
        return None
    box = _box_of_coverage(visible)
    return box if min(box[2:] - box[:2]) >= 1.5 else None


def visible_coverage(
    image: np.ndarray, background: np.ndarray, alpha: np.ndarray, sensor: ImageSensor | None = None
) -> np.ndarray:
    """Covered fraction (p, p) of the pixels in which a silhouette is visible, else 0; arguments as of `visible_box`."""
    difference = np.abs(linear_to_srgb_numpy(image) - linear_to_srgb_numpy(background)).max(axis=2)
    is_visible = difference >= _MIN_CODE_DIFFERENCE
    if sensor is not None:
        is_visible &= (np.abs(image - background) >= _MIN_NOISE_SIGMAS * sensor.noise_sigma(background)).any(axis=2)
    return np.where(is_visible & (alpha >= _MIN_ALPHA), alpha, 0.0)


def known_edges(
    image: np.ndarray, hidden: np.ndarray, alpha: np.ndarray, box: np.ndarray, sensor: ImageSensor
) -> np.ndarray:
    """Whether the image shows each edge (4,) of a box; `hidden` (p, p, 3) is the image without the spacecraft."""
    shown, behind = (cv2.GaussianBlur(linear_to_srgb_numpy(v), (0, 0), _BLUR_PX) for v in (image, hidden))
    mean, mean_square = (cv2.blur(v, (_CLUTTER_WINDOW_PX,) * 2) for v in (behind, behind**2))
    clutter = np.sqrt(np.maximum(mean_square - mean**2, 0.0))
    noise = sensor.noise_sigma(hidden) / np.maximum(2.2 * np.maximum(hidden, 1e-3) ** (1.2 / 2.2), 1e-3)
    least = np.maximum(_CLEAR_CODE_DIFFERENCE, np.maximum(_CLEAR_CLUTTERS * clutter, _MIN_NOISE_SIGMAS * noise))
    clear = np.where((np.abs(shown - behind) >= least).any(axis=2) & (alpha >= _MIN_ALPHA), alpha, 0.0)
    if clear.sum() < _MIN_AREA_PX:
        return np.zeros(4, bool)
    side = np.tile(box[2:] - box[:2], 2)
    tolerance = np.maximum(_KNOWN_WITHIN_PX, _KNOWN_WITHIN_FRACTION * side)
    return np.abs(_box_of_coverage(clear) - box) <= tolerance


def _box_of_coverage(coverage: np.ndarray) -> np.ndarray:
    """Left, top, right, bottom [px] of covered fractions (p, p); at least one of them is above 0."""
    edges = []
    for axis in (0, 1):
        profile = coverage.max(axis=axis)
        found = np.nonzero(profile)[0]
        first, last = int(found[0]), int(found[-1])
        edges.append((first + 1.0 - profile[first], last + profile[last]))
    (left, right), (top, bottom) = edges
    return np.array([left, top, right, bottom])
