"""Training of the detector: the first look at whole pictures, then the second one at the boxes that the first names."""

import dataclasses
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import jax

from rpojax.training.detector import evaluate_detector, proposal_loss, refinement_loss
from rpojax.training.detector.training_loop import NetworkTrainingOptions, NetworkTrainingProgress, train_network
from rpojax.training.synthetic_data.detection_dataset import DetectionDataset
from rpojax.vision.detector import proposal_network
from rpojax.vision.detector.two_stage_detector import DetectorParams, detect, initialize

OnDetectorProgress = Callable[[str, NetworkTrainingProgress], None]
"""Called after every pass with the look that is trained."""


def train(
    data: DetectionDataset,
    validation: DetectionDataset,
    proposal_options: NetworkTrainingOptions,
    refinement_options: NetworkTrainingOptions,
    checkpoint: Path | None = None,
    on_progress: OnDetectorProgress = lambda look, step: None,
    start: DetectorParams | None = None,
) -> tuple[DetectorParams, dict[str, list[NetworkTrainingProgress]]]:
    """Trains both looks on a data set and returns them with the history of checks on another one.

    They begin with the weights `start`, or untrained. With a checkpoint an interrupted call goes on after the last
    finished pass, to the same result.
    """
    start = start or initialize(jax.random.key(proposal_options.seed))
    files = {look: checkpoint and checkpoint.with_name(f"{checkpoint.name}.{look}") for look in start}

    def evaluate_proposals(params: Any) -> dict[str, Any]:
        return evaluate_detector.detection_metrics(
            evaluate_detector.detect_images(params, validation.images, proposal_network.detect), validation
        )

    proposal_params, proposal_history = train_network(
        proposal_loss.proposal_loss,
        start["first"],
        (),
        data,
        proposal_options,
        evaluate_proposals,
        files["first"],
        lambda step: on_progress("first", step),
    )

    def evaluate_detections(params: Any) -> dict[str, Any]:
        both = {"first": proposal_params, "second": params}
        return evaluate_detector.detection_metrics(
            evaluate_detector.detect_images(both, validation.images, detect), validation
        )

    refinement_params, refinement_history = train_network(
        refinement_loss.refinement_loss,
        start["second"],
        proposal_params,
        data,
        refinement_options,
        evaluate_detections,
        files["second"],
        lambda step: on_progress("second", step),
    )
    return {"first": proposal_params, "second": refinement_params}, {
        "first": proposal_history,
        "second": refinement_history,
    }


def remove_checkpoints(checkpoint: Path) -> None:
    """Removes the checkpoints of a training that is over."""
    for look in ("first", "second"):
        checkpoint.with_name(f"{checkpoint.name}.{look}").unlink(missing_ok=True)


def model_card(
    data: DetectionDataset,
    options: Mapping[str, NetworkTrainingOptions],
    history: Mapping[str, list[NetworkTrainingProgress]],
    metrics: Mapping[str, Any],
    command: str,
) -> dict[str, Any]:
    """What to say about a detector: how it was made, and its figures on pictures held out."""
    return {
        "images": len(data),
        "size_px": int(data.images.shape[1]),
        "recipe": {look: dataclasses.asdict(recipe) for look, recipe in options.items()},
        "steps_done": {look: steps[-1].done if steps else 0 for look, steps in history.items()},
        "training_s": round(sum(steps[-1].elapsed_s for steps in history.values() if steps), 1),
        "held_out": dict(metrics),
        "command": command,
    }
