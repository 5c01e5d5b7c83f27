"""Maximum-likelihood fit of the statistical camera to detections in rendered views.

The likelihood of the detections is maximised by gradient over the small network of `sensors.statistical_camera`.

Correlation of a detector's errors between the frames of a turning target, fitted on rendered sequences.

Views of a sequence differ only in the target's attitude. The edges' errors, less their fitted bias and over their
sigma, are correlated from frame to frame: a share of them decays exponentially with the angle that the target has
turned.
"""

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
import optax
from jaxtyping import Array

from rpojax.analysis.calibration.detection_outcomes import DetectionOutcomes, Views, random_directions, sample_views
from rpojax.core import quaternion
from rpojax.scenario.schema import ScenarioFile
from rpojax.sensors import statistical_camera, statistical_camera_file
from rpojax.sensors.statistical_camera import WIDE_SIGMA_FACTOR, CameraStatistics
from rpojax.vision.multilayer_perceptron import initialize_layers

Statistics = TypeVar("Statistics")
_STEPS = 4000
_CHECK_STEPS = 100
_BATCH_ROWS = 1024
_RATE = 4e-3
_WEIGHT_DECAY = 1.0
"""Of the weights of layers, not of their biases."""
_HELD_OUT_FRACTION = 0.15
_DEFAULT_FALSE_LOG_SIDE = (float(np.log(12.0)), 0.6)
_DEFAULT_FALSE_SCORE = (0.5, 0.7)
FRAMES = 24
_TURN_DEG = (0.1, 8.0)
"""Smallest and largest angle between neighbouring frames of a sequence."""
_MAX_ERROR_SIGMAS = 3.0
_MAX_SHARE = 0.99
_BINS = 40
_SHARES = np.linspace(0.0, _MAX_SHARE, 100)
_ANGLES = np.radians(np.exp(np.linspace(np.log(0.2), np.log(90.0), 120)))


@dataclass(frozen=True)
class CameraFit:
    """A fitted camera, and its mean log-likelihood on the fitted outcomes and on held-out ones."""

    statistics: CameraStatistics
    log_likelihood: float
    log_likelihood_held_out: float


def fit_camera(outcomes: DetectionOutcomes, threshold: float, seed: int = 0) -> CameraFit:
    """Maximum-likelihood camera; boxes with a score below the `threshold` count as none."""
    rows = _likelihood_inputs(outcomes, threshold)
    train, check = held_out(rows)
    parameters = {
        "layers": initialize_layers(jax.random.key(seed), statistical_camera_file.LAYER_WIDTHS),
        "wide": jnp.full((), -2.0, jnp.float32),
    }
    mean, spread = mean_and_spread(train["features"])
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

    parameters = maximise(assemble, _log_likelihood, parameters, train, check, seed)
    statistics = assemble(parameters)
    return CameraFit(
        statistics,
        float(_mean_log_likelihood(_log_likelihood, statistics, train)),
        float(_mean_log_likelihood(_log_likelihood, statistics, check)),
    )


def held_out(rows: dict[str, Array]) -> tuple[dict[str, Array], dict[str, Array]]:
    """Rows to be fitted, and those that choose the best step."""
    held = max(1, round(_HELD_OUT_FRACTION * len(next(iter(rows.values())))))
    return {name: value[held:] for name, value in rows.items()}, {name: value[:held] for name, value in rows.items()}


