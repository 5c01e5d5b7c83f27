"""Accuracy of a landmark network on labelled crops."""

import dataclasses

import jax
import numpy as np

from rpojax.training.pose.landmark_loss import crops_of
from rpojax.training.pose.random_crops import CropBatch
from rpojax.vision.landmark_network.network import LandmarkEstimates, Params, estimate

_BATCH = 32


@dataclasses.dataclass(frozen=True)
class CropAccuracy:
    """Accuracy in crops of 96 px.

    Attributes:
        median_px: median error of the places of visible landmarks
        mean_px: mean error
        far_share: share of visible landmarks that are off by more than 6 px
        squares: median of the squared errors over their covariances; 1.39 of two right ones
        sight: share of landmarks whose visibility is told rightly
    """

    median_px: float
    mean_px: float
    far_share: float
    squares: float
    sight: float


_estimate = jax.jit(estimate)


def estimates(params: Params, batch: CropBatch) -> LandmarkEstimates:
    """What a network finds in crops, in arrays of NumPy."""
    count = len(batch.codes)
    padded = jax.tree.map(lambda a: np.concatenate([a, np.repeat(a[-1:], -count % _BATCH, axis=0)]), batch)
    parts = []
    for low in range(0, count, _BATCH):
        chosen = jax.tree.map(lambda a, low=low: a[low : low + _BATCH], padded)
        parts.append(jax.device_get(_estimate(params, crops_of(chosen))))
    return jax.tree.map(lambda *arrays: np.concatenate(arrays)[:count], *parts)


def squared_errors(found: LandmarkEstimates, true: np.ndarray) -> np.ndarray:
    """Squares (n, k) of the errors of places over their covariances."""
    whitened = np.linalg.solve(np.asarray(found.roots), (np.asarray(found.places) - true)[..., None])[..., 0]
    return np.sum(whitened**2, axis=-1)


def crop_accuracy(params: Params, batch: CropBatch) -> CropAccuracy:
    """Accuracy on labelled crops."""
    found = estimates(params, batch)
    shown = batch.visible > 0.0
    error = np.linalg.norm(np.asarray(found.places) - batch.places, axis=-1)[shown]
    right = (np.asarray(found.visible_logit) > 0.0) == shown
    return CropAccuracy(
        median_px=float(np.median(error)),
        mean_px=float(error.mean()),
        far_share=float((error > 6.0).mean()),
        squares=float(np.median(squared_errors(found, batch.places)[shown])),
        sight=float(right.mean()),
    )
