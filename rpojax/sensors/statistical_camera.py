"""Camera as a fitted distribution of what renderer and detector would yield, without rendering an image.

A small network maps the features of a view to the parameters of a distribution: whether there is a box, whether it is a
false one, and bias and spread of each edge. What the rendered camera gets wrong in one view it gets wrong in the next
one, too; so a fraction of the variance of the edge errors is correlated in time, a Gauss-Markov process in the angle by
which the target has rotated.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from rpojax.core.pytree import pytree
from rpojax.sensors.camera import CameraFrame
from rpojax.sensors.statistical_landmarks import LandmarkStatistics, advance
from rpojax.sensors.view_features import features, is_in_frame, outputs_for, visible_outline
from rpojax.vision import bounding_box
from rpojax.vision.bounding_box import BoundingBox
from rpojax.vision.imaging.image_formation import Scene
from rpojax.vision.multilayer_perceptron import Layers

OUTPUT_COUNT = 12
"""Outputs of the network: two logits, bias and log sigma of four edges, and mean and log sigma of the score."""
NORMALS_PER_FRAME = 5
"""Standard normal numbers of a frame: of four edges and the score."""
UNIFORMS_PER_FRAME = 7
"""Uniform numbers of a frame: kind, width and four of a false box; the seventh is not used."""
_LOG_SIGMA_RANGE = (-5.5, 0.0)
"""Range of the log of an edge's 1 sigma over the target's size; edges are never better known than to a 245th of it."""
_LOG_SIGMA_START = 3.0
"""Minus the log of that sigma where the network gives zero: 5 % of the size, from where a fit begins."""
_BIAS_SCALE = 0.1
"""Bias of an edge over the target's size where the network gives one: a fit begins with small ones."""
_NO_BOX_LOGIT = -30.0
"""Logit of a box without a target in the frame: a probability of 1e-13."""
_SCORE_START = 2.0
"""Logit of the score where the network gives zero, 0.88, and the greatest log of its sigma either way."""
_LEAST_UNIFORM = 1e-12
"""Least uniform number whose logarithm is taken: 7.4 sigma."""
WIDE_SIGMA_FACTOR = 3.0
"""Ratio of the sigmas of the two normal distributions whose mixture the edge errors are. A choice: the share of the
wide one is fitted."""


