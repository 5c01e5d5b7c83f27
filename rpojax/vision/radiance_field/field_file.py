"""Radiance fields in safetensors files, in half precision."""

import json
import math
from collections.abc import Mapping
from pathlib import Path

import jax
import numpy as np

from rpojax.vision.radiance_field.deferred_shading import FILL_INPUTS, MATERIAL_OUTPUTS, SHADING_INPUTS
from rpojax.vision.radiance_field.grid_field import LATENT_SIZE, GridField, number_near_nodes
from rpojax.vision.radiance_field.nerf_field import FREQUENCIES, NerfField
from rpojax.vision.radiance_field.occupancy_sampling import with_occupancy
from rpojax.vision.radiance_field.target_field import RadianceField
from rpojax.vision.weight_files import (
    WeightsError,
    check_all_taken,
    packaged_file,
    read_model_card,
    read_tensors,
    take_tensor,
    write_tensors,
)

PACKAGED_FIELD = "target.field.safetensors"
_KIND = "rpojax field 2"
_NODE_LIMIT = 50_000_000


def packaged_field_path() -> Path:
    """Path of the field of the packaged target."""
    return packaged_file(PACKAGED_FIELD)


def save_field(field: RadianceField, path: Path, card: Mapping[str, object]) -> None:
    """Writes a field with its model card; the file is replaced as a whole."""
    if isinstance(field, GridField):
        near_surface = np.asarray(field.node_row) > 0
        tensors = {
            "low": np.asarray(field.low),
            "spacing": np.asarray(field.spacing),
            "shape": np.asarray(near_surface.shape, np.int32),
            "near": np.packbits(near_surface.reshape(-1)),
            "matter": np.asarray(field.raw_density).astype(np.float16),
            "features": np.asarray(field.features).astype(np.float16),
            **_layer_tensors("network", field.network),
            **_layer_tensors("material", field.material),
            **_layer_tensors("fill_network", field.fill_network),
        }
    else:
        tensors = {
            "low": np.asarray(field.low),
            "high": np.asarray(field.high),
            **_layer_tensors("trunk", field.trunk),
            **_layer_tensors("head", field.head),
        }
    kind = "grid" if isinstance(field, GridField) else "point"
    write_tensors(path, tensors, {"kind": f"{_KIND} {kind}", "card": json.dumps(dict(card))})


def load_field(path: Path | None = None) -> tuple[RadianceField, dict[str, object]]:
    """A field (default: that of the packaged target) and its model card; raises `WeightsError`."""
    source = path or packaged_field_path()
    tensors, metadata = read_tensors(source)
    kind = metadata.get("kind", "")
    if kind not in (f"{_KIND} grid", f"{_KIND} point"):
        raise WeightsError(f"{source}: found kind {kind!r}, expected a field that `rpojax field train` wrote")
    card = read_model_card(source, metadata)
    field = _read_grid_field(source, tensors) if kind.endswith("grid") else _read_nerf_field(source, tensors)
    return field, card


def _read_grid_field(source: Path, tensors: dict[str, np.ndarray]) -> GridField:
    shape = take_tensor(source, tensors, "shape", (3,), np.int32)
    nodes = math.prod(int(n) for n in shape)
    if not (shape >= 2).all() or nodes > _NODE_LIMIT:
        raise WeightsError(f"{source}: shape: found {shape.tolist()}, expected at most {_NODE_LIMIT} nodes")
    bits = take_tensor(source, tensors, "near", (-(-nodes // 8),), np.uint8)
    near_surface = np.unpackbits(bits)[:nodes].astype(bool).reshape(tuple(shape))
    rows = int(near_surface.sum()) + 1
    low, spacing = (
        take_tensor(source, tensors, "low", (3,), np.float32),
        take_tensor(source, tensors, "spacing", (), np.float32),
    )
    if not spacing > 0.0:
        raise WeightsError(f"{source}: spacing: found {spacing}, expected a positive number")
    field = GridField(
        low=jax.device_put(low),
        spacing=jax.device_put(spacing),
        node_row=jax.device_put(number_near_nodes(near_surface)),
        occupancy=jax.device_put(np.zeros(near_surface.shape, np.float32)),
        raw_density=jax.device_put(take_tensor(source, tensors, "matter", (rows,), np.float16).astype(np.float32)),
        features=jax.device_put(
            take_tensor(source, tensors, "features", (rows, 3 + LATENT_SIZE), np.float16).astype(np.float32)
        ),
        network=_take_layers(source, tensors, "network", 3, SHADING_INPUTS, 3),
        material=_take_layers(source, tensors, "material", 1, LATENT_SIZE, MATERIAL_OUTPUTS),
        fill_network=_take_layers(source, tensors, "fill_network", 2, FILL_INPUTS, 3),
    )
    check_all_taken(source, tensors)
    return with_occupancy(field)


def _read_nerf_field(source: Path, tensors: dict[str, np.ndarray]) -> NerfField:
    low, high = (take_tensor(source, tensors, name, (3,), np.float32) for name in ("low", "high"))
    if not (low < high).all():
        raise WeightsError(f"{source}: low, high: found {low.tolist()} and {high.tolist()}, expected a box")
    trunk = _take_layers(source, tensors, "trunk", 5, 3 + 6 * FREQUENCIES, None)
    head_inputs = len(trunk[-1][1]) - 1 + 9
    field = NerfField(
        low=jax.device_put(low),
        high=jax.device_put(high),
        trunk=trunk,
        head=_take_layers(source, tensors, "head", 2, head_inputs, 6),
    )
    check_all_taken(source, tensors)
    return field


def _layer_tensors(name: str, layers: tuple[tuple[object, object], ...]) -> dict[str, np.ndarray]:
    tensors = {}
    for index, (weight, bias) in enumerate(layers):
        tensors[f"{name}.{index}.weight"] = np.asarray(weight).astype(np.float16)
        tensors[f"{name}.{index}.bias"] = np.asarray(bias).astype(np.float16)
    return tensors


def _take_layers(
    source: Path, tensors: dict[str, np.ndarray], name: str, count: int, inputs: int, outputs: int | None
) -> tuple:
    layers = []
    for index in range(count):
        width = outputs if index == count - 1 else None
        bias = take_tensor(source, tensors, f"{name}.{index}.bias", (width,), np.float16)
        before = len(layers[-1][1]) if layers else inputs
        weight = take_tensor(source, tensors, f"{name}.{index}.weight", (before, len(bias)), np.float16)
        layers.append((jax.device_put(weight.astype(np.float32)), jax.device_put(bias.astype(np.float32))))
    return tuple(layers)
