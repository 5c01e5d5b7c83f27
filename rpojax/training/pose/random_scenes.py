"""Random scenes: a traced view in random light, rolled, before a random backdrop, and put into a canvas of pixels."""

import dataclasses
from collections.abc import Mapping

import cv2
import numpy as np

from rpojax.training.pose.landmark_views import DECODED, LIGHTS, LandmarkViews
from rpojax.training.pose.view_sampling import SUNS
from rpojax.training.synthetic_data.image_sensor import ImageSensor, add_artefacts
from rpojax.training.synthetic_data.scenery.backdrops import paint_backdrop
from rpojax.training.synthetic_data.scenery.earth_views import EarthTextures

Rng = np.random.Generator
CANVAS_PX = 192
"""Side of the square of the picture around the target."""
BACKDROPS: Mapping[str, float] = {
    "black": 0.36,
    "stars": 0.1,
    "earth": 0.14,
    "limb": 0.1,
    "night": 0.04,
    "glint": 0.03,
    "moon": 0.03,
    "flight": 0.2,
}
"""Kinds of backdrops and their shares."""
_LIGHTS: Mapping[str, float] = {"sunlit": 0.6, "lamp": 0.2, "shaded": 0.2}
_FRAMES_PX: Mapping[int, float] = {768: 0.45, 256: 0.2, 512: 0.1, 0: 0.25}
"""Sides of the frame, and their shares; 0 is one of any size."""
_ANY_FRAME_PX = (160.0, 1200.0)
_LEAST_SIDE_PX = 22.0
"""Of the outline's longer side; smaller targets have no landmarks."""
_LARGEST_GAIN = 60.0
_BRIGHTEST = np.float32(4.0)
_LEAST_IN_FRAME = 0.25
"""Of each side of the outline."""
_FULL_WELL_E, _READ_NOISE_E = (4e3, 5e4), (2.0, 20.0)


@dataclasses.dataclass(frozen=True)
class Scene:
    """What is before a camera.

    Attributes:
        target: (192, 192, 4) float32 linear colour on black and covered fraction
        backdrop: (192, 192, 3) float32 linear colour
        framing: where the frame is
        sensor: electrons at saturation and read noise, of a pixel of the canvas
        places: (k, 2) landmarks [px]
        visible: (k,) whether a landmark is in sight past the target itself
    """

    target: np.ndarray
    backdrop: np.ndarray
    framing: "Framing"
    sensor: ImageSensor
    places: np.ndarray
    visible: np.ndarray


@dataclasses.dataclass(frozen=True)
class Framing:
    """How a region of a view is put into a canvas.

    Attributes:
        matrix: (2, 3) from pixels of the region to those of the canvas
        scale: pixels of the canvas per pixel of the region
        frame: (4,) edges of the camera's frame [px]
        outline: (4,) box around the outline of the target within the frame [px]
        binning: pixels of the camera along a side of one of the canvas
    """

    matrix: np.ndarray
    scale: float
    frame: np.ndarray
    outline: np.ndarray
    binning: float


def paint_backdrops(rng: Rng, earth: EarthTextures, count: int) -> np.ndarray:
    """Linear backdrops (n, 192, 192, 3) float32 of random kinds."""
    kinds = rng.choice(list(BACKDROPS), count, p=list(BACKDROPS.values()))
    return np.stack([paint_backdrop(rng, str(kind), earth, CANVAS_PX) for kind in kinds])


def random_scene(views: LandmarkViews, backdrops: np.ndarray, index: int, rng: Rng) -> Scene:
    """A random scene of the view with the given index."""
    framing = _random_framing(views, index, rng)
    codes = views.codes[index]
    color, full_well = _random_light(codes, rng)
    region = np.empty((*codes.shape[:2], 4), np.float32)
    np.minimum(color, _BRIGHTEST, out=region[..., :3])
    np.multiply(codes[..., -1], np.float32(1.0 / 255.0), out=region[..., 3])
    if framing.scale < 1.0:  # a pixel of the canvas is the mean over several of the region
        region = cv2.GaussianBlur(region, (0, 0), 0.3 * (framing.scale**-2.0 - 1.0) ** 0.5 + 1e-3)
    # Places are numbered by the edges of pixels, but by their middles in what warps.
    matrix = framing.matrix.copy()
    matrix[:, 2] += matrix[:, :2] @ np.full(2, 0.5) - 0.5
    target = cv2.warpAffine(region, matrix, (CANVAS_PX, CANVAS_PX), flags=cv2.INTER_LINEAR)
    places = views.places[index] @ framing.matrix[:, :2].T + framing.matrix[:, 2]
    sensor = ImageSensor(full_well * framing.binning**2, float(rng.uniform(*_READ_NOISE_E)) * framing.binning)
    return Scene(np.asarray(target), _random_backdrop(backdrops, rng), framing, sensor, places, views.visible[index])


