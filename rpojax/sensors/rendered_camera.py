"""Camera that renders an image and detects the target in it."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from rpojax.core import random_streams
from rpojax.core.numerics.gradient_safe import smooth_gate
from rpojax.core.pytree import pytree, replace
from rpojax.sensors.camera import CameraFrame
from rpojax.sensors.detector_input import input_side
from rpojax.sensors.imaging import Imaging
from rpojax.vision import bounding_box
from rpojax.vision.bounding_box import BoundingBox
from rpojax.vision.detector.two_stage_detector import DetectorParams, detect, soft_detect
from rpojax.vision.imaging.exposure import Exposure
from rpojax.vision.imaging.image_formation import ImageWindow, Scene, form_image
from rpojax.vision.imaging.random_sky import Sky
from rpojax.vision.intersection_over_union import intersection_over_union
from rpojax.vision.landmark_network.find_landmarks import FoundLandmarks, find_landmarks
from rpojax.vision.landmark_network.network import Params as LandmarkParams
from rpojax.vision.radiance_field.ray_budget import RaySampling
from rpojax.vision.radiance_field.target_field import RadianceField

REFINED_PROPOSALS = 2
"""Number of proposals that the detector refines: 1.9 of the 2 ms that it may take (experiments/detector)."""
_FALSE_BOX_OVERLAP = 0.1
"""A box with less intersection over union with the true one is false. A choice: such boxes hardly touch the target."""


@pytree
class Networks:
    """Trained models that render the image and detect the target, with the catalogue of the background.

    Attributes:
        field: radiance field of the target
        detector: parameters of the detector
        sky: stars and Earth
        landmarks: parameters of the network that finds landmarks of the target, None without it
    """

    field: RadianceField
    detector: DetectorParams
    sky: Sky
    landmarks: LandmarkParams | None = None


def render_window(
    imaging: Imaging,
    networks: Networks,
    sampling: RaySampling,
    window: ImageWindow,
    width_px: int,
    height_px: int,
    scene: Scene,
    key: Array,
) -> Float[Array, "p p 3"]:
    """Image (sRGB codes in 0..1) of a window of the frame; black where the window goes beyond the frame."""
    side = input_side(width_px, height_px)
    exposure = Exposure(
        gain=imaging.exposure,
        full_well=imaging.full_well,
        read_noise=imaging.read_noise,
        blur=imaging.blur,
        bloom=imaging.bloom,
        bloom_radius=imaging.bloom_radius,
    )
    fill_light = imaging.fill_light.astype(jnp.float32)
    noise = random_streams.normal(key, side * side * 3).astype(jnp.float32).reshape(side, side, 3)
    image = form_image(networks.field, networks.sky, exposure, sampling, window, side, scene, noise, fill_light)
    pixel = jnp.arange(side, dtype=jnp.float32) + 0.5
    across = window.corner_px[0] + pixel * window.binning < width_px
    down = window.corner_px[1] + pixel * window.binning < height_px
    return jnp.where((down[:, None] & across[None, :])[:, :, None], image, 0.0)


def measure(
    imaging: Imaging,
    networks: Networks,
    window: ImageWindow,
    image: Float[Array, "p p 3"],
    size_px: tuple[int, int],
    true_edges: Float[Array, "4"],
    observable: Bool[Array, ""],
    working: Bool[Array, ""],
    temperature: float | None = None,
) -> CameraFrame:
    """Frame with the best box detected in an image, in pixels of the frame.

    `observable` is the light, `working` the camera's health; without either there is no box. `true_edges` [px] only
    tell false boxes and the true outline. With a `temperature` box and score are smooth in image and parameters, and
    the box has a weight: the logistic step of the log-odds of its score at the threshold. Its derivative by the pose is
    then that of the true outline: that of the picture is of a hundredth of a pixel, and has nothing of the next one
    (experiments/pixel_gradient).
    """
    weight = None
    if temperature is None:
        found = detect(networks.detector, image[None], REFINED_PROPOSALS)
        box, score = found.box_px[0, 0], found.score[0, 0].astype(true_edges.dtype)
    else:
        box, log_odds = soft_detect(networks.detector, image, temperature, REFINED_PROPOSALS)
        log_odds = log_odds.astype(true_edges.dtype)
        score, threshold = jax.nn.sigmoid(log_odds), imaging.score_threshold
        margin = log_odds - jnp.log(threshold) + jnp.log1p(-threshold)
        weight = jnp.where(observable & working, smooth_gate(margin, jnp.asarray(temperature)), 0.0)
    edges = jnp.concatenate([window.corner_px, window.corner_px]) + box * window.binning
    low = jnp.concatenate([window.corner_px, window.corner_px])
    frame_size = jnp.array([*size_px, *size_px], jnp.float32)
    high = jnp.minimum(low + image.shape[0] * window.binning, frame_size)
    truncated = bounding_box.touches_border(edges, low, high, window.binning)
    edges = jnp.clip(edges, 0.0, frame_size).astype(true_edges.dtype)
    if temperature is not None:
        edges = edges + (true_edges - jax.lax.stop_gradient(true_edges))
    present = (score >= imaging.score_threshold) & observable & working
    visible, _ = bounding_box.clip_to_frame(true_edges, *size_px)
    return CameraFrame(
        box=BoundingBox(edges=edges, present=present, truncated=truncated),
        observable=observable,
        score=jnp.where(working, score, 0.0),
        window=jnp.append(window.corner_px, image.shape[0] * window.binning).astype(true_edges.dtype),
        outlier=present & (intersection_over_union(edges, visible) < _FALSE_BOX_OVERLAP),
        outline=visible,
        weight=weight,
    )


def landmarks_in_picture(
    networks: Networks,
    window: ImageWindow,
    image: Float[Array, "p p 3"],
    box_edges: Float[Array, "4"],
    size_px: tuple[int, int],
) -> FoundLandmarks:
    """Landmarks that the network finds in an image, in pixels of the frame; the box is in these, too."""
    assert networks.landmarks is not None
    corners = jnp.concatenate([window.corner_px, window.corner_px])
    frame = (jnp.array([0.0, 0.0, *size_px], jnp.float32) - corners) / window.binning
    box = (box_edges.astype(jnp.float32) - corners) / window.binning
    found = find_landmarks(networks.landmarks, image, box, frame)
    return replace(
        found,
        places=window.corner_px[None] + found.places * window.binning,
        covariance=found.covariance * window.binning**2,
    )


def to_float32(scene: Scene) -> Scene:
    """The scene in single precision, in which images are rendered."""
    return jax.tree.map(lambda value: value.astype(jnp.float32), scene)
