"""Initial weights of a training from the file of another detector, also one of another layout."""

from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np

from rpojax.vision.detector.detector_file import KIND_PREFIX, NAME_IN_FILES
from rpojax.vision.detector.two_stage_detector import DetectorParams, initialize
from rpojax.vision.weight_files import WeightsError, read_model_card, read_tensors


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
