"""The camera in its full form: a picture is rendered, and a detector finds boxes in it."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from rpojax.core import random_streams
from rpojax.core.pytree import pytree
from rpojax.sensors.geometric_camera import CameraFrame
from rpojax.vision import bounding_box
from rpojax.vision.bounding_box import BoundingBox
from rpojax.vision.detector.two_stage_detector import SIDE_MULTIPLE_PX, DetectorParams, detect
from rpojax.vision.imaging.exposure import Exposure
from rpojax.vision.imaging.image_formation import ImageWindow, Scene, form_image, image_window
from rpojax.vision.imaging.stars_and_earth import Sky
from rpojax.vision.pinhole import Intrinsics
from rpojax.vision.radiance_field.ray_budget import RaySampling
from rpojax.vision.radiance_field.target_field import RadianceField

Scalar = Float[Array, ""]

MAX_INPUT_PX = 128
"""Side of the pictures that the detector gets from larger frames."""
TARGET_FRACTION = 0.4
"""Share of a window that a tracked target is expected to take."""
REFINED_PROPOSALS = 2
"""Boxes that get a second look."""
_FALSE_BOX_OVERLAP = 0.1


@pytree
class Imaging:
    """The camera's optics and detector, and what the box detector asks for.

    Attributes:
        exposure: 1 = white level of the field at full well [-]
        full_well: electrons at saturation
        read_noise: 1 sigma [electrons]
        blur: sigma of the point spread [px]
        score_threshold: boxes below this score are no boxes [-]
        center_sigma: how far a box's middle strays from the outline's as attitude and light change, as flight software
            knows it [m]
    """

    exposure: Array
    full_well: Array
    read_noise: Array
    blur: Array
    score_threshold: Array
    center_sigma: Array


@pytree
class Networks:
    """What pictures are made with and looked at with.

    Attributes:
        field: the target's
        detector: parameters of the network
        sky: stars and Earth
    """

    field: RadianceField
    detector: DetectorParams
    sky: Sky


def input_side(width_px: int, height_px: int) -> int:
    """Side [px] of the picture that the detector gets: the frame, or for large frames a window of it."""
    return min(-(-max(width_px, height_px) // SIDE_MULTIPLE_PX) * SIDE_MULTIPLE_PX, MAX_INPUT_PX)


def choose_window(
    lens: Intrinsics,
    width_px: int,
    height_px: int,
    expected_px: Float[Array, "2"],
    expected_size_px: Scalar,
    tracked: Bool[Array, ""],
) -> ImageWindow:
    """The whole frame, binned; of a large frame and a tracked target the part around where it is expected."""
    side = input_side(width_px, height_px)
    whole = max(max(width_px, height_px) / side, 1.0)
    binning = jnp.clip(expected_size_px / (TARGET_FRACTION * side), 1.0, whole)
    binning = jnp.where(tracked, binning, whole).astype(jnp.float32)
    limits = jnp.array([width_px, height_px], jnp.float32)
    span = binning * side
    # Where the window is as wide as the frame, it begins where the frame does.
    corner = jnp.clip(expected_px.astype(jnp.float32) - 0.5 * span, 0.0, jnp.maximum(limits - span, 0.0))
    corner = jnp.where(tracked, corner, 0.0)
    return window_at(lens, corner, binning)


def window_at(lens: Intrinsics, corner_px: Float[Array, "2"], binning: Scalar) -> ImageWindow:
    """Window at a corner of the frame, float32, as pictures are made of it."""
    own = Intrinsics(focal_px=lens.focal_px.astype(jnp.float32), center_px=lens.center_px.astype(jnp.float32))
    return image_window(own, corner_px, binning)


def render_window(
    imaging: Imaging,
    networks: Networks,
    sampling: RaySampling,
    view: ImageWindow,
    width_px: int,
    height_px: int,
    scene: Scene,
    key: Array,
) -> Float[Array, "p p 3"]:
    """Picture (sRGB codes in 0..1) of a window of the frame; black where the window goes beyond the frame."""
    side = input_side(width_px, height_px)
    exposure = Exposure(
        gain=imaging.exposure, full_well=imaging.full_well, read_noise=imaging.read_noise, blur=imaging.blur
    )
    noise = random_streams.normal(key, side * side * 3).astype(jnp.float32).reshape(side, side, 3)
    picture = form_image(networks.field, networks.sky, exposure, sampling, view, side, scene, noise)
    place = jnp.arange(side, dtype=jnp.float32) + 0.5
    across = view.corner_px[0] + place * view.binning < width_px
    down = view.corner_px[1] + place * view.binning < height_px
    return jnp.where((down[:, None] & across[None, :])[:, :, None], picture, 0.0)


def measure(
    imaging: Imaging,
    networks: Networks,
    view: ImageWindow,
    picture: Float[Array, "p p 3"],
    size_px: tuple[int, int],
    true_edges: Float[Array, "4"],
    observable: Bool[Array, ""],
    working: Bool[Array, ""],
) -> CameraFrame:
    """The best box in a picture, in pixels of the frame; `true_edges` [px] are for bookkeeping only.

    `observable` is the light, `working` the camera's health; without either there is no box.
    """
    found = detect(networks.detector, picture[None], REFINED_PROPOSALS)
    box, score = found.box_px[0, 0], found.score[0, 0].astype(jnp.float64)
    edges = jnp.concatenate([view.corner_px, view.corner_px]) + box * view.binning
    low = jnp.concatenate([view.corner_px, view.corner_px])
    frame_size = jnp.array([*size_px, *size_px], jnp.float32)
    high = jnp.minimum(low + picture.shape[0] * view.binning, frame_size)
    cut = bounding_box.touches_border(edges, low, high, view.binning)
    edges = jnp.clip(edges, 0.0, frame_size).astype(jnp.float64)
    seen = (score >= imaging.score_threshold) & observable & working
    visible, _ = bounding_box.clip_to_frame(true_edges, *size_px)
    return CameraFrame(
        box=BoundingBox(edges=edges, present=seen, truncated=cut),
        observable=observable & working,
        score=jnp.where(working, score, 0.0),
        window=jnp.append(view.corner_px, picture.shape[0] * view.binning).astype(jnp.float64),
        outlier=seen & (bounding_box.intersection_over_union(edges, visible) < _FALSE_BOX_OVERLAP),
        outline=visible,
    )


def to_float32(scene: Scene) -> Scene:
    """The scene as pictures are made of it."""
    return jax.tree.map(lambda value: value.astype(jnp.float32), scene)
