"""Camera pictures of ray-traced views that no training has: the target as a camera's window shows it, and its pose.

Unlike in a training nothing is turned or resampled afterwards: each picture is traced in the pixels of its camera, or
in binned ones as the closed loop reads out its window, and exposed by the sensor of the detector's data.
"""

import dataclasses
from collections.abc import Callable
from pathlib import Path

import numpy as np

from rpojax.training.pose.landmark_views import (
    LIGHTS,
    LandmarkRayTracer,
    convex_corners,
    views_key,
)
from rpojax.training.pose.random_scenes import BACKDROPS
from rpojax.training.pose.view_sampling import (
    HELD_OUT_STREAM,
    SUNS,
    WIDE_DEG,
    LandmarkView,
    LandmarkViewSampling,
    Region,
    sample_view,
)
from rpojax.training.synthetic_data.image_sensor import ImageSensor, expose_image
from rpojax.training.synthetic_data.meshes.target_mesh import TargetMesh
from rpojax.training.synthetic_data.scenery.backdrops import paint_backdrop
from rpojax.training.synthetic_data.scenery.earth_views import EarthTextures
from rpojax.training.synthetic_data.view_cache import ViewCache
from rpojax.training.synthetic_data.visible_box import visible_box
from rpojax.vision.surface.landmarks import Landmarks
from rpojax.vision.surface.surface_corners import body_size

PICTURE_PX = 160
"""Side of a picture; a multiple of what the detector takes."""
LIGHT_KINDS = ("sunlit", "lamp", "shaded")
_LIGHT_SHARES = (0.5, 0.25, 0.25)
_LARGE_FRAME_PX, _SMALL_FRAME_PX = 768, 256
_SMALL_SHARE = 0.3
"""Of pictures of a camera with the smaller frame."""
_WINDOW_SCALE = 1.5
"""Window by the longer side of the target's outline."""
_OFFSET = 0.08
"""Largest offset of the window's middle from the outline's by its side."""
_SHINE = 0.05
"""Irradiance of uniform light beside the Sun, by the Sun's, as a radiance field is trained with."""
_LEVEL = 0.5
"""Radiance of the brighter parts of a target that the lamp or the Earth alone lights, after exposure."""
_LARGEST_GAIN = 60.0
_PORT_CONE_DEG = 20.0
_CAMERA, _EXPOSURE = 1, 2
"""Last numbers of the seeds of light and camera, and of exposure and backdrop; a 0 would be the seed of the view."""
OnProgress = Callable[[int, int], None]


@dataclasses.dataclass(frozen=True)
class HeldBackPicture:
    """A picture and what is true of it.

    Attributes:
        codes: (160, 160, 3) 8 bit sRGB codes, black beyond the camera's frame
        frame: (4,) edges of the frame in the picture [px]
        box: (4,) around what is visible of the target [px], or around its outline where hardly anything is
        focal_px: focal length in pixels of the picture
        center_px: (2,) principal point [px]
        binning: pixels of the camera along a side of one of the picture
        places: (k, 2) landmarks [px]
        visible: (k,) whether each is in the frame and in sight
        rotation: (3, 3) `R_KT`
        position: (3,) target's origin in the camera [m]
        range_m: of it
        light: one of `LIGHT_KINDS`
        before_port: whether the camera is near the axis of the docking port, with the wide lens
    """

    codes: np.ndarray
    frame: np.ndarray
    box: np.ndarray
    focal_px: float
    center_px: np.ndarray
    binning: float
    places: np.ndarray
    visible: np.ndarray
    rotation: np.ndarray
    position: np.ndarray
    range_m: float
    light: str
    before_port: bool


@dataclasses.dataclass(frozen=True)
class _Plan:
    """What of a view is drawn before it is traced."""

    view: LandmarkView
    window: Region
    light: str
    frame_px: int


def held_back_pictures(
    mesh: TargetMesh,
    landmarks: Landmarks,
    earth: EarthTextures,
    sampling: LandmarkViewSampling,
    folder: Path,
    on_progress: OnProgress = lambda done, total: None,
    draw: Callable[[LandmarkViewSampling, int, np.ndarray | None], LandmarkView] = sample_view,
) -> list[HeldBackPicture]:
    """Pictures of `sampling`, whose stream is to be `HELD_OUT_STREAM`; traced ones are stored in the folder.

    `draw` gives the view of a number; another one than the default needs a folder of its own.
    """
    vertices = convex_corners(mesh)
    size_m = body_size(np.concatenate([part.vertices[part.faces] for part in mesh.parts]))
    cache = ViewCache(folder, f"{views_key(mesh, landmarks, sampling)} {PICTURE_PX}")
    axis = None if landmarks.port_axis is None else np.asarray(landmarks.port_axis)
    tracer, pictures = None, []
    for index in range(sampling.count):
        plan = _plan(sampling, index, draw(sampling, index, axis), vertices)
        block = cache.read(index, 1, ("film", "visible"))
        if block is None:
            tracer = tracer or LandmarkRayTracer(mesh, sampling.samples)
            film = tracer.trace(plan.view, plan.window, 1 + index * (LIGHTS + 1), _mix(plan.light) > 0.0)
            visible = tracer.visible(plan.view, landmarks, size_m)
            block = {"film": film[None].astype(np.float16), "visible": visible[None]}
            cache.write(index, block)
        rng = np.random.default_rng([HELD_OUT_STREAM, sampling.seed, index, _EXPOSURE])
        film = block["film"][0].astype(np.float32)
        pictures.append(_picture(plan, film, block["visible"][0], landmarks, vertices, earth, rng))
        on_progress(index + 1, sampling.count)
    return pictures


