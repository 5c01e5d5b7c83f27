"""Crops of camera pictures of random scenes, with the boxes that a detector would give; the batches of a training."""

from typing import Any

import cv2
import numpy as np

from rpojax.core.pytree import pytree
from rpojax.training.pose.landmark_views import LandmarkViews
from rpojax.training.pose.random_scenes import CANVAS_PX, Scene, random_scene
from rpojax.vision.imaging.srgb import linear_to_srgb_numpy
from rpojax.vision.landmark_network.landmark_crop import CROP_PX, CROP_SCALE, LEAST_SIDE_PX, MARGIN_PX

Rng = np.random.Generator
_MIN_CODE_DIFFERENCE, _MIN_NOISE_SIGMAS, _MIN_ALPHA = 5.0, 2.0, 0.1
"""Of what is visible, as in `visible_box`; of 255 codes."""
_LEAST_VISIBLE_PX = 6.0
"""Shorter side of the box of what is visible; else that of the outline is taken."""
_OUTLINE_SHARE = 0.25
"""Of boxes that are around the outline rather than around what is visible of it."""
_JITTERS = (0.008, 0.08)
"""Least and largest error of the edges of a box, 1 sigma, by its longer side."""
_BLUR_PX = (0.2, 0.9)
_NOISE_PX = 512
_CODES = np.round(255.0 * linear_to_srgb_numpy(np.linspace(0.0, 1.0, 8193))).astype(np.uint8)
"""sRGB code of each of 8193 steps from black to white."""


@pytree
class CropBatch:
    """Crops with what a network is to find in them, in arrays of NumPy on the host and of JAX in the step.

    Attributes:
        codes: (n, 96, 96, 3) 8 bit sRGB codes, resampled
        inside: (n, 96, 96) uint8, 1 within the camera's frame
        places: (n, k, 2) landmarks [crop px]
        in_crop: (n, k) 1 of landmarks in the crop and in the frame, else 0
        visible: (n, k) 1 of those that are in sight, too, else 0
    """

    codes: Any
    inside: Any
    places: Any
    in_crop: Any
    visible: Any


def random_crops(
    views: LandmarkViews, backdrops: np.ndarray, indices: np.ndarray, rng: Rng, turns: int = 1
) -> CropBatch:
    """Crops of a random scene of each of the views with the given indices, each in `turns` of its four quarter turns.

    A turned crop is as good as another one to a network, and costs nothing.
    """
    noise = rng.standard_normal((_NOISE_PX, _NOISE_PX, 3), np.float32)
    found = []
    for index in indices:
        crop = _crop(random_scene(views, backdrops, int(index), rng), noise, rng)
        found += [_turned(crop, int(quarters)) for quarters in rng.permutation(4)[:turns]]
    return CropBatch(**{name: np.stack([each[name] for each in found]) for name in found[0]})


def _crop(scene: Scene, noise: np.ndarray, rng: Rng) -> dict[str, np.ndarray]:
    """One crop as in `CropBatch`; noise is taken from a field of it, as drawing it takes long."""
    frame = scene.framing.frame
    box = _random_box(scene, rng)
    side = CROP_SCALE * max(float(np.max(box[2:] - box[:2])), LEAST_SIDE_PX) + MARGIN_PX
    low = 0.5 * (box[:2] + box[2:]) - 0.5 * side
    picture = exposed(scene, noise, rng)
    at = low[:, None] + (np.arange(CROP_PX) + 0.5) * (side / CROP_PX)
    in_x, in_y = (at > frame[:2, None]) & (at < frame[2:, None])
    places = (scene.places - low) * (CROP_PX / side)
    shown = ((places > 0.0) & (places < CROP_PX) & (scene.places > frame[:2]) & (scene.places < frame[2:])).all(axis=1)
    return {
        "codes": resample(picture, low, side),
        "inside": (in_y[:, None] & in_x[None, :]).astype(np.uint8),
        "places": places.astype(np.float32),
        "in_crop": np.asarray(shown, np.float32),
        "visible": np.asarray(shown & scene.visible, np.float32),
    }


