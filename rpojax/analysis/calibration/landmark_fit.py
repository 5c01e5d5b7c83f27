"""Maximum-likelihood fit of the landmarks of a statistical camera to what the landmark network tells of rendered views.

A picture is false if its landmarks are where those of a target would be that is turned: the pose without a guess says
by how much, and the turn that most of them have is that of the fit. Landmarks of other pictures are found or not, with
an error by the sigma that the network tells.
"""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from rpojax.analysis.calibration.camera_fit import (
    fit_share_and_angle,
    held_out,
    maximise,
    mean_and_spread,
    pair_statistics,
)
from rpojax.analysis.calibration.detection_outcomes import DetectionOutcomes
from rpojax.core import lens_distortion, quaternion
from rpojax.core.pytree import replace
from rpojax.flight.navigation import perspective_n_point
from rpojax.scenario.sections import CameraSection
from rpojax.sensors import statistical_camera_file
from rpojax.sensors.statistical_landmarks import LandmarkStatistics, landmark_distribution, output_count
from rpojax.vision.landmark_network.find_landmarks import IN_SIGHT
from rpojax.vision.multilayer_perceptron import initialize_layers
from rpojax.vision.pinhole import Intrinsics, pinhole_intrinsics
from rpojax.vision.surface.landmarks import Landmarks

_FALSE_SIGMAS = 4.0
"""Median error of the landmarks of a picture over their sigma above which it is false. A choice: of errors that are
normal 3e-4 are beyond."""
_ALIKE_DEG = 30.0
"""Turns of false pictures that are this near one another are the same."""
_FEWEST_FALSE = 5
_MAX_ERROR_SIGMAS = 4.0


def fit_landmarks(
    outcomes: DetectionOutcomes, landmarks: Landmarks, camera: CameraSection, threshold: float, seed: int = 0
) -> tuple[LandmarkStatistics, dict[str, float]]:
    """Fitted statistics without correlation in time, and figures of the fit."""
    rows, seen = _rows(outcomes, threshold)
    field_of_view = jnp.asarray(np.radians(camera.field_of_view_deg))
    distortion = None if camera.distortion is None else jnp.asarray(camera.distortion)
    lens = pinhole_intrinsics(field_of_view, camera.width_px, camera.height_px, distortion)
    turn = _false_turn(outcomes, landmarks, lens, np.flatnonzero(seen)[np.asarray(rows["is_false"])])
    mean, spread = mean_and_spread(rows["features"])
    count = rows["found"].shape[1]
    widths = (*statistical_camera_file.LAYER_WIDTHS[:-1], output_count(count))
    parameters = {"layers": initialize_layers(jax.random.key(seed), widths), "errors": jnp.zeros(2, jnp.float32)}

    def assemble(parameters: dict[str, Any]) -> LandmarkStatistics:
        return LandmarkStatistics(
            mean=mean,
            spread=spread,
            layers=parameters["layers"],
            error_scale=jnp.exp(parameters["errors"][0]),
            tail=0.05 + 0.95 * jax.nn.sigmoid(parameters["errors"][1]),
            lasting_share=jnp.zeros((), jnp.float32),
            lasting_angle=jnp.ones((), jnp.float32),
            false_turn=jnp.asarray(turn, jnp.float32),
        )

    found = assemble(maximise(assemble, _log_likelihood, parameters, *held_out(rows), seed))
    right = ~np.asarray(rows["is_false"])[:, None] & np.asarray(rows["found"])
    figures = {
        "false_pictures": float(np.mean(np.asarray(rows["is_false"]))),
        "false_turn_deg": float(np.degrees(2.0 * np.arccos(min(1.0, abs(float(turn[0])))))),
        "landmarks_found": float(np.mean(np.sum(np.asarray(rows["found"]), axis=1))),
        "error_over_sigma": float(found.error_scale),
        "tail": float(found.tail),
        "beyond_3_sigma": float(np.mean(np.abs(np.asarray(rows["error"]))[right] > 3.0)),
        "pictures": float(np.sum(seen)),
    }
    return found, figures


def with_landmark_correlation(
    statistics: LandmarkStatistics, outcomes: DetectionOutcomes, turn: np.ndarray, threshold: float
) -> LandmarkStatistics:
    """Fitted statistics with the correlation of the errors from picture to picture, of sequences with `turn` [rad]."""
    assert outcomes.landmarks is not None
    normals = np.full((len(outcomes.score), *outcomes.landmarks.places.shape[1:]), np.nan)
    rows, seen = _rows(outcomes, threshold)
    right = ~np.asarray(rows["is_false"])[:, None] & np.asarray(rows["found"])
    scaled = np.asarray(rows["error"]) / float(statistics.error_scale)
    tail = float(statistics.tail)
    normals[seen] = np.where(right[:, :, None], np.arcsinh(tail * scaled) / tail, np.nan)
    frames = len(outcomes.score) // len(turn)
    sequences = np.clip(normals, -_MAX_ERROR_SIGMAS, _MAX_ERROR_SIGMAS).reshape(len(turn), frames, -1)
    share, angle = fit_share_and_angle(*pair_statistics(sequences, turn))
    return replace(
        statistics,
        lasting_share=jnp.asarray(share, jnp.float32),
        lasting_angle=jnp.asarray(angle, jnp.float32),
    )


