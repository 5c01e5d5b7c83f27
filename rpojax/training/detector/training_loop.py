"""Training of one network of the detector on augmented pictures."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from rpojax.training.detector.augmentation import Batch, augment_batch
from rpojax.training.detector.training_options import (
    NetworkTrainingOptions,
    NetworkTrainingProgress,
    OnNetworkProgress,
)
from rpojax.training.epoch_training import Training, train_by_epochs, training_key
from rpojax.training.synthetic_data.detection_dataset import DetectionDataset
from rpojax.training.training_steps import Loss, Params

Evaluate = Callable[[Params], dict[str, Any]]
"""Metrics of a network's parameters on the validation images."""


def train_network(
    loss: Loss,
    start: Params,
    frozen: Any,
    data: DetectionDataset,
    options: NetworkTrainingOptions,
    evaluate: Evaluate,
    checkpoint: Path | None = None,
    on_progress: OnNetworkProgress = lambda progress: None,
) -> tuple[Params, list[NetworkTrainingProgress]]:
    """Trains a network from `start`; returns the averaged weights, and the progress after each epoch.

    With a checkpoint an interrupted call continues after its last epoch, to the same result. With a time limit the
    learning rate schedule ends at the limit.
    """

    def judge(params: Params) -> dict[str, Any]:
        metrics = evaluate(params)
        return {name: metrics[name] or 0.0 for name in ("map50", "map50_95")}

    training = network_training(loss, frozen, data, options)
    parts = [data.images[:: max(1, len(data) // 50)], np.concatenate(data.boxes)]
    key = training_key(options, len(data), (start, frozen), parts)
    return train_by_epochs(training, start, judge, NetworkTrainingProgress, checkpoint, key, on_progress)


def network_training(
    loss: Loss, frozen: Any, data: DetectionDataset, options: NetworkTrainingOptions
) -> Training[Batch]:
    """Training of a network on batches that are augmented on the host."""

    def prepare(indices: np.ndarray, step: int, clock: float) -> Batch:
        # Whether it is of crops follows the clock some steps later.
        by_steps = step / training.steps
        progress = by_steps if options.limit_s is None else max(by_steps, clock)
        rng = np.random.default_rng([options.seed, 1, step])
        return augment_batch(data, indices, rng, crops=progress < options.pieces_share)

    training = Training(loss, frozen, options, len(data), prepare)
    return training