@pytree
class CameraStatistics:
    """Parameters of a fitted camera.

    Attributes:
        mean: (FEATURE_COUNT,) of the features of the fit
        spread: (FEATURE_COUNT,) 1 sigma of these
        layers: network from standardised features to the parameters of `FrameDistribution`
        wide_share: () fraction of boxes whose edge errors are WIDE_SIGMA_FACTOR times as wide
        mixing: (4, 4) lower triangular Cholesky factor of the correlation of the four edge errors
        lasting_share: () fraction of the edges' variance that is correlated in time
        lasting_angle: () rotation of the target after which its correlation is 1 / e [rad]
        false_log_side: (2,) mean and 1 sigma of the log of a false box's sides [log px]
        false_score: (2,) mean and 1 sigma of the logit of a false box's score
        landmarks: those of a landmark network in the boxes, None without
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
    landmarks: LandmarkStatistics | None = None


@pytree
class FrameDistribution:
    """Distribution of what a frame yields.

    Attributes:
        log_none: () logarithm of the probability of no box
        log_true: () of a box of the target
        log_false: () of a false box
        bias: (4,) mean error of the edges, fractions of the visible outline's size
        log_sigma: (4,) logarithm of its 1 sigma
        score: (2,) mean and log of 1 sigma of the logit of a box's score
    """

    log_none: Array
    log_true: Array
    log_false: Array
    bias: Array
    log_sigma: Array
    score: Array


def frame_distribution(
    statistics: CameraStatistics, view_features: Float[Array, " features"], in_frame: Bool[Array, ""]
) -> FrameDistribution:
    """Distribution of a frame for the features of its view; a target that is not in the frame has no box."""
    raw = outputs_for(statistics.mean, statistics.spread, statistics.layers, view_features)
    logits = jnp.stack([jnp.zeros((), jnp.float32), jnp.where(in_frame, raw[0], _NO_BOX_LOGIT), raw[1]])
    none, true, false = jax.nn.log_softmax(logits)
    return FrameDistribution(
        log_none=none,
        log_true=true,
        log_false=false,
        bias=_BIAS_SCALE * raw[2:6],
        log_sigma=_soft_clip(raw[6:10] - _LOG_SIGMA_START, *_LOG_SIGMA_RANGE),
        score=jnp.stack([_SCORE_START + raw[10], _soft_clip(raw[11], -_SCORE_START, _SCORE_START)]),
    )


def _soft_clip(value: Array, low: float, high: float) -> Array:
    """Value between two bounds by a sigmoid, with a slope of one in the middle."""
    return low + (high - low) * jax.nn.sigmoid(4.0 * (value - 0.5 * (low + high)) / (high - low))


def advance_correlated_error(
    statistics: CameraStatistics,
    correlated_error: Float[Array, "4"],
    target_rotation: Float[Array, ""],
    normals: Float[Array, "4"],
) -> Float[Array, "4"]:
    """Correlated part of the edge errors (independent, 1 sigma = 1) after a rotation of the target [rad]."""
    return advance(statistics.lasting_angle, correlated_error, target_rotation, normals)


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
    """Frame of one exposure, drawn from its distribution.

    `outline` [px] is the target's, `observable` is the light, `working` the camera's health, `correlated_error` comes
    from `advance_correlated_error`.
    """
    dtype = outline.dtype
    outline, correlated_error, normals, uniforms = (
        v.astype(jnp.float32) for v in (outline, correlated_error, normals, uniforms)
    )
    in_frame = in_front & is_in_frame(outline, size_px)
    distribution = frame_distribution(statistics, features(scene, outline, size_px), in_frame)
    true, false = _draw_kind(distribution, uniforms)
    visible, size = visible_outline(outline, size_px)
    target_edges = visible + size * _edge_errors(statistics, distribution, correlated_error, normals, uniforms)
    edges = jnp.where(false, _false_box(statistics, size_px, uniforms[2:]), target_edges)
    frame_size = jnp.array([*size_px, *size_px], jnp.float32)
    edges = jnp.concatenate([jnp.minimum(edges[:2], edges[2:]), jnp.maximum(edges[:2], edges[2:])])
    edges = jnp.clip(edges, 0.0, frame_size)
    present = (true | false) & observable & working
    score = _draw_score(statistics, distribution, false, normals)
    return CameraFrame(
        box=BoundingBox(
            edges=edges.astype(dtype),
            present=present,
            truncated=bounding_box.touches_border(edges, jnp.zeros_like(frame_size), frame_size),
        ),
        observable=observable,
        score=jnp.where(present, score, 0.0).astype(dtype),
        window=jnp.array([0.0, 0.0, max(size_px)], dtype=dtype),
        outlier=false & observable & working,
        outline=visible.astype(dtype),
    )


def _draw_kind(distribution: FrameDistribution, uniforms: Array) -> tuple[Array, Array]:
    """Whether there is a box of the target, and whether there is a false one, by the first uniform number."""
    true = jnp.log(uniforms[0]) < distribution.log_true
    return true, ~true & (jnp.log(1.0 - uniforms[0]) < distribution.log_false)


def _edge_errors(
    statistics: CameraStatistics,
    distribution: FrameDistribution,
    correlated_error: Array,
    normals: Array,
    uniforms: Array,
) -> Array:
    """Errors (4,) of the edges as fractions of the target's size: bias and a mixture of two normal distributions."""
    width = jnp.where(uniforms[1] < statistics.wide_share, WIDE_SIGMA_FACTOR, 1.0)
    fraction = statistics.lasting_share
    independent = jnp.sqrt(fraction) * correlated_error + jnp.sqrt(1.0 - fraction) * normals[:4]
    standard = jnp.sum(statistics.mixing * independent[None, :], axis=1)
    return distribution.bias + width * jnp.exp(distribution.log_sigma) * standard


def _draw_score(statistics: CameraStatistics, distribution: FrameDistribution, false: Array, normals: Array) -> Array:
    """Score of a box, with distributions of their own for boxes of the target and false ones."""
    mean = jnp.where(false, statistics.false_score[0], distribution.score[0])
    spread = jnp.where(false, statistics.false_score[1], jnp.exp(distribution.score[1]))
    return jax.nn.sigmoid(mean + spread * normals[4])


def _false_box(statistics: CameraStatistics, size_px: tuple[int, int], uniforms: Array) -> Array:
    """False box: centre uniform over the frame, sides log-normal."""
    center = jnp.array(size_px, jnp.float32) * uniforms[:2]
    # Normal numbers from uniform ones (Box and Muller).
    radius = jnp.sqrt(-2.0 * jnp.log(jnp.maximum(uniforms[2], _LEAST_UNIFORM)))
    pair = radius * jnp.stack([jnp.cos(2.0 * jnp.pi * uniforms[3]), jnp.sin(2.0 * jnp.pi * uniforms[3])])
    half = 0.5 * jnp.exp(statistics.false_log_side[0] + statistics.false_log_side[1] * pair)
    return jnp.concatenate([center - half, center + half])
