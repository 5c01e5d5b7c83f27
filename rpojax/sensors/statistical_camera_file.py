"""Files of fitted statistical cameras: safetensors with a model card, checked before use."""

import itertools
import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import jax
import numpy as np
from jaxtyping import Array

from rpojax.sensors.statistical_camera import OUTPUT_COUNT, CameraStatistics
from rpojax.sensors.statistical_landmarks import LandmarkStatistics
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
_LANDMARK_SHAPES = {
    "mean": (FEATURE_COUNT,),
    "spread": (FEATURE_COUNT,),
    "error_scale": (),
    "tail": (),
    "lasting_share": (),
    "lasting_angle": (),
    "false_turn": (4,),
}
_POSITIVE = ("spread", "lasting_angle", "error_scale", "tail")
_LANDMARKS = "landmarks."


def save_statistics(statistics: CameraStatistics, path: Path, card: Mapping[str, object]) -> None:
    """Writes a fitted camera with its model card atomically."""
    tensors = _tensors(statistics, _SHAPES, "")
    if statistics.landmarks is not None:
        tensors |= _tensors(statistics.landmarks, _LANDMARK_SHAPES, _LANDMARKS)
    write_tensors(path, tensors, {"kind": _FILE_KIND, "card": json.dumps(dict(card))})


def _tensors(part: Any, names: Iterable[str], prefix: str) -> dict[str, np.ndarray]:
    """Arrays of these names, and those of the layers, by name in the file."""
    found = {f"{prefix}{name}": np.asarray(getattr(part, name)) for name in names}
    for index, (weight, bias) in enumerate(part.layers):
        found[f"{prefix}layers.{index}.weight"] = np.asarray(weight)
        found[f"{prefix}layers.{index}.bias"] = np.asarray(bias)
    return found


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

    def fields(prefix: str, shapes: Mapping[str, tuple[int, ...]], outputs: int) -> dict[str, Any]:
        def tensor(name: str, *shape: int) -> Array:
            return jax.device_put(take_tensor(path, tensors, f"{prefix}{name}", shape, np.float32))

        widths = (*LAYER_WIDTHS[:-1], outputs)
        layers = tuple(
            (tensor(f"layers.{i}.weight", fan_in, fan_out), tensor(f"layers.{i}.bias", fan_out))
            for i, (fan_in, fan_out) in enumerate(itertools.pairwise(widths))
        )
        found = {name: tensor(name, *shape) for name, shape in shapes.items()}
        for name in _POSITIVE:
            if name in found and not np.all(np.asarray(found[name]) > 0.0):
                raise WeightsError(
                    f"{path}: {prefix}{name}: found a number that is not positive, expected positive numbers"
                )
        return {**found, "layers": layers}

    last, landmarks = tensors.get(f"{_LANDMARKS}layers.{len(LAYER_WIDTHS) - 2}.bias"), None
    if last is not None:
        landmarks = LandmarkStatistics(**fields(_LANDMARKS, _LANDMARK_SHAPES, last.size))
    statistics = CameraStatistics(**fields("", _SHAPES, OUTPUT_COUNT), landmarks=landmarks)
    check_all_taken(path, tensors)
    return statistics, card