def _random_framing(views: LandmarkViews, index: int, rng: Rng) -> Framing:
    """Any roll of the camera that leaves some of the target in the frame, and a frame of some number of pixels."""
    half, focal = float(views.half_frame[index]), float(views.focal_px[index])
    side = int(rng.choice(list(_FRAMES_PX), p=list(_FRAMES_PX.values())))
    side_px = side or float(np.exp(rng.uniform(*np.log(_ANY_FRAME_PX))))
    extent = float(np.ptp(views.outline[index], axis=0).max())
    scale = max(0.5 * side_px / half / focal, _LEAST_SIDE_PX / extent)
    shown = min(scale, float(rng.uniform(0.85, 1.1)))
    half_px = shown * focal * half
    outline, turn = views.outline[index] - views.center[index], np.eye(2)
    low, high = np.zeros(2), np.zeros(2)
    for angle in (*rng.uniform(0.0, 2.0 * np.pi, 8), 0.0):
        turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        rolled = shown * outline @ turn.T
        low, high = np.clip(rolled.min(axis=0), -half_px, half_px), np.clip(rolled.max(axis=0), -half_px, half_px)
        if ((high - low) > np.minimum(_LEAST_IN_FRAME * np.ptp(rolled, axis=0), half_px)).all():
            break
    center = 0.5 * CANVAS_PX + rng.uniform(-0.5, 0.5, 2) - 0.5 * (low + high)
    matrix = np.concatenate([shown * turn, (center - shown * turn @ views.center[index])[:, None]], axis=1)
    frame = np.concatenate([center - half_px, center + half_px])
    return Framing(matrix, shown, frame, np.concatenate([low + center, high + center]), scale / shown)


def _random_light(codes: np.ndarray, rng: Rng) -> tuple[np.ndarray, float]:
    """Linear colour (p, p, 3) of a region under a random mix of its lights, and electrons at saturation."""
    kind = str(rng.choice(list(_LIGHTS), p=list(_LIGHTS.values())))
    mix = np.zeros(LIGHTS)
    shine = float(np.exp(rng.uniform(np.log(0.005), np.log(0.2))))
    if kind == "sunlit":
        mix[int(rng.integers(SUNS))] = 1.0
        mix[-1] = shine
        mix[SUNS] = rng.uniform(0.0, 0.6) if rng.random() < 0.1 else 0.0
    elif kind == "lamp":
        mix[SUNS], mix[-1] = 1.0, 0.3 * shine if rng.random() < 0.5 else 0.0
    else:
        mix[-1] = 1.0
    gain = float(np.exp(rng.normal(scale=0.35)))
    full_well = float(np.exp(rng.uniform(*np.log(_FULL_WELL_E))))
    if kind != "sunlit" or rng.random() < 0.35:
        gain = _target_gain(codes[::3, ::3], mix, rng)
        # What is made brighter by gain has fewer electrons; a longer exposure has not.
        full_well /= max(gain, 1.0) ** float(rng.uniform(0.0, 0.6))
    return _mixed(codes, gain * mix), full_well


def _mixed(codes: np.ndarray, mix: np.ndarray) -> np.ndarray:
    """Linear colour of a region under a mix of its lights."""
    return sum(
        (np.take(np.float32(mix[n]) * DECODED, codes[..., 3 * n : 3 * n + 3]) for n in np.flatnonzero(mix)),
        start=np.zeros(1, np.float32),
    )


def _target_gain(codes: np.ndarray, mix: np.ndarray, rng: Rng) -> float:
    """Exposure for the target: the brighter parts of it are to have some level."""
    covered = codes[codes[..., -1] > 127]
    level = float(np.exp(rng.uniform(np.log(0.08), np.log(1.0))))
    brighter = float(np.quantile(_mixed(covered, mix).max(axis=-1), 0.9)) if len(covered) else 1.0
    return min(level / max(brighter, 1e-4), _LARGEST_GAIN)


def _random_backdrop(backdrops: np.ndarray, rng: Rng) -> np.ndarray:
    """One of the backdrops, turned, mirrored and as bright as chance has it, with artefacts of the camera."""
    chosen = np.rot90(backdrops[int(rng.integers(len(backdrops)))], int(rng.integers(4)))
    if rng.random() < 0.5:
        chosen = chosen[:, ::-1]
    return add_artefacts(rng, np.float32(np.exp(rng.uniform(np.log(0.3), np.log(1.6)))) * chosen)