def mean_and_spread(features: Array) -> tuple[Array, Array]:
    """Mean and 1 sigma of features (n, f)."""
    spread = features.std(axis=0)
    # A feature that is constant in the views has no information, and must keep a small effect elsewhere.
    return features.mean(axis=0), jnp.where(spread < 1e-3, jnp.float32(1.0), spread)


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
    """Inputs of the likelihood by row: `kind` is 0 for no box, 1 for a box of the target, 2 for a false box."""
    seen = outcomes.score >= threshold
    true = outcomes.is_target(threshold)
    score = np.clip(outcomes.score, 1e-4, 1.0 - 1e-4)
    return {
        "features": jnp.asarray(outcomes.features, jnp.float32),
        "in_frame": jnp.asarray(outcomes.in_frame),
        "kind": jnp.asarray(np.where(true, 1, np.where(seen, 2, 0)).astype(np.int32)),
        "error": jnp.asarray((outcomes.edges - outcomes.outline) / outcomes.size[:, None], jnp.float32),
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


@partial(jax.jit, static_argnums=0)
def _mean_log_likelihood(
    likelihood: Callable[[Statistics, dict[str, Array]], Array], statistics: Statistics, rows: dict[str, Array]
) -> Array:
    return jnp.mean(jax.vmap(partial(likelihood, statistics))(rows))


def maximise(
    assemble: Callable[[dict[str, Any]], Statistics],
    likelihood: Callable[[Statistics, dict[str, Array]], Array],
    parameters: dict[str, Any],
    rows: dict[str, Array],
    check: dict[str, Array],
    seed: int,
) -> dict[str, Any]:
    """Adam ascent with early stopping: the parameters of the greatest likelihood of the rows of `check`.

    Args:
        assemble: statistics of parameters, of which `layers` are those of a network
        likelihood: log of it, of statistics and one row
        parameters: from where to start
        rows: to be fitted, by name
        check: by which the best step is chosen
        seed: of the choice of rows of each step
    """
    decayed = dict.fromkeys(parameters, False) | {"layers": tuple((True, False) for _ in parameters["layers"])}
    optimiser = optax.adamw(optax.cosine_decay_schedule(_RATE, _STEPS), weight_decay=_WEIGHT_DECAY, mask=decayed)
    count = len(next(iter(rows.values())))

    def step(carry: Any, key: Array) -> tuple[Any, None]:
        parameters, state = carry
        chosen = jax.random.randint(key, (min(_BATCH_ROWS, count),), 0, count, jnp.int32)
        some = {name: value[chosen] for name, value in rows.items()}
        gradient = jax.grad(lambda parameters: -_mean_log_likelihood(likelihood, assemble(parameters), some))(
            parameters
        )
        with jax.numpy_dtype_promotion("standard"):  # optax raises a number to the power of its count
            change, state = optimiser.update(gradient, state, parameters)
        return (optax.apply_updates(parameters, change), state), None

    advance = jax.jit(lambda carry, keys: jax.lax.scan(step, carry, keys)[0])
    carry, best, found = (parameters, optimiser.init(parameters)), -np.inf, parameters
    for keys in jnp.split(jax.random.split(jax.random.key(seed), _STEPS), _STEPS // _CHECK_STEPS):
        carry = advance(carry, keys)
        reached = float(_mean_log_likelihood(likelihood, assemble(carry[0]), check))
        if reached > best:
            best, found = reached, carry[0]
    return found


def outcome_summary(outcomes: DetectionOutcomes, threshold: float) -> dict[str, float | None]:
    """Detection rate, rate of false boxes, median overlap, and bias and sigma of the edges [px]; None if undefined."""
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


@dataclasses.dataclass(frozen=True)
class TumbleSequences:
    """Views of tumbling targets in sequences of FRAMES.

    Attributes:
        views: of all frames, sequence by sequence
        turn_per_frame: (n,) angle between neighbouring frames of each sequence [rad]
    """

    views: Views
    turn_per_frame: np.ndarray


def sample_tumble_sequences(
    file: ScenarioFile, count: int, seed: int, range_m: tuple[float, float] | None = None
) -> TumbleSequences:
    """Sequences from random views, about random axes, at rates from slow to fast."""
    rng = np.random.default_rng([seed, 1])
    first = sample_views(file, count, seed, range_m)
    axis = random_directions(rng, count)
    turn = np.radians(np.exp(rng.uniform(np.log(_TURN_DEG[0]), np.log(_TURN_DEG[1]), count)))
    angle = turn[:, None] * np.arange(FRAMES)
    vector = (angle[:, :, None] * axis[:, None, :]).reshape(-1, 3)
    start = np.repeat(first.q_TN, FRAMES, axis=0)
    q_TN = np.asarray(jax.jit(jax.vmap(lambda v, q: quaternion.multiply(quaternion.exp(v), q)))(vector, start))
    same = {f.name: np.repeat(getattr(first, f.name), FRAMES, axis=0) for f in dataclasses.fields(Views)}
    return TumbleSequences(Views(**{**same, "q_TN": q_TN}), turn)


def with_error_correlation(
    statistics: CameraStatistics, outcomes: DetectionOutcomes, turn: np.ndarray, threshold: float
) -> CameraStatistics:
    """A fitted camera with the correlation of the errors over edges and frames, from sequences with `turn` (n,) [rad].

    The pairwise likelihood of normal errors is maximised over the correlated share and its decay angle.
    """
    errors = normalised_errors(statistics, outcomes, threshold)
    mixing = _edge_mixing(errors[~np.isnan(errors).any(axis=1)])
    independent = np.linalg.solve(mixing, errors.T).T
    sequences = np.clip(independent, -_MAX_ERROR_SIGMAS, _MAX_ERROR_SIGMAS).reshape(len(turn), FRAMES, 4)
    share, angle = fit_share_and_angle(*pair_statistics(sequences, turn))
    # Errors that are wide in single frames are less correlated than the others.
    wide = float(statistics.wide_share)
    share = min(
        _MAX_SHARE, share * (1.0 + (WIDE_SIGMA_FACTOR**2 - 1.0) * wide) / (1.0 + (WIDE_SIGMA_FACTOR - 1.0) * wide) ** 2
    )
    return dataclasses.replace(
        statistics,
        mixing=jnp.asarray(mixing, jnp.float32),
        lasting_share=jnp.asarray(share, jnp.float32),
        lasting_angle=jnp.asarray(angle, jnp.float32),
    )


def _edge_mixing(errors: np.ndarray) -> np.ndarray:
    """Cholesky factor (4, 4) of the correlation of the four edges."""
    if len(errors) < 50:
        return np.eye(4)
    correlation = np.corrcoef(np.clip(errors, -_MAX_ERROR_SIGMAS, _MAX_ERROR_SIGMAS).T)
    return np.linalg.cholesky(0.99 * correlation + 0.01 * np.eye(4))


def pair_statistics(sequences: np.ndarray, turn: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Pairs of frames binned by the angle between them: mean angle, count, sum of squares, sum of products.

    Errors are scaled to a variance of 1.
    """
    scaled = sequences / np.sqrt(np.nanmean(sequences**2))
    angles, squares, products = [], [], []
    for lag in range(1, FRAMES):
        one, other = scaled[:, :-lag], scaled[:, lag:]
        known = ~np.isnan(one * other)
        angles.append(np.broadcast_to((lag * turn)[:, None, None], one.shape)[known])
        squares.append((one**2 + other**2)[known])
        products.append((one * other)[known])
    angle, square, product = (np.concatenate(values) for values in (angles, squares, products))
    border = np.quantile(angle, np.linspace(0.0, 1.0, _BINS + 1)[1:-1]) if len(angle) else np.zeros(_BINS - 1)
    bin_index = np.searchsorted(border, angle)
    count = np.bincount(bin_index, minlength=_BINS)
    mean = np.bincount(bin_index, angle, _BINS) / np.maximum(count, 1)
    return mean, count, np.bincount(bin_index, square, _BINS), np.bincount(bin_index, product, _BINS)


def fit_share_and_angle(
    angle: np.ndarray, count: np.ndarray, square: np.ndarray, product: np.ndarray
) -> tuple[float, float]:
    """Share and decay angle [rad] of the greatest pairwise likelihood on a grid."""
    correlation = _SHARES[:, None, None] * np.exp(-angle / _ANGLES[None, :, None])
    residual = 1.0 - correlation**2
    likelihood = np.sum(-0.5 * count * np.log(residual) - (0.5 * square - correlation * product) / residual, axis=2)
    best = np.unravel_index(np.argmax(likelihood), likelihood.shape)
    return float(_SHARES[best[0]]), float(_ANGLES[best[1]])