def _mix(light: str) -> np.ndarray:
    """Irradiance of each light."""
    mix = np.zeros(LIGHTS)
    if light == "sunlit":
        mix[0], mix[-1] = 1.0, _SHINE
    else:
        mix[SUNS if light == "lamp" else -1] = 1.0
    return mix


def _plan(sampling: LandmarkViewSampling, index: int, view: LandmarkView, vertices: np.ndarray) -> _Plan:
    """Light, camera and window of a picture of a view."""
    rng = np.random.default_rng([HELD_OUT_STREAM, sampling.seed, index, _CAMERA])
    light = str(rng.choice(LIGHT_KINDS, p=_LIGHT_SHARES))
    frame_px = _SMALL_FRAME_PX if rng.random() < _SMALL_SHARE else _LARGE_FRAME_PX
    low, high = _outline(view, vertices)
    least = PICTURE_PX * 2.0 * view.half_frame / frame_px
    side = max(_WINDOW_SCALE * float((high - low).max()), least)
    middle = 0.5 * (low + high) + _OFFSET * side * rng.uniform(-1.0, 1.0, 2)
    return _Plan(view, Region(middle, side, PICTURE_PX), light, frame_px)


def _outline(view: LandmarkView, vertices: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Tangents of the corners of the box around the target's outline within the frame."""
    seen = np.clip(view.tangents(vertices), -view.half_frame, view.half_frame)
    return seen.min(axis=0), seen.max(axis=0)


def _picture(
    plan: _Plan,
    film: np.ndarray,
    visible: np.ndarray,
    landmarks: Landmarks,
    vertices: np.ndarray,
    earth: EarthTextures,
    rng: np.random.Generator,
) -> HeldBackPicture:
    """Exposes a traced view before a backdrop."""
    view, window = plan.view, plan.window
    binning = max(1.0, 0.5 * plan.frame_px / view.half_frame / window.focal_px)
    lights = film[..., :-1].reshape(PICTURE_PX, PICTURE_PX, LIGHTS, 3)
    color = np.tensordot(lights, _mix(plan.light).astype(np.float32), (2, 0))
    alpha = np.clip(film[..., -1:], 0.0, 1.0)
    gain = float(np.exp(rng.normal(scale=0.2)))
    if plan.light != "sunlit":
        covered = color[alpha[..., 0] > 0.5].max(axis=1)
        gain = min(_LEVEL * gain / max(float(np.quantile(covered, 0.9)) if len(covered) else 1.0, 1e-4), _LARGEST_GAIN)
    kind = str(rng.choice(list(BACKDROPS), p=list(BACKDROPS.values())))
    backdrop = paint_backdrop(rng, kind, earth, PICTURE_PX)
    target = np.minimum(gain * color, 4.0).astype(np.float32)
    image = target + backdrop * (1.0 - alpha)
    sensor = ImageSensor(float(rng.uniform(1e4, 4e4)) * binning**2, float(rng.uniform(3.0, 15.0)) * binning)
    low, high = (window.to_pixels(np.full((1, 2), sign * view.half_frame))[0] for sign in (-1.0, 1.0))
    middle = np.arange(PICTURE_PX) + 0.5
    in_x, in_y = ((middle > low[axis]) & (middle < high[axis]) for axis in (0, 1))
    inside = (in_y[:, None] & in_x[None, :])[..., None]
    codes = np.where(inside, expose_image(rng, image.astype(np.float32), sensor), 0).astype(np.uint8)
    places = window.to_pixels(view.tangents(np.asarray(landmarks.positions)))
    shown = visible_box(inside * image, inside * backdrop, inside[..., 0] * alpha[..., 0], sensor)
    outline = np.concatenate([window.to_pixels(each[None])[0] for each in _outline(view, vertices)])
    frame = np.clip(np.concatenate([low, high]), 0.0, PICTURE_PX)
    return HeldBackPicture(
        codes=codes,
        frame=frame,
        # The frame may end within a pixel, and whole pixels are seen.
        box=np.clip(outline if shown is None else shown, np.tile(frame[:2], 2), np.tile(frame[2:], 2)),
        focal_px=window.focal_px,
        center_px=window.to_pixels(np.zeros((1, 2)))[0],
        binning=binning,
        places=places,
        visible=visible & ((places > np.maximum(low, 0.0)) & (places < np.minimum(high, PICTURE_PX))).all(axis=1),
        rotation=view.rotation,
        position=-view.rotation @ view.position,
        range_m=view.range_m,
        light=plan.light,
        before_port=_is_before_port(view, landmarks),
    )


def _is_before_port(view: LandmarkView, landmarks: Landmarks) -> bool:
    """Whether a view with the wide lens is near the axis of the docking port."""
    if landmarks.port_axis is None or view.field_of_view_deg < WIDE_DEG:
        return False
    along = float(view.position @ np.asarray(landmarks.port_axis)) / view.range_m
    return along > float(np.cos(np.radians(_PORT_CONE_DEG)))