def _turned(crop: dict[str, np.ndarray], quarters: int) -> dict[str, np.ndarray]:
    """A crop after so many quarter turns to the left."""
    places = crop["places"]
    for _ in range(quarters):
        places = np.stack([places[:, 1], CROP_PX - places[:, 0]], axis=1)
    pictures = {name: np.rot90(crop[name], quarters) for name in ("codes", "inside")}
    return {**crop, **pictures, "places": places}


def exposed(scene: Scene, noise: np.ndarray, rng: Rng) -> np.ndarray:
    """8 bit sRGB codes (192, 192, 3) of a scene after blur, shot and read noise."""
    image = scene.target[..., :3] + scene.backdrop * (1.0 - scene.target[..., 3:])
    image = cv2.GaussianBlur(image, (0, 0), float(rng.uniform(*_BLUR_PX)) / scene.framing.binning**0.5 + 0.05)
    row, column = rng.integers(0, _NOISE_PX - CANVAS_PX + 1, 2)
    image = image + scene.sensor.noise_sigma(image) * noise[row : row + CANVAS_PX, column : column + CANVAS_PX]
    return _codes(image)


def _codes(linear: np.ndarray) -> np.ndarray:
    steps = np.clip(linear, 0.0, 1.0) * np.float32(len(_CODES) - 1) + np.float32(0.5)
    return np.take(_CODES, steps.astype(np.int16))


def _random_box(scene: Scene, rng: Rng) -> np.ndarray:
    """Left, top, right, bottom [px] of a box with the errors of a detector, within the frame."""
    box = scene.framing.outline
    if rng.random() >= _OUTLINE_SHARE:
        visible = _visible_box(scene)
        box = box if visible is None else visible
    jitter = np.exp(rng.uniform(*np.log(_JITTERS))) * rng.normal(size=4)
    frame = scene.framing.frame
    return np.clip(box + jitter * (box[2:] - box[:2]).max(), np.tile(frame[:2], 2), np.tile(frame[2:], 2))


def _visible_box(scene: Scene) -> np.ndarray | None:
    """Box around what differs from the empty backdrop, as the detector's labels have it (`visible_box`).

    In pixels of twice the size: the errors of a detector are larger.
    """
    half = (CANVAS_PX // 2, CANVAS_PX // 2)
    target = np.asarray(cv2.resize(scene.target, half, interpolation=cv2.INTER_AREA))
    backdrop = np.asarray(cv2.resize(scene.backdrop, half, interpolation=cv2.INTER_AREA))
    image = target[..., :3] + backdrop * (1.0 - target[..., 3:])
    difference = np.abs(_codes(image).astype(np.int16) - _codes(backdrop)).max(axis=2)
    visible = (difference >= _MIN_CODE_DIFFERENCE) & (target[..., 3] >= _MIN_ALPHA)
    visible &= (np.abs(image - backdrop) >= _MIN_NOISE_SIGMAS * scene.sensor.noise_sigma(backdrop)).any(axis=2)
    middle = 2.0 * np.arange(half[0]) + 1.0
    left, top, right, bottom = scene.framing.frame
    visible &= ((middle > top) & (middle < bottom))[:, None] & ((middle > left) & (middle < right))[None, :]
    rows, columns = np.flatnonzero(visible.any(axis=1)), np.flatnonzero(visible.any(axis=0))
    if min(np.ptp(rows) if len(rows) else 0, np.ptp(columns) if len(columns) else 0) < 0.5 * _LEAST_VISIBLE_PX:
        return None
    return 2.0 * np.array([columns[0], rows[0], columns[-1] + 1.0, rows[-1] + 1.0])


def resample(picture: np.ndarray, low: np.ndarray, side: float) -> np.ndarray:
    """Square of a picture (h, w, 3) resampled to 96 by 96, nearly as `crop_picture` does.

    Linear interpolation after a blur that makes it as wide as a triangle over one pixel of the crop.
    """
    step = side / CROP_PX
    if step > 1.0:
        picture = cv2.GaussianBlur(picture, (0, 0), max(((step**2 - 1.0) / 6.0) ** 0.5, 0.05))
    shift = low + 0.5 * step - 0.5
    matrix = np.array([[step, 0.0, shift[0]], [0.0, step, shift[1]]])
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    return np.asarray(cv2.warpAffine(picture, matrix, (CROP_PX, CROP_PX), flags=flags, borderMode=cv2.BORDER_REPLICATE))
