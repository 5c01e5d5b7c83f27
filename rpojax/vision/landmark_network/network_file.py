"""Files of landmark networks: safetensors in half precision, with a card and the landmarks they belong to."""

import json
from collections.abc import Mapping
from pathlib import Path

import jax
import numpy as np

from rpojax.vision.landmark_network.network import Params, initialize
from rpojax.vision.surface.landmark_file import landmark_digest
from rpojax.vision.surface.landmarks import Landmarks
from rpojax.vision.weight_files import (
    WeightsError,
    check_all_taken,
    packaged_file,
    read_model_card,
    read_tensors,
    take_tensor,
    write_tensors,
)

PACKAGED_NETWORK = "target.pose.safetensors"
"""Name of the network for the landmarks of the packaged target."""
_KIND = "rpojax landmark network 1"


def save_network(params: Params, landmarks: Landmarks, path: Path, card: Mapping[str, object]) -> None:
    """Writes parameters in half precision with their card; the file is replaced as a whole.

    Raises:
        WeightsError: a parameter is not finite in half precision, or the file cannot be written.
    """
    with np.errstate(over="ignore"):  # overflow is an error below
        tensors = {
            f"{layer}.{name}": np.asarray(array).astype(np.float16)
            for layer, values in params.items()
            for name, array in values.items()
        }
    for name, values in tensors.items():
        if not np.isfinite(values).all():
            raise WeightsError(f"{path}: {name}: found a number that is not finite, expected finite weights")
    metadata = {"kind": _KIND, "landmarks": landmark_digest(landmarks), "card": json.dumps(dict(card))}
    write_tensors(path, tensors, metadata)


def load_network(landmarks: Landmarks, path: Path | None = None) -> tuple[Params, dict[str, object]]:
    """Parameters in single precision (default: the packaged ones) of a network for given landmarks, and their card.

    Raises:
        WeightsError: the file is damaged, of another kind, or of a network that finds other landmarks.
    """
    path = packaged_file(PACKAGED_NETWORK) if path is None else path
    tensors, metadata = read_tensors(path)
    if metadata.get("kind") != _KIND:
        found = metadata.get("kind", "")
        raise WeightsError(f"{path}: found kind {found!r}, expected {_KIND!r}, which `rpojax pose train` writes")
    if metadata.get("landmarks") != landmark_digest(landmarks):
        raise WeightsError(f"{path}: found a network for other landmarks, expected one trained on those of the target")
    card = read_model_card(path, metadata)
    count = len(landmarks.positions)
    shapes = jax.eval_shape(lambda: initialize(jax.random.key(0), count))
    params = {
        layer: {
            name: jax.device_put(
                take_tensor(path, tensors, f"{layer}.{name}", like.shape, np.float16).astype(np.float32)
            )
            for name, like in values.items()
        }
        for layer, values in shapes.items()
    }
    check_all_taken(path, tensors)
    return params, card
