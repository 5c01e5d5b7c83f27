"""Random views of a target for its landmarks: attitude, range, lens, place in the frame, and directions of light."""

import dataclasses

import numpy as np

from rpojax.training.synthetic_data.random_views import unit_vectors

REGION_PX = 160
"""Side of the square region around the target that is ray-traced."""
REGION_SCALE = 1.5
"""The region by the longer side of the outline in it."""
TRAINING_STREAM, HELD_OUT_STREAM = 0, 1
"""First number of the seeds of views: no seed of a training gives a view of an evaluation."""
SUNS = 2
"""Directions of the Sun for each view."""
NARROW_DEG, WIDE_DEG = 20.0, 45.0
"""Fields of view of the two lenses."""
_WIDE_SHARE = {"near": 0.8, "middle": 0.5, "far": 0.15}
_NEAR_M, _FAR_M = 3.0, 12.0
_OFF_CENTER = 0.65
"""Largest tangent of the target's direction by that of half the frame."""
_PORT_SHARE, _PORT_CONE_DEG, _PORT_FAR_M = 0.12, 25.0, 4.0
_PHASE_LIMIT_DEG = 130.0
_ROLLED_FRAME = 1.45
"""Half of the frame's diagonal by half of its side, and a little: where a rolled frame may be."""


@dataclasses.dataclass(frozen=True)
class LandmarkViewSampling:
    """Distribution of views.

    Attributes:
        count: number of views
        seed: of all random numbers
        stream: `TRAINING_STREAM` or `HELD_OUT_STREAM`
        range_m: least and largest range, evenly in its logarithm [m]
        samples: per pixel of the ray tracer
    """

    count: int
    seed: int = 0
    stream: int = TRAINING_STREAM
    range_m: tuple[float, float] = (1.2, 20.0)
    samples: int = 9


@dataclasses.dataclass(frozen=True)
class LandmarkView:
    """Geometry of one view; the picture is that of a pinhole camera whose focal length is 1.

    Attributes:
        rotation: (3, 3) `R_KT`
        position: (3,) camera in T [m]
        range_m: of the target's origin
        field_of_view_deg: of the square frame
        suns: (2, 3) unit vectors to the Sun in T
        lamp: (3,) place of the lamp in T [m]
    """

    rotation: np.ndarray
    position: np.ndarray
    range_m: float
    field_of_view_deg: float
    suns: np.ndarray
    lamp: np.ndarray

    @property
    def half_frame(self) -> float:
        """Tangent of half of the field of view."""
        return float(np.tan(np.radians(0.5 * self.field_of_view_deg)))

    def tangents(self, points: np.ndarray) -> np.ndarray:
        """Tangents (n, 2) right and down of the boresight of points (n, 3) of T [m] before the camera."""
        seen = (points - self.position) @ self.rotation.T
        return seen[:, :2] / np.maximum(seen[:, 2:], 1e-3)


def sample_view(sampling: LandmarkViewSampling, index: int, port_axis: np.ndarray | None) -> LandmarkView:
    """View `index`, which depends on stream, seed and index alone.

    Some views are near and before the docking port, where there is one.
    """
    rng = np.random.default_rng([sampling.stream, sampling.seed, index])
    low, high = np.log(sampling.range_m)
    distance = float(np.exp(rng.uniform(low, high)))
    away = unit_vectors(rng, 1)[0]
    if port_axis is not None and rng.random() < _PORT_SHARE:
        away = port_axis + np.tan(np.radians(_PORT_CONE_DEG)) * rng.random() ** 0.5 * away
        away /= np.linalg.norm(away)
        distance = float(np.exp(rng.uniform(low, np.log(min(_PORT_FAR_M, sampling.range_m[1])))))
    part = "near" if distance < _NEAR_M else "middle" if distance < _FAR_M else "far"
    field_deg = WIDE_DEG if rng.random() < _WIDE_SHARE[part] else NARROW_DEG
    offset = np.tan(np.radians(0.5 * field_deg)) * _OFF_CENTER * rng.uniform(-1.0, 1.0, 2)
    boresight = np.array([*offset, 1.0]) / np.linalg.norm([*offset, 1.0])
    rotation = camera_axes(rng, -away, boresight)
    position = distance * away
    suns = []
    while len(suns) < SUNS:
        sun = unit_vectors(rng, 1)[0]
        if np.degrees(np.arccos(np.clip(sun @ away, -1.0, 1.0))) <= _PHASE_LIMIT_DEG:
            suns.append(sun)
    # Some way beside the lens, by the range so that the light stays nearly frontal.
    lamp = position + 0.06 * min(distance, 3.0) * unit_vectors(rng, 1)[0]
    return LandmarkView(rotation, position, distance, field_deg, np.stack(suns), lamp)


def camera_axes(rng: np.random.Generator, towards: np.ndarray, seen_at: np.ndarray) -> np.ndarray:
    """`R_KT` (3, 3) of a random roll in which the direction `towards` (T) is seen at the unit vector `seen_at` (K)."""
    first, second = (_frame_about(rng, axis) for axis in (seen_at, towards))
    return first @ second.T


def _frame_about(rng: np.random.Generator, axis: np.ndarray) -> np.ndarray:
    """A right-handed set of axes (columns) whose third one is given and whose others are random."""
    x = np.cross(unit_vectors(rng, 1)[0], axis)
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(axis, x), axis], axis=1)


@dataclasses.dataclass(frozen=True)
class Region:
    """Square region of the picture plane: middle (2,) and side, as tangents, and pixels along its side."""

    middle: np.ndarray
    side: float
    size_px: int = REGION_PX

    @property
    def focal_px(self) -> float:
        """Focal length in pixels of the region."""
        return self.size_px / self.side

    def to_pixels(self, tangents: np.ndarray) -> np.ndarray:
        """Places (n, 2) in the region [px] of tangents."""
        return (tangents - self.middle) * self.focal_px + 0.5 * self.size_px


def region_of(view: LandmarkView, vertices: np.ndarray) -> Region:
    """Region around what any roll of the camera has of a target with vertices (n, 3) [m] in its frame."""
    outline = view.tangents(vertices)
    low, high = outline.min(axis=0), outline.max(axis=0)
    reach = _ROLLED_FRAME * view.half_frame
    low, high = np.clip(low, -reach, reach), np.clip(high, -reach, reach)
    side = float(max(high - low)) * REGION_SCALE
    return Region(0.5 * (low + high), min(side, 2.0 * reach))
