"""Detector parameters in safetensors files, in half precision."""

import json
from collections.abc import Mapping
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np

from rpojax.vision.detector.two_stage_detector import DetectorParams, initialize
from rpojax.vision.weight_files import (
    WeightsError,
    check_all_taken,
    packaged_file,
    read_model_card,
    read_tensors,
    take_tensor,
    write_tensors,
)

NAME_IN_FILES = {"proposal": "first", "refinement": "second"}
"""Names of the networks in weight files and model cards."""
PACKAGED_DETECTOR = "detector.safetensors"
KIND_PREFIX = "rpojax detector "
_KIND = f"{KIND_PREFIX}3"


def packaged_detector_path() -> Path:
    """Path of the packaged detector's weights."""
    return packaged_file(PACKAGED_DETECTOR)


def save_detector(params: DetectorParams, path: Path, card: Mapping[str, object]) -> None:
    """Writes parameters in half precision with their model card; the file is replaced as a whole.

    Raises `WeightsError` if a parameter is not finite in half precision.
    """
    with np.errstate(over="ignore"):  # overflow is an error below
        tensors = {
            f"{NAME_IN_FILES[network]}.{layer}.{name}": np.asarray(values[name]).astype(np.float16)
            for network, layers in params.items()
            for layer, values in layers.items()
            for name in values
        }
    for name, values in tensors.items():
        if not np.isfinite(values).all():
            raise WeightsError(f"{path}: {name}: found a number that is not finite, expected finite weights")
    write_tensors(path, tensors, {"kind": _KIND, "card": json.dumps(dict(card))})


def round_to_half_precision(params: DetectorParams) -> DetectorParams:
    """Parameters as read back from a file."""
    return jax.tree.map(lambda values: values.astype(jnp.float16).astype(jnp.float32), params)


def load_detector(path: Path | None = None) -> tuple[DetectorParams, dict[str, object]]:
    """Parameters (default: the packaged ones) and their model card; raises `WeightsError`."""
    source = path or packaged_detector_path()
    tensors, metadata = read_tensors(source)
    if metadata.get("kind") != _KIND:
        found = metadata.get("kind", "")
        expected = f"{_KIND!r}, a detector that `rpojax detector train` of this version wrote"
        raise WeightsError(f"{source}: found kind {found!r}, expected {expected}")
    card = read_model_card(source, metadata)
    shapes = jax.eval_shape(initialize, jax.random.key(0))
    params = {
        network: {
            layer: {
                name: _take_float32(source, tensors, f"{NAME_IN_FILES[network]}.{layer}.{name}", like.shape)
                for name, like in values.items()
            }
            for layer, values in layers.items()
        }
        for network, layers in shapes.items()
    }
    check_all_taken(source, tensors)
    return params, card


def _take_float32(source: Path, tensors: dict[str, np.ndarray], name: str, shape: tuple[int, ...]) -> jax.Array:
    return jax.device_put(take_tensor(source, tensors, name, shape, np.float16).astype(np.float32))