def _rows(outcomes: DetectionOutcomes, threshold: float) -> tuple[dict[str, Array], np.ndarray]:
    """Inputs of the likelihood of the views with a box of the target, and which these are (n,)."""
    assert outcomes.landmarks is not None
    shown = outcomes.landmarks
    seen = outcomes.is_target(threshold)
    places, sigma = np.asarray(shown.places)[seen], np.asarray(shown.sigma)[seen]
    error = (places - np.asarray(shown.true_places)[seen]) / sigma[:, :, None]
    found = np.asarray(shown.probability)[seen] > IN_SIGHT
    beyond = np.where(found, np.linalg.norm(error, axis=2), np.nan)
    some = found.any(axis=1)
    is_false = np.zeros(len(found), bool)
    is_false[some] = np.nanmedian(beyond[some], axis=1) > _FALSE_SIGMAS
    rows = {
        "features": jnp.asarray(outcomes.features[seen], jnp.float32),
        "found": jnp.asarray(found),
        "is_false": jnp.asarray(is_false),
        "log_sigma": jnp.asarray(np.log(sigma / outcomes.size[seen, None]), jnp.float32),
        "error": jnp.asarray(error, jnp.float32),
    }
    return rows, seen


def _log_likelihood(statistics: LandmarkStatistics, row: dict[str, Array]) -> Array:
    told = landmark_distribution(statistics, row["features"])
    of_kind = _of_chance(told.false_logit, row["is_false"])
    of_sight = jnp.sum(_of_chance(told.found_logit, row["found"]))
    of_sigma = jnp.where(row["found"], -jnp.abs(row["log_sigma"] - told.log_sigma) / 0.3, 0.0)
    scaled = statistics.tail * row["error"] / statistics.error_scale
    normal = jnp.arcsinh(scaled) / statistics.tail
    of_error = -0.5 * normal**2 - 0.5 * jnp.log1p(scaled**2) - jnp.log(statistics.error_scale)
    counts = row["found"] & ~row["is_false"]
    return of_kind + of_sight + jnp.sum(of_sigma) + jnp.sum(jnp.where(counts[:, None], of_error, 0.0))


def _of_chance(logit: Array, happened: Array) -> Array:
    """Log-likelihood of events with a probability by its logit."""
    return -jax.nn.softplus(jnp.where(happened, -logit, logit))


def _false_turn(outcomes: DetectionOutcomes, landmarks: Landmarks, lens: Intrinsics, chosen: np.ndarray) -> np.ndarray:
    """Turn (4,) in T that most of the `chosen` pictures, which are false, show the target by; none with too few."""
    none, shown = np.array([1.0, 0.0, 0.0, 0.0]), outcomes.landmarks
    if shown is None or len(chosen) < _FEWEST_FALSE:
        return none
    places, sigma, sight = (np.asarray(each)[chosen] for each in (shown.places, shown.sigma, shown.probability))
    weight = np.where(sight > IN_SIGHT, (np.asarray(lens.focal_px) / sigma) ** 2, 0.0)
    x, y = jnp.moveaxis((places - np.asarray(lens.center_px)) / np.asarray(lens.focal_px), -1, 0)
    tangents = jnp.stack(lens_distortion.undistort(lens.distortion, x, y), axis=-1)

    def turn(tangents: Array, weight: Array, R_KT: Array) -> tuple[Array, Array]:
        poses = perspective_n_point.solve_pose(landmarks.positions, tangents, weight)
        q_KT = quaternion.from_matrix(R_KT.astype(tangents.dtype))
        q = quaternion.normalize(quaternion.multiply(quaternion.conjugate(q_KT), poses.q_KT[0]))
        return q, poses.exists[0] & poses.enough

    turns, exists = jax.jit(jax.vmap(turn))(tangents, weight, np.asarray(shown.R_KT)[chosen])
    turns = np.asarray(turns)[np.asarray(exists)]
    alike = np.abs(turns @ turns.T) > np.cos(np.radians(0.5 * _ALIKE_DEG))
    if len(turns) < _FEWEST_FALSE or alike.sum(axis=1).max() < _FEWEST_FALSE:
        return none
    same = turns[alike[np.argmax(alike.sum(axis=1))]]
    return np.linalg.eigh(same.T @ same)[1][:, -1]
