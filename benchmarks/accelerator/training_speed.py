"""Training steps of the detector's proposal network, and the augmentation of their images on the host."""

import time
from collections.abc import Iterator
from typing import Any

import jax
import numpy as np

from benchmarks.accelerator import memory
from benchmarks.accelerator.sizes import Sizes
from rpojax.training.detector import proposal_loss
from rpojax.training.detector.training_loop import network_training, train_network
from rpojax.training.detector.training_options import NetworkTrainingOptions
from rpojax.training.synthetic_data.detection_dataset import DetectionDataset
from rpojax.training.training_steps import BatchPrefetcher
from rpojax.vision.detector.two_stage_detector import initialize

_SIDE_PX = 128
_EPOCHS = 3
"""The first one compiles, the others are timed."""


def measure(sizes: Sizes) -> Iterator[dict[str, Any]]:
    """One entry: a training step with its augmentation, the augmentation alone, compilation."""
    yield memory.measured_or_reason(
        lambda: _figures(sizes.training_batch, sizes.training_steps), batch=sizes.training_batch
    )


def _figures(batch: int, steps: int) -> dict[str, Any]:
    data = bright_rectangles(batch * steps)
    options = NetworkTrainingOptions(epochs=_EPOCHS, batch=batch, pieces_share=0.0)
    start = initialize(jax.random.key(0))["proposal"]
    unscored = {"map50": 0.0, "map50_95": 0.0}
    _, history = train_network(proposal_loss.proposal_loss, start, (), data, options, lambda _: unscored)
    step_s = (history[-1].elapsed_s - history[0].elapsed_s) / (history[-1].done - history[0].done)
    return {
        "step_s": step_s,
        "images_per_s": batch / step_s,
        "augmentation_s": _augmentation_s(data, options, steps),
        "compile_s": max(0.0, history[0].elapsed_s - steps * step_s),
        "peak_device_bytes": memory.peak_bytes(),
    }


def _augmentation_s(data: DetectionDataset, options: NetworkTrainingOptions, steps: int) -> float:
    """Time that the host takes for the images of a step [s]."""
    training = network_training(proposal_loss.proposal_loss, (), data, options)
    begin = time.perf_counter()
    with BatchPrefetcher(training.batch, 0, 0.0) as batches:
        for _ in range(steps):
            batches.next()
        return (time.perf_counter() - begin) / steps


def bright_rectangles(count: int) -> DetectionDataset:
    """Images with a bright rectangle on black, which take as long to train on as others."""
    rng = np.random.default_rng(0)
    images, boxes = np.zeros((count, _SIDE_PX, _SIDE_PX, 3), np.uint8), []
    for image in images:
        (left, top), (width, height) = rng.integers(0, _SIDE_PX // 2, 2), rng.integers(12, _SIDE_PX // 2, 2)
        image[top : top + height, left : left + width] = rng.integers(120, 256, 3)
        boxes.append(np.array([[left, top, left + width, top + height]], np.float32))
    return DetectionDataset(images, tuple(boxes), ("black",) * count)
