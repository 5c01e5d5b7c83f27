"""The camera as a fitted distribution: what renderer and detector would make of a view, without a picture.

A small network turns the geometry of a view into the parameters of a distribution: whether there is a box, whether
it is a false one, and bias and spread of each edge. What the geometry does not tell does not change from frame to frame
either: what the rendered camera gets wrong in one view it gets wrong in the next one, too. So a share of the edges'
errors lasts, a Gauss-Markov process in the angle by which the target has turned.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from rpojax.core.pytree import pytree
from rpojax.sensors.geometric_camera import CameraFrame
from rpojax.vision import bounding_box
from rpojax.vision.bounding_box import BoundingBox
from rpojax.vision.imaging.image_formation import Scene
from rpojax.vision.radiance_field.volume_rendering import Layers, apply_layers

FEATURE_COUNT = 20
OUTPUT_COUNT = 12
NORMALS_PER_FRAME = 5
"""Standard normal numbers that one frame needs."""
UNIFORMS_PER_FRAME = 7
"""Uniform numbers that one frame needs."""
MIN_OUTLINE_PX = 2.0
"""Edge errors are shares of the visible outline's size, and a smaller one counts as so large [px]."""
_LOG_SIGMA_RANGE = (-5.5, 0.0)
"""Edges are never better known than to a 250th of the target's size."""
_FEATURE_CLIP_SIGMA = 4.0
"""Features beyond so many sigma of the fit's views count as so far off."""
WIDE_SIGMA_FACTOR = 3.0
"""How much wider the second of the two normal distributions of edge errors is."""


@pytree
class CameraStatistics:
    """A fitted camera.

    Attributes:
        mean: (FEATURES,) of the features that it was fitted to
        spread: (FEATURES,) 1 sigma of these
        layers: network from standard features to the parameters of `Outcome`
        wide_share: () share of boxes whose edge errors are WIDE times as wide
        mixing: (4, 4) lower triangle that makes standard errors of the four edges of independent ones
        lasting_share: () share of the edges' variance that lasts
        lasting_angle: () turn of the target after which 1 / e of it is left [rad]
        false_log_side: (2,) mean and 1 sigma of the log of a false box's sides [log px]
        false_score: (2,) mean and 1 sigma of the logit of a false box's score
    """

    mean: Array
    spread: Array
    layers: Layers
    wide_share: Array
    mixing: Array
    lasting_share: Array
    lasting_angle: Array
    false_log_side: Array
    false_score: Array


@pytree
class FrameDistribution:
    """Distribution of what a frame yields.

    Attributes:
        log_none: () logarithm of the probability of no box
        log_true: () of a box of the target
        log_false: () of a false box
        bias: (4,) mean error of the edges, shares of the visible outline's size
        log_sigma: (4,) logarithm of its 1 sigma
        score: (2,) mean and log of 1 sigma of the logit of a box's score
    """

    log_none: Array
    log_true: Array
    log_false: Array
    bias: Array
    log_sigma: Array
    score: Array


def features(scene: Scene, outline: Float[Array, "4"], size_px: tuple[int, int]) -> Float[Array, " features"]:
    """What a view's outcome may depend on, from its geometry and the target's outline [px], which may leave the frame.

    Attitude: directions of camera, Sun and image in target axes. Light: phase angle, direction of the Sun in the
    image. Size and place in the frame. Background: whether the Earth is behind, and how bright its light is there.
    """
    away_T = scene.r_KT_T * jax.lax.rsqrt(jnp.sum(scene.r_KT_T**2) + 1e-12)
    right_T, down_T = scene.R_KT[0], scene.R_KT[1]
    visible, size = visible_outline(outline, size_px)
    middle = bounding_box.box_center(visible)
    half = 0.5 * jnp.array(size_px, jnp.float32)
    behind, light = _earth_background(scene, away_T)
    share = _area(visible) / jnp.maximum(_area(outline), 1e-6)
    return jnp.concatenate(
        [
            away_T,
            scene.sun_T,
            right_T,
            jnp.stack(
                [
                    jnp.sum(away_T * scene.sun_T),
                    jnp.sum(right_T * scene.sun_T),
                    jnp.sum(down_T * scene.sun_T),
                    jnp.log(size),
                    jnp.log(jnp.maximum(outline[2] - outline[0], 1.0) / jnp.maximum(outline[3] - outline[1], 1.0)),
                    share,
                    scene.sunlight,
                    behind,
                    light,
                ]
            ),
            (middle - half) / half,
        ]
    )


def visible_outline(outline: Float[Array, "4"], size_px: tuple[int, int]) -> tuple[Float[Array, "4"], Float[Array, ""]]:
    """The outline cut to the frame, and the geometric mean of its sides [px]."""
    visible, _ = bounding_box.clip_to_frame(outline, *size_px)
    return visible, jnp.maximum(bounding_box.box_size(visible), MIN_OUTLINE_PX)


def _area(edges: Array) -> Array:
    sides = jnp.maximum(edges[2:] - edges[:2], 0.0)
    return sides[0] * sides[1]


def _earth_background(scene: Scene, away_T: Array) -> tuple[Array, Array]:
    """Whether the Earth is behind the target, and the cosine of the Sun's zenith angle on the ground there."""
    line_N = -jnp.sum(scene.R_KN * jnp.sum(scene.R_KT * away_T[None, :], axis=1)[:, None], axis=0)
    along = jnp.sum(line_N * scene.position_N)
    nearest = jnp.sum(scene.position_N**2) - along * along
    hit = (along < 0.0) & (nearest < 1.0)
    distance = -along - jnp.sqrt(jnp.where(hit, 1.0 - nearest, 0.0))
    ground = scene.position_N + distance * line_N
    light = jnp.where(hit, jnp.maximum(jnp.sum(ground * scene.sun_N), 0.0), 0.0)
    return hit.astype(jnp.float32), light


