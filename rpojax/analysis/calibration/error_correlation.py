"""How long a detector's errors last while a target turns, fitted on rendered sequences.

Views of a sequence differ only in the target's attitude. What remains of the edges' errors after the fitted bias and
spread is correlated from one frame to the next: a share of it falls off with the angle that the target has turned.
"""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np

from rpojax.analysis.calibration.camera_calibration import (
    DetectionOutcomes,
    Views,
    normalised_errors,
    random_directions,
    sample_views,
)
from rpojax.core import quaternion
from rpojax.scenario.schema import ScenarioFile
from rpojax.sensors.statistical_camera import WIDE_SIGMA_FACTOR, CameraStatistics

FRAMES = 24
_TURN_DEG = (0.1, 8.0)
"""Least and most angle between neighbouring frames of a sequence."""
_MOST = 3.0
_MOST_SHARE = 0.99
_BINS = 40
_SHARES = np.linspace(0.0, _MOST_SHARE, 100)
_ANGLES = np.radians(np.exp(np.linspace(np.log(0.2), np.log(90.0), 120)))


@dataclasses.dataclass(frozen=True)
class TumbleSequences:
    """Views of tumbling targets, FRAMES of each, and the turn [rad] between neighbours of each sequence (n,)."""

    views: Views
    turn_per_frame: np.ndarray


def sample_tumble_sequences(file: ScenarioFile, count: int, seed: int) -> TumbleSequences:
    """Sequences that begin at random views, about random axes, from slow to quick."""
    rng = np.random.default_rng([seed, 1])
    first = sample_views(file, count, seed)
    axis = random_directions(rng, count)
    turn = np.radians(np.exp(rng.uniform(np.log(_TURN_DEG[0]), np.log(_TURN_DEG[1]), count)))
    angle = turn[:, None] * np.arange(FRAMES)
    vector = (angle[:, :, None] * axis[:, None, :]).reshape(-1, 3)
    start = np.repeat(first.q_TN, FRAMES, axis=0)
    q_TN = np.asarray(
        jax.vmap(lambda v, q: quaternion.multiply(quaternion.exp(v), q))(jnp.asarray(vector), jnp.asarray(start))
    )
    same = {f.name: np.repeat(getattr(first, f.name), FRAMES, axis=0) for f in dataclasses.fields(Views)}
    return TumbleSequences(Views(**{**same, "q_TN": q_TN}), turn)


def with_error_correlation(
    statistics: CameraStatistics, outcomes: DetectionOutcomes, turn: np.ndarray, threshold: float
) -> CameraStatistics:
    """A fitted camera with the correlation of edges' errors, over edges and frames, that sequences show.

    The pairwise likelihood of normal errors is maximised over the lasting share and the angle.
    """
    errors = normalised_errors(statistics, outcomes, threshold)
    mixing = _edge_mixing(errors[~np.isnan(errors).any(axis=1)])
    independent = np.linalg.solve(mixing, errors.T).T
    sequences = np.clip(independent, -_MOST, _MOST).reshape(len(turn), FRAMES, 4)
    share, angle = _fit_share_and_angle(*_pair_statistics(sequences, turn))
    # Errors that are wide in one frame alone are less alike from frame to frame than the rest of them.
    wide = float(statistics.wide_share)
    share = min(
        _MOST_SHARE, share * (1.0 + (WIDE_SIGMA_FACTOR**2 - 1.0) * wide) / (1.0 + (WIDE_SIGMA_FACTOR - 1.0) * wide) ** 2
    )
    return dataclasses.replace(
        statistics,
        mixing=jnp.asarray(mixing, jnp.float32),
        lasting_share=jnp.asarray(share, jnp.float32),
        lasting_angle=jnp.asarray(angle, jnp.float32),
    )


def _edge_mixing(errors: np.ndarray) -> np.ndarray:
    """Lower triangle (4, 4) whose product with its transpose is the correlation of the four edges."""
    if len(errors) < 50:
        return np.eye(4)
    correlation = np.corrcoef(np.clip(errors, -_MOST, _MOST).T)
    return np.linalg.cholesky(0.99 * correlation + 0.01 * np.eye(4))


def _pair_statistics(sequences: np.ndarray, turn: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Of pairs of frames by the angle between them: mean angle, number, sum of squares, sum of products.

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
    place = np.searchsorted(border, angle)
    count = np.bincount(place, minlength=_BINS)
    mean = np.bincount(place, angle, _BINS) / np.maximum(count, 1)
    return mean, count, np.bincount(place, square, _BINS), np.bincount(place, product, _BINS)


def _fit_share_and_angle(
    angle: np.ndarray, count: np.ndarray, square: np.ndarray, product: np.ndarray
) -> tuple[float, float]:
    """Share and angle [rad] of the greatest pairwise likelihood on a grid."""
    shared = _SHARES[:, None, None] * np.exp(-angle / _ANGLES[None, :, None])
    rest = 1.0 - shared**2
    likelihood = np.sum(-0.5 * count * np.log(rest) - (0.5 * square - shared * product) / rest, axis=2)
    best = np.unravel_index(np.argmax(likelihood), likelihood.shape)
    return float(_SHARES[best[0]]), float(_ANGLES[best[1]])
