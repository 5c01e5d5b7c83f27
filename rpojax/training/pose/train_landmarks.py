"""Training of the landmark network on crops of random scenes of ray-traced views."""

import dataclasses
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jax
import numpy as np

from rpojax.training.epoch_training import Training, train_by_epochs, training_key
from rpojax.training.pose.crop_accuracy import crop_accuracy
from rpojax.training.pose.landmark_loss import landmark_loss
from rpojax.training.pose.landmark_views import LandmarkViews
from rpojax.training.pose.random_crops import CropBatch, random_crops
from rpojax.vision.landmark_network.network import Params

_JUDGED_SHARE = 1.0 / 32.0
"""Of the views: those that no step uses, but that the progress is judged by."""
_TURNS = 2
"""Of each crop of a batch."""
_LEAST_JUDGED, _MOST_JUDGED = 4, 256


@dataclasses.dataclass(frozen=True)
class LandmarkTrainingOptions:
    """Options of a training.

    Attributes:
        epochs: passes over the views
        batch: views per step, each in two crops
        seed: of all random numbers
        rate: peak learning rate
        limit_s: wall-clock limit, to which the schedule adapts [s]
    """

    epochs: int = 40
    batch: int = 16
    seed: int = 0
    rate: float = 5e-3
    limit_s: float | None = None


@dataclasses.dataclass(frozen=True)
class LandmarkTrainingProgress:
    """Steps done of how many, accuracy on judged crops, elapsed time [s]."""

    done: int
    total: int
    accuracy: dict[str, float]
    elapsed_s: float


OnLandmarkProgress = Callable[[LandmarkTrainingProgress], None]


def judged_count(count: int) -> int:
    """How many of so many views no step of a training uses."""
    return min(max(round(_JUDGED_SHARE * count), _LEAST_JUDGED), _MOST_JUDGED)


def train_landmark_network(
    views: LandmarkViews,
    backdrops: np.ndarray,
    options: LandmarkTrainingOptions,
    start: Params,
    checkpoint: Path | None = None,
    on_progress: OnLandmarkProgress = lambda progress: None,
) -> tuple[Params, list[LandmarkTrainingProgress]]:
    """Trains a network from `start`; returns the averaged weights, and the progress after each epoch.

    With a checkpoint an interrupted call continues after its last epoch, to the same result.
    """
    trained = len(views) - judged_count(len(views))
    judged = random_crops(views, backdrops, np.arange(trained, len(views)), np.random.default_rng([options.seed, 2]))

    def prepare(chosen: np.ndarray, step: int, progress: float) -> CropBatch:
        del progress
        return random_crops(views, backdrops, chosen, np.random.default_rng([options.seed, 1, step]), _TURNS)

    def judge(params: Params) -> dict[str, Any]:
        return {"accuracy": dataclasses.asdict(crop_accuracy(params, judged))}

    parts = [np.ascontiguousarray(views.codes[:: max(1, len(views) // 50)]), views.places]
    key = training_key(options, len(views), start, parts)
    training = Training(_loss, (), options, trained, prepare)
    return train_by_epochs(training, start, judge, LandmarkTrainingProgress, checkpoint, key, on_progress)


def _loss(params: Params, frozen: Any, key: jax.Array, batch: CropBatch) -> jax.Array:
    del frozen, key
    return landmark_loss(params, batch)
