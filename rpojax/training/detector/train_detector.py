"""Training of the detector: the proposal network on whole images, then the refinement network on its boxes."""

import dataclasses
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from rpojax.training.detector import evaluate_detector, proposal_loss, refinement_loss
from rpojax.training.detector.training_loop import train_network
from rpojax.training.detector.training_options import NetworkTrainingOptions, NetworkTrainingProgress
from rpojax.training.synthetic_data.detection_dataset import DetectionDataset
from rpojax.vision.detector import proposal_network
from rpojax.vision.detector.detector_file import KIND_PREFIX, NAME_IN_FILES
from rpojax.vision.detector.two_stage_detector import DetectorParams, detect, initialize
from rpojax.vision.weight_files import WeightsError, read_model_card, read_tensors

NETWORKS = ("proposal", "refinement")
OnDetectorProgress = Callable[[str, NetworkTrainingProgress], None]
"""Called after every epoch with the name of the network."""


def train(
    data: DetectionDataset,
    validation: DetectionDataset,
    proposal_options: NetworkTrainingOptions,
    refinement_options: NetworkTrainingOptions,
    checkpoint: Path | None = None,
    on_progress: OnDetectorProgress = lambda network, progress: None,
    start: DetectorParams | None = None,
) -> tuple[DetectorParams, dict[str, list[NetworkTrainingProgress]]]:
    """Trains both networks from `start`, by default untrained; returns them, and their progress on `validation`.

    With a checkpoint an interrupted call continues after its last epoch, to the same result.
    """
    start = start or initialize(jax.random.key(proposal_options.seed))
    files = {network: _checkpoint_file(checkpoint, network) if checkpoint else None for network in NETWORKS}

    def evaluate_proposals(params: Any) -> dict[str, Any]:
        found = evaluate_detector.detect_images(params, validation.images, proposal_network.detect)
        return evaluate_detector.detection_metrics(found, validation)

    proposal_params, proposal_history = train_network(
        proposal_loss.proposal_loss,
        start["proposal"],
        (),
        data,
        proposal_options,
        evaluate_proposals,
        files["proposal"],
        partial(on_progress, "proposal"),
    )

    def evaluate_detections(params: Any) -> dict[str, Any]:
        both = {"proposal": proposal_params, "refinement": params}
        found = evaluate_detector.detect_images(both, validation.images, detect)
        return evaluate_detector.detection_metrics(found, validation)

    refinement_params, refinement_history = train_network(
        refinement_loss.refinement_loss,
        start["refinement"],
        proposal_params,
        data,
        refinement_options,
        evaluate_detections,
        files["refinement"],
        partial(on_progress, "refinement"),
    )
    params = {"proposal": proposal_params, "refinement": refinement_params}
    return params, {"proposal": proposal_history, "refinement": refinement_history}


def _checkpoint_file(checkpoint: Path, network: str) -> Path:
    return checkpoint.with_name(f"{checkpoint.name}.{network}")


def remove_checkpoints(checkpoint: Path) -> None:
    """Removes the checkpoints of a finished training."""
    for network in NETWORKS:
        _checkpoint_file(checkpoint, network).unlink(missing_ok=True)


def model_card(
    data: DetectionDataset,
    options: Mapping[str, NetworkTrainingOptions],
    history: Mapping[str, list[NetworkTrainingProgress]],
    metrics: Mapping[str, Any],
    command: str,
) -> dict[str, Any]:
    """Model card of a detector: data, options and duration of its training, and metrics on validation images."""
    return {
        "images": len(data),
        "size_px": int(data.images.shape[1]),
        "recipe": {NAME_IN_FILES[network]: dataclasses.asdict(chosen) for network, chosen in options.items()},
        "steps_done": {NAME_IN_FILES[network]: steps[-1].done if steps else 0 for network, steps in history.items()},
        "training_s": round(sum(steps[-1].elapsed_s for steps in history.values() if steps), 1),
        "held_out": dict(metrics),
        "command": command,
    }


def initial_weights(path: Path | None, seed: int) -> tuple[DetectorParams, dict[str, object]]:
    """Untrained parameters, with the arrays of a detector file where name and shape agree, and its model card.

    A layer is taken whole or not at all.

    Raises:
        WeightsError: the file is no detector, or no layer of it fits.
    """
    params = initialize(jax.random.key(seed))
    if path is None:
        return params, {}
    tensors, metadata = read_tensors(path)
    if not metadata.get("kind", "").startswith(KIND_PREFIX):
        raise WeightsError(f"{path}: found kind {metadata.get('kind', '')!r}, expected a detector to start from")
    taken = 0
    for network, layers in params.items():
        for layer, values in layers.items():
            found = {name: tensors.get(f"{NAME_IN_FILES[network]}.{layer}.{name}") for name in values}
            if all(a is not None and a.shape == values[name].shape for name, a in found.items()):
                layers[layer] = {name: jnp.asarray(np.asarray(a, np.float32)) for name, a in found.items()}
                taken += 1
    if not taken:
        raise WeightsError(f"{path}: found no layer of this version's networks, expected a detector to start from")
    return params, read_model_card(path, metadata)
