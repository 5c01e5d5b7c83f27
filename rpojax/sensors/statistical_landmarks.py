"""Landmarks of a statistical camera: a fitted distribution of what a landmark network finds, without a picture.

A small network maps the features of a view to the probability that each landmark is found, to the error that the
landmark network tells of it, and to the probability that the whole target is taken for one that is turned. What is
wrong in one picture is wrong in the next one, too: a share of the variance of all errors is a Gauss-Markov process in
the angle by which the target has turned before the camera.
"""

import jax
import jax.numpy as jnp
from jax.scipy.special import ndtr
from jaxtyping import Array, Bool, Float

from rpojax.core import quaternion
from rpojax.core.pytree import pytree
from rpojax.sensors.additional.landmark_scene import FoundInPicture, LandmarkScene
from rpojax.sensors.view_features import outputs_for
from rpojax.vision.multilayer_perceptron import Layers

_LOG_SIGMA_START = 4.0
"""Minus the log of the sigma of a landmark over the target's size where the network gives zero: 2 %."""


@pytree
class LandmarkStatistics:
    """Parameters of a fitted landmark network, of `n` landmarks.

    Attributes:
        mean: (FEATURE_COUNT,) of the features of the fit
        spread: (FEATURE_COUNT,) 1 sigma of these
        layers: network from standardised features to the parameters of `LandmarkDistribution`
        error_scale: () 1 sigma of the errors over that of the landmark network
        tail: () of the errors: they are sinh(tail x) / tail of normal numbers x
        lasting_share: () fraction of the variance that is correlated in time
        lasting_angle: () turn of the target before the camera after which its correlation is 1 / e [rad]
        false_turn: (4,) turn in T that a false picture shows the target by
    """

    mean: Array
    spread: Array
    layers: Layers
    error_scale: Array
    tail: Array
    lasting_share: Array
    lasting_angle: Array
    false_turn: Array


@pytree
class LandmarkDistribution:
    """Distribution of what a picture with a box yields.

    Attributes:
        false_logit: () that the whole target is taken for one that is turned
        found_logit: (n,) that a landmark counts as in sight
        log_sigma: (n,) log of 1 sigma that the landmark network tells, over the size of the visible outline
    """

    false_logit: Array
    found_logit: Array
    log_sigma: Array


def output_count(landmarks: int) -> int:
    """Outputs of the network for so many landmarks."""
    return 1 + 2 * landmarks


def normal_count(landmarks: int) -> int:
    """Lasting errors of so many landmarks: two of place and one of sight each, and that of the whole picture."""
    return 3 * landmarks + 1


def landmark_distribution(
    statistics: LandmarkStatistics, view_features: Float[Array, " features"]
) -> LandmarkDistribution:
    """Distribution for the features of a view."""
    raw = outputs_for(statistics.mean, statistics.spread, statistics.layers, view_features)
    count = (raw.shape[0] - 1) // 2
    return LandmarkDistribution(
        false_logit=raw[0], found_logit=raw[1 : 1 + count], log_sigma=raw[1 + count :] - _LOG_SIGMA_START
    )


def advance(
    lasting_angle: Float[Array, ""], lasting: Float[Array, " m"], turn: Float[Array, ""], normals: Float[Array, " m"]
) -> Float[Array, " m"]:
    """Lasting errors (independent, 1 sigma = 1) after a turn of the target [rad], from normal numbers."""
    kept = jnp.exp(-turn / lasting_angle.astype(turn.dtype))
    return kept * lasting + jnp.sqrt(jnp.maximum(1.0 - kept * kept, 0.0)) * normals


def draw(
    statistics: LandmarkStatistics,
    scene: LandmarkScene,
    body_offset: Float[Array, "3"],
    view_features: Float[Array, " features"],
    size: Float[Array, ""],
    has_box: Bool[Array, ""],
    lasting: Float[Array, " m"],
    normals: Float[Array, " m"],
) -> FoundInPicture:
    """Landmarks that are found in a picture, by the focal length of flight software.

    Args:
        statistics: of the landmark network
        scene: landmarks before the camera
        body_offset: (3,) from where the file has the landmarks to where they are, T [m]
        view_features: of the view
        size: () of the visible outline [px]
        has_box: () bool, there is a box of the target
        lasting: (3 n + 1,) lasting errors, of `advance`
        normals: (3 n + 1,) of this picture
    """
    dtype, count = scene.r_TK_K.dtype, scene.landmarks.positions.shape[0]
    found = landmark_distribution(statistics, view_features.astype(jnp.float32))
    share = statistics.lasting_share.astype(dtype)
    mixed = jnp.sqrt(share) * lasting + jnp.sqrt(1.0 - share) * normals
    is_false = ndtr(mixed[-1]) < jax.nn.sigmoid(found.false_logit).astype(dtype)
    of_landmarks = mixed[: 3 * count].reshape(3, count)
    in_sight = ndtr(of_landmarks[2]) < jax.nn.sigmoid(found.found_logit).astype(dtype)
    sigma = jnp.exp(found.log_sigma).astype(dtype) * size / scene.nominal_focal_px
    errors = tailed(of_landmarks[:2].T, statistics.tail.astype(dtype)) * statistics.error_scale.astype(dtype)
    places_T = scene.landmarks.positions
    turned_T = places_T @ quaternion.to_matrix(statistics.false_turn.astype(dtype)).T
    places_T = scene.scale * jnp.where(is_false, turned_T, places_T) + body_offset[None, :]
    tangents = scene.tangents(places_T) + sigma[:, None] * errors
    inside = jnp.all(jnp.abs(tangents) < scene.half_frame_tangent[None, :], axis=1)
    return FoundInPicture(tangents=tangents, sigma=sigma, present=in_sight & inside & has_box)


def tailed(normals: Array, tail: Array) -> Array:
    """Numbers with longer tails than normal ones."""
    return jnp.sinh(tail * normals) / tail
