"""Files of fitted statistical cameras: safetensors with a model card, checked before use."""

import itertools
import json
from collections.abc import Mapping
from pathlib import Path

import jax
import numpy as np
from jaxtyping import Array

from rpojax.sensors.statistical_camera import OUTPUT_COUNT, CameraStatistics
from rpojax.sensors.view_features import FEATURE_COUNT
from rpojax.vision.weight_files import (
    WeightsError,
    check_all_taken,
    read_model_card,
    read_tensors,
    take_tensor,
    write_tensors,
)

LAYER_WIDTHS = (FEATURE_COUNT, 32, 32, OUTPUT_COUNT)
"""Widths of the network between features and the parameters of the distribution. A choice."""
_FILE_KIND = "rpojax camera 3"
_SHAPES = {
    "mean": (FEATURE_COUNT,),
    "spread": (FEATURE_COUNT,),
    "wide_share": (),
    "mixing": (4, 4),
    "lasting_share": (),
    "lasting_angle": (),
    "false_log_side": (2,),
    "false_score": (2,),
}
_POSITIVE = ("spread", "lasting_angle")


def save_statistics(statistics: CameraStatistics, path: Path, card: Mapping[str, object]) -> None:
    """Writes a fitted camera with its model card atomically."""
    tensors = {name: np.asarray(getattr(statistics, name)) for name in _SHAPES}
    for index, (weight, bias) in enumerate(statistics.layers):
        tensors[f"layers.{index}.weight"], tensors[f"layers.{index}.bias"] = np.asarray(weight), np.asarray(bias)
    write_tensors(path, tensors, {"kind": _FILE_KIND, "card": json.dumps(dict(card))})


def load_statistics(path: Path) -> tuple[CameraStatistics, dict[str, object]]:
    """Fitted camera and its model card.

    Raises:
        WeightsError: the file is damaged or of another kind.
    """
    tensors, metadata = read_tensors(path)
    if metadata.get("kind") != _FILE_KIND:
        found = metadata.get("kind", "")
        raise WeightsError(f"{path}: found kind {found!r}, expected what `rpojax calibrate-camera-model` wrote")
    card = read_model_card(path, metadata)

    def tensor(name: str, *shape: int) -> Array:
        return jax.device_put(take_tensor(path, tensors, name, shape, np.float32))

    statistics = CameraStatistics(
        **{name: tensor(name, *shape) for name, shape in _SHAPES.items()},
        layers=tuple(
            (tensor(f"layers.{i}.weight", fan_in, fan_out), tensor(f"layers.{i}.bias", fan_out))
            for i, (fan_in, fan_out) in enumerate(itertools.pairwise(LAYER_WIDTHS))
        ),
    )
    check_all_taken(path, tensors)
    for name in _POSITIVE:
        if not np.all(np.asarray(getattr(statistics, name)) > 0.0):
            raise WeightsError(f"{path}: {name}: found a number that is not positive, expected positive numbers")
    return statistics, card
