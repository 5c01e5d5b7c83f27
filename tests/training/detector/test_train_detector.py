"""Training of both networks, with interruption."""

from pathlib import Path

import jax
import numpy as np
import pytest

from rpojax.training import training_steps
from rpojax.training.detector import evaluate_detector, train_detector, training_loop
from rpojax.training.detector.augmentation import Batch
from rpojax.training.detector.training_options import NetworkTrainingOptions, NetworkTrainingProgress
from rpojax.training.synthetic_data.detection_dataset import DetectionDataset


@pytest.mark.slow
def test_interrupted_training_continues_to_same_weights(rectangles: DetectionDataset, tmp_path: Path) -> None:
    proposal, refinement = (
        NetworkTrainingOptions(epochs=3, batch=16, pieces_share=0.0),
        NetworkTrainingOptions(epochs=2, batch=16, pieces_share=0.0),
    )
    validation = rectangles.subset(np.arange(4))
    whole, _ = train_detector.train(rectangles, validation, proposal, refinement)
    checkpoint, reported = tmp_path / "checkpoint", []

    def report(network: str, step: NetworkTrainingProgress) -> None:
        reported.append((network, step.done))
        if len(reported) in (2, 4):
            raise KeyboardInterrupt

    for _ in range(2):
        with pytest.raises(KeyboardInterrupt):
            train_detector.train(rectangles, validation, proposal, refinement, checkpoint, report)
    resumed, history = train_detector.train(rectangles, validation, proposal, refinement, checkpoint, report)
    assert reported == [("proposal", 2), ("proposal", 4), ("proposal", 6), ("refinement", 2), ("refinement", 4)]
    assert [step.done for step in history["proposal"]] == [2, 4, 6]
    assert [step.done for step in history["refinement"]] == [2, 4]
    for a, b in zip(jax.tree.leaves(resumed), jax.tree.leaves(whole), strict=True):
        # The order of sums over threads is not fixed.
        np.testing.assert_allclose(a, b, atol=1e-3)
    train_detector.remove_checkpoints(checkpoint)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_training_learns_to_detect_rectangles(rectangles: DetectionDataset) -> None:
    refinement = NetworkTrainingOptions(epochs=120, batch=20, pieces_share=0.0)
    params, history = train_detector.train(
        rectangles, rectangles, NetworkTrainingOptions(epochs=80, batch=20), refinement
    )
    assert history["proposal"][0].map50 < 0.1
    assert history["proposal"][-1].map50 > 0.8
    assert history["refinement"][-1].map50_95 > history["proposal"][-1].map50_95
    found = evaluate_detector.detect_images(params, rectangles.images)
    assert evaluate_detector.detection_metrics(found, rectangles)["median_iou"] > 0.8


def test_the_step_of_a_training_is_compiled_once(rectangles: DetectionDataset) -> None:
    def loss(params: dict, frozen: object, key: jax.Array, batch: Batch) -> jax.Array:
        del frozen, key
        return jax.numpy.sum((params["out"]["kernel"] - jax.numpy.mean(batch.images)) ** 2)

    zeros = jax.numpy.zeros((1, 1, 2, 3), jax.numpy.float32)
    start = {"out": {"kernel": zeros, "bias": zeros[0, 0, 0]}}
    options = NetworkTrainingOptions(epochs=3, batch=20, pieces_share=0.0)
    before = training_steps.training_step._cache_size()
    training_loop.train_network(loss, start, (), rectangles, options, lambda _: {"map50": 0.0, "map50_95": 0.0})
    assert training_steps.training_step._cache_size() == before + 1
