"""Correlation of a detector's errors between the frames of a turning target, fitted on rendered sequences.

Views of a sequence differ only in the target's attitude. The edges' errors, less their fitted bias and over their
sigma, are correlated from frame to frame: a share of them decays exponentially with the angle that the target has
turned.
"""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np

from rpojax.analysis.calibration.camera_fit import normalised_errors
from rpojax.analysis.calibration.detection_outcomes import DetectionOutcomes
from rpojax.analysis.calibration.view_sampling import Views, random_directions, sample_views
from rpojax.core import quaternion
from rpojax.scenario.schema import ScenarioFile
from rpojax.sensors.statistical_camera import WIDE_SIGMA_FACTOR, CameraStatistics

FRAMES = 24
_TURN_DEG = (0.1, 8.0)
"""Smallest and largest angle between neighbouring frames of a sequence."""
_MAX_ERROR_SIGMAS = 3.0
_MAX_SHARE = 0.99
_BINS = 40
_SHARES = np.linspace(0.0, _MAX_SHARE, 100)
_ANGLES = np.radians(np.exp(np.linspace(np.log(0.2), np.log(90.0), 120)))


@dataclasses.dataclass(frozen=True)
class TumbleSequences:
    """Views of tumbling targets in sequences of FRAMES.

    Attributes:
        views: of all frames, sequence by sequence
        turn_per_frame: (n,) angle between neighbouring frames of each sequence [rad]
    """

    views: Views
    turn_per_frame: np.ndarray


def sample_tumble_sequences(file: ScenarioFile, count: int, seed: int) -> TumbleSequences:
    """Sequences from random views, about random axes, at rates from slow to fast."""
    rng = np.random.default_rng([seed, 1])
    first = sample_views(file, count, seed)
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
    share, angle = _fit_share_and_angle(*_pair_statistics(sequences, turn))
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


def _pair_statistics(sequences: np.ndarray, turn: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
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


def _fit_share_and_angle(
    angle: np.ndarray, count: np.ndarray, square: np.ndarray, product: np.ndarray
) -> tuple[float, float]:
    """Share and decay angle [rad] of the greatest pairwise likelihood on a grid."""
    correlation = _SHARES[:, None, None] * np.exp(-angle / _ANGLES[None, :, None])
    residual = 1.0 - correlation**2
    likelihood = np.sum(-0.5 * count * np.log(residual) - (0.5 * square - correlation * product) / residual, axis=2)
    best = np.unravel_index(np.argmax(likelihood), likelihood.shape)
    return float(_SHARES[best[0]]), float(_ANGLES[best[1]])
