"""Maximum-likelihood fit of the statistical camera to detections in rendered views.

The likelihood of the detections is maximised by gradient over the small network of `sensors.statistical_camera`.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import optax
from jaxtyping import Array

from rpojax.analysis.calibration.detection_outcomes import DetectionOutcomes
from rpojax.sensors import statistical_camera, statistical_camera_file
from rpojax.sensors.statistical_camera import WIDE_SIGMA_FACTOR, CameraStatistics
from rpojax.vision.multilayer_perceptron import initialize_layers

_STEPS = 4000
_CHECK_STEPS = 100
_BATCH_ROWS = 1024
_RATE = 4e-3
_WEIGHT_DECAY = 1.0
"""Of the weights of layers, not of their biases."""
_HELD_OUT_FRACTION = 0.15
_MIN_OVERLAP = 0.1
_DEFAULT_FALSE_LOG_SIDE = (float(np.log(12.0)), 0.6)
_DEFAULT_FALSE_SCORE = (0.5, 0.7)


@dataclass(frozen=True)
class CameraFit:
    """A fitted camera, and its mean log-likelihood on the fitted outcomes and on held-out ones."""

    statistics: CameraStatistics
    log_likelihood: float
    log_likelihood_held_out: float


def fit_camera(outcomes: DetectionOutcomes, threshold: float, seed: int = 0) -> CameraFit:
    """Maximum-likelihood camera; boxes with a score below the `threshold` count as none."""
    rows = _likelihood_inputs(outcomes, threshold)
    held = max(1, round(_HELD_OUT_FRACTION * len(outcomes.score)))
    train, check = ({name: value[part] for name, value in rows.items()} for part in (slice(held, None), slice(held)))
    parameters = {
        "layers": initialize_layers(jax.random.key(seed), statistical_camera_file.LAYER_WIDTHS),
        "wide": jnp.full((), -2.0, jnp.float32),
    }
    mean, spread = train["features"].mean(axis=0), train["features"].std(axis=0)
    # A feature that is constant in the views has no information, and must keep a small effect elsewhere.
    spread = jnp.where(spread < 1e-3, jnp.float32(1.0), spread)
    sides = outcomes.edges[:, 2:] - outcomes.edges[:, :2]
    wrong = np.asarray(rows["kind"]) == 2
    false_side = _mean_and_sigma(np.log(np.maximum(sides[wrong], 1.0)), _DEFAULT_FALSE_LOG_SIDE)
    false_score = _mean_and_sigma(np.asarray(rows["logit"])[wrong], _DEFAULT_FALSE_SCORE)

    def assemble(parameters: dict[str, Any]) -> CameraStatistics:
        return CameraStatistics(
            mean=mean,
            spread=spread,
            layers=parameters["layers"],
            wide_share=jax.nn.sigmoid(parameters["wide"]),
            mixing=jnp.eye(4, dtype=jnp.float32),
            lasting_share=jnp.zeros((), jnp.float32),
            lasting_angle=jnp.ones((), jnp.float32),
            false_log_side=false_side,
            false_score=false_score,
        )

    parameters = _maximise(assemble, parameters, train, check, seed)
    statistics = assemble(parameters)
    return CameraFit(
        statistics, float(_mean_log_likelihood(statistics, train)), float(_mean_log_likelihood(statistics, check))
    )


def _mean_and_sigma(values: np.ndarray, default: tuple[float, float]) -> Array:
    """Mean and standard deviation of values, or a default with fewer than eight."""
    return jnp.asarray((values.mean(), max(values.std(), 0.1)) if len(values) >= 8 else default, jnp.float32)


def normalised_errors(statistics: CameraStatistics, outcomes: DetectionOutcomes, threshold: float) -> np.ndarray:
    """Errors (n, 4) of the edges less their bias, over their sigma; NaN without a box of the target."""
    rows = _likelihood_inputs(outcomes, threshold)

    def normalised(row: dict[str, Array]) -> Array:
        found = statistical_camera.frame_distribution(statistics, row["features"], row["in_frame"])
        z = (row["error"] - found.bias) * jnp.exp(-found.log_sigma)
        return jnp.where(row["kind"] == 1, z, jnp.nan)

    return np.asarray(jax.jit(jax.vmap(normalised))(rows), np.float64)


def _likelihood_inputs(outcomes: DetectionOutcomes, threshold: float) -> dict[str, Array]:
    """Inputs of the likelihood by row: `kind` is 0 for no box, 1 for one of the target, 2 for a false one."""
    seen = outcomes.score >= threshold
    true = seen & outcomes.in_frame & (outcomes.overlap > _MIN_OVERLAP)
    size = np.maximum(np.sqrt(np.prod(np.maximum(outcomes.outline[:, 2:] - outcomes.outline[:, :2], 0.1), axis=1)), 2.0)
    score = np.clip(outcomes.score, 1e-4, 1.0 - 1e-4)
    return {
        "features": jnp.asarray(outcomes.features, jnp.float32),
        "in_frame": jnp.asarray(outcomes.in_frame),
        "kind": jnp.asarray(np.where(true, 1, np.where(seen, 2, 0)).astype(np.int32)),
        "error": jnp.asarray((outcomes.edges - outcomes.outline) / size[:, None], jnp.float32),
        "logit": jnp.asarray(np.log(score / (1.0 - score)), jnp.float32),
    }


def _log_likelihood(statistics: CameraStatistics, row: dict[str, Array]) -> Array:
    found = statistical_camera.frame_distribution(statistics, row["features"], row["in_frame"])
    kind = jnp.stack([found.log_none, found.log_true, found.log_false])[row["kind"]]
    z = (row["error"] - found.bias) * jnp.exp(-found.log_sigma)
    narrow = -0.5 * jnp.sum(z * z) - jnp.sum(found.log_sigma)
    wide = (
        -0.5 * jnp.sum(z * z) / WIDE_SIGMA_FACTOR**2
        - jnp.sum(found.log_sigma)
        - 4.0 * jnp.log(jnp.float32(WIDE_SIGMA_FACTOR))
    )
    share = statistics.wide_share
    edges = jnp.logaddexp(jnp.log1p(-share) + narrow, jnp.log(share) + wide)
    s = (row["logit"] - found.score[0]) * jnp.exp(-found.score[1])
    score = -0.5 * s * s - found.score[1]
    return kind + jnp.where(row["kind"] == 1, edges + score, 0.0)


@jax.jit
def _mean_log_likelihood(statistics: CameraStatistics, rows: dict[str, Array]) -> Array:
    return jnp.mean(jax.vmap(partial(_log_likelihood, statistics))(rows))


def _maximise(
    assemble: Callable[[dict[str, Any]], CameraStatistics],
    parameters: dict[str, Any],
    rows: dict[str, Array],
    check: dict[str, Array],
    seed: int,
) -> dict[str, Any]:
    """Adam ascent of the likelihood with early stopping: the parameters with the greatest held-out likelihood."""
    decayed = {"layers": tuple((True, False) for _ in parameters["layers"]), "wide": False}
    optimiser = optax.adamw(optax.cosine_decay_schedule(_RATE, _STEPS), weight_decay=_WEIGHT_DECAY, mask=decayed)
    count = rows["kind"].shape[0]

    def step(carry: Any, key: Array) -> tuple[Any, None]:
        parameters, state = carry
        chosen = jax.random.randint(key, (min(_BATCH_ROWS, count),), 0, count, jnp.int32)
        some = {name: value[chosen] for name, value in rows.items()}
        gradient = jax.grad(lambda parameters: -_mean_log_likelihood(assemble(parameters), some))(parameters)
        with jax.numpy_dtype_promotion("standard"):  # optax raises a number to the power of its count
            change, state = optimiser.update(gradient, state, parameters)
        return (optax.apply_updates(parameters, change), state), None

    advance = jax.jit(lambda carry, keys: jax.lax.scan(step, carry, keys)[0])
    carry, best, found = (parameters, optimiser.init(parameters)), -np.inf, parameters
    for keys in jnp.split(jax.random.split(jax.random.key(seed), _STEPS), _STEPS // _CHECK_STEPS):
        carry = advance(carry, keys)
        likelihood = float(_mean_log_likelihood(assemble(carry[0]), check))
        if likelihood > best:
            best, found = likelihood, carry[0]
    return found


def outcome_summary(outcomes: DetectionOutcomes, threshold: float) -> dict[str, float | None]:
    """Detection rate, rate of false boxes, median overlap, and bias and sigma of the edges [px]; None without any."""
    rows = _likelihood_inputs(outcomes, threshold)
    kind = np.asarray(rows["kind"])
    error = (outcomes.edges - outcomes.outline)[kind == 1]
    inside = outcomes.in_frame
    return {
        "detected_in_frame": float(np.mean(kind[inside] == 1)) if inside.any() else None,
        "false_boxes": float(np.mean(kind == 2)),
        "median_overlap": float(np.median(outcomes.overlap[kind == 1])) if len(error) else None,
        "edge_bias_px": float(np.abs(error.mean(axis=0)).max()) if len(error) else None,
        "edge_sigma_px": float(error.std(axis=0).mean()) if len(error) else None,
    }