def frame_distribution(
    statistics: CameraStatistics, view_features: Float[Array, " features"], in_frame: Bool[Array, ""]
) -> FrameDistribution:
    """Distribution of a view's outcome; a target that is not in the frame has no box."""
    standard = jnp.clip(
        (view_features - statistics.mean) / statistics.spread, -_FEATURE_CLIP_SIGMA, _FEATURE_CLIP_SIGMA
    )
    raw = apply_layers(statistics.layers, standard)
    logits = jnp.stack([jnp.zeros((), jnp.float32), jnp.where(in_frame, raw[0], -30.0), raw[1]])
    none, true, false = jax.nn.log_softmax(logits)
    return FrameDistribution(
        log_none=none,
        log_true=true,
        log_false=false,
        bias=0.1 * raw[2:6],
        log_sigma=_soft_clip(raw[6:10] - 3.0, *_LOG_SIGMA_RANGE),
        score=jnp.stack([2.0 + raw[10], _soft_clip(raw[11], -2.0, 2.0)]),
    )


def _soft_clip(value: Array, low: float, high: float) -> Array:
    """A value kept between two others, smoothly."""
    return low + (high - low) * jax.nn.sigmoid(4.0 * (value - 0.5 * (low + high)) / (high - low))


def is_in_frame(outline: Float[Array, "4"], size_px: tuple[int, int]) -> Bool[Array, ""]:
    """Whether enough of the outline is in the frame for a box to be one of the target."""
    visible, _ = bounding_box.clip_to_frame(outline, *size_px)
    return _area(visible) > 1.0


def advance_correlated_error(
    statistics: CameraStatistics,
    correlated_error: Float[Array, "4"],
    target_rotation: Float[Array, ""],
    normals: Float[Array, "4"],
) -> Float[Array, "4"]:
    """What lasts of the edges' errors (independent, 1 sigma = 1) after the target has turned by an angle [rad]."""
    kept = jnp.exp(-target_rotation / statistics.lasting_angle.astype(target_rotation.dtype))
    return kept * correlated_error + jnp.sqrt(jnp.maximum(1.0 - kept * kept, 0.0)) * normals


def measure(
    statistics: CameraStatistics,
    scene: Scene,
    outline: Float[Array, "4"],
    in_front: Bool[Array, ""],
    size_px: tuple[int, int],
    observable: Bool[Array, ""],
    working: Bool[Array, ""],
    correlated_error: Float[Array, "4"],
    normals: Float[Array, "5"],
    uniforms: Float[Array, "7"],
) -> CameraFrame:
    """Box of one exposure.

    `outline` [px] is the target's, `observable` is the light, `working` the camera's health, `lasting` what `advance`
    carries from frame to frame.
    """
    outline, correlated_error, normals, uniforms = (
        v.astype(jnp.float32) for v in (outline, correlated_error, normals, uniforms)
    )
    in_frame = in_front & is_in_frame(outline, size_px)
    distribution = frame_distribution(statistics, features(scene, outline, size_px), in_frame)
    true = jnp.log(uniforms[0]) < distribution.log_true
    false = ~true & (jnp.log(1.0 - uniforms[0]) < distribution.log_false)
    visible, size = visible_outline(outline, size_px)
    width = jnp.where(uniforms[1] < statistics.wide_share, WIDE_SIGMA_FACTOR, 1.0)
    share = statistics.lasting_share
    independent = jnp.sqrt(share) * correlated_error + jnp.sqrt(1.0 - share) * normals[:4]
    standard = jnp.sum(statistics.mixing * independent[None, :], axis=1)
    true_edges = visible + size * (distribution.bias + width * jnp.exp(distribution.log_sigma) * standard)
    edges = jnp.where(false, _false_box(statistics, size_px, uniforms[2:]), true_edges)
    frame_size = jnp.array([*size_px, *size_px], jnp.float32)
    edges = jnp.concatenate([jnp.minimum(edges[:2], edges[2:]), jnp.maximum(edges[:2], edges[2:])])
    edges = jnp.clip(edges, 0.0, frame_size)
    present = (true | false) & observable & working
    mean = jnp.where(false, statistics.false_score[0], distribution.score[0])
    spread = jnp.where(false, statistics.false_score[1], jnp.exp(distribution.score[1]))
    score = jax.nn.sigmoid(mean + spread * normals[4])
    return CameraFrame(
        box=BoundingBox(
            edges=edges.astype(jnp.float64),
            present=present,
            truncated=bounding_box.touches_border(edges, jnp.zeros_like(frame_size), frame_size),
        ),
        observable=observable & working,
        score=jnp.where(present, score, 0.0).astype(jnp.float64),
        window=jnp.array([0.0, 0.0, max(size_px)], dtype=jnp.float64),
        outlier=false & observable & working,
        outline=visible.astype(jnp.float64),
    )


def _false_box(statistics: CameraStatistics, size_px: tuple[int, int], uniforms: Array) -> Array:
    """A false box: anywhere in the frame, its sides log-normal."""
    center = jnp.array(size_px, jnp.float32) * uniforms[:2]
    # Normal numbers from uniform ones (Box and Muller).
    radius = jnp.sqrt(-2.0 * jnp.log(jnp.maximum(uniforms[2], 1e-12)))
    pair = radius * jnp.stack([jnp.cos(2.0 * jnp.pi * uniforms[3]), jnp.sin(2.0 * jnp.pi * uniforms[3])])
    half = 0.5 * jnp.exp(statistics.false_log_side[0] + statistics.false_log_side[1] * pair)
    return jnp.concatenate([center - half, center + half])
