"""Weights in files: safetensors, checked for names, shapes, types and size before use."""

import json
import math
from collections.abc import Mapping
from importlib import resources
from pathlib import Path

import jax.numpy as jnp
import numpy as np

from rpojax.errors import RpojaxError
from rpojax.vision.radiance_field.grid_field import (
    LATENT_SIZE,
    SHADING_INPUTS,
    GridField,
    number_near_nodes,
    with_occupancy,
)
from rpojax.vision.radiance_field.nerf_field import FREQUENCIES, NerfField
from rpojax.vision.radiance_field.target_field import RadianceField

SIZE_LIMIT = 64 * 1024 * 1024
PACKAGED_FIELD = "target.field.safetensors"
_KIND = "rpojax field 1"
_NODE_LIMIT = 50_000_000


class WeightsError(RpojaxError):
    """A file of weights cannot be used."""


def packaged_file(name: str) -> Path:
    """Path of a file that comes with the package."""
    return Path(str(resources.files("rpojax.vision") / "assets" / name))


def packaged_field_path() -> Path:
    """Path of the packaged target's field."""
    return packaged_file(PACKAGED_FIELD)


def save_field(field: RadianceField, path: Path, card: Mapping[str, object]) -> None:
    """Writes a field in half precision with its card; the file is either whole or as it was before."""
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


def write_tensors(path: Path, tensors: Mapping[str, np.ndarray], metadata: Mapping[str, str]) -> None:
    """Writes arrays by name; the file is either whole or as it was before."""
    from safetensors.numpy import save

    partial = path.with_name(path.name + ".part")
    content = save({name: np.asarray(value, order="C") for name, value in tensors.items()}, dict(metadata))
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        partial.write_bytes(content)
        partial.replace(path)
    except OSError as error:
        raise WeightsError(f"{path}: cannot be written ({error.strerror}), expected a writable place") from None


def read_tensors(path: Path) -> tuple[dict[str, np.ndarray], dict[str, str]]:
    """Arrays and metadata of a file; raises `WeightsError` where it is none of safetensors."""
    from safetensors import SafetensorError, safe_open

    try:
        size = path.stat().st_size
        if size > SIZE_LIMIT:
            raise WeightsError(f"{path}: found {size} bytes, expected at most {SIZE_LIMIT}")
        with safe_open(path, framework="numpy") as content:
            return {name: content.get_tensor(name) for name in content.keys()}, dict(content.metadata() or {})  # noqa: SIM118
    except (OSError, SafetensorError, ValueError, TypeError, KeyError) as error:
        raise WeightsError(f"{path}: cannot be read ({_one_line(error)}), expected weights in safetensors") from None


def read_model_card(source: Path, metadata: Mapping[str, str]) -> dict[str, object]:
    """What a file says of itself; raises `WeightsError` where that is no JSON object."""
    try:
        card = json.loads(metadata.get("card", "{}"))
    except ValueError:
        raise WeightsError(f"{source}: found a card that is no JSON, expected an object") from None
    if not isinstance(card, dict):
        raise WeightsError(f"{source}: found a card that is a {type(card).__name__}, expected an object")
    return card


def load_field(path: Path | None = None) -> tuple[RadianceField, dict[str, object]]:
    """A field (default: the packaged target's) and its card; raises `WeightsError` for a damaged or foreign file."""
    source = path or packaged_field_path()
    tensors, metadata = read_tensors(source)
    kind = metadata.get("kind", "")
    if kind not in (f"{_KIND} grid", f"{_KIND} point"):
        raise WeightsError(f"{source}: found kind {kind!r}, expected a field that `rpojax field train` wrote")
    card = read_model_card(source, metadata)
    field = _grid_field(source, tensors) if kind.endswith("grid") else _nerf_field(source, tensors)
    return field, card


def _grid_field(source: Path, tensors: dict[str, np.ndarray]) -> GridField:
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
        low=jnp.asarray(low),
        spacing=jnp.asarray(spacing),
        node_row=jnp.asarray(number_near_nodes(near_surface)),
        occupancy=jnp.zeros(tuple(int(n) for n in shape), jnp.float32),
        raw_density=jnp.asarray(take_tensor(source, tensors, "matter", (rows,), np.float16).astype(np.float32)),
        features=jnp.asarray(
            take_tensor(source, tensors, "features", (rows, 3 + LATENT_SIZE), np.float16).astype(np.float32)
        ),
        network=_take_layers(source, tensors, "network", 3, SHADING_INPUTS, 3),
    )
    check_all_taken(source, tensors)
    return with_occupancy(field)


def _nerf_field(source: Path, tensors: dict[str, np.ndarray]) -> NerfField:
    low, high = (take_tensor(source, tensors, name, (3,), np.float32) for name in ("low", "high"))
    if not (low < high).all():
        raise WeightsError(f"{source}: low, high: found {low.tolist()} and {high.tolist()}, expected a box")
    trunk = _take_layers(source, tensors, "trunk", 5, 3 + 6 * FREQUENCIES, None)
    head_inputs = len(trunk[-1][1]) - 1 + 6
    field = NerfField(
        low=jnp.asarray(low),
        high=jnp.asarray(high),
        trunk=trunk,
        head=_take_layers(source, tensors, "head", 2, head_inputs, 3),
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
        layers.append((jnp.asarray(weight.astype(np.float32)), jnp.asarray(bias.astype(np.float32))))
    return tuple(layers)


def take_tensor(
    source: Path, tensors: dict[str, np.ndarray], name: str, shape: tuple[int | None, ...], dtype: type
) -> np.ndarray:
    """Removes and returns a tensor of the shape (None: any length) and type that it must have."""
    if name not in tensors:
        raise WeightsError(f"{source}: {name}: missing, expected {np.dtype(dtype)} {shape}")
    found = tensors.pop(name)
    fits = len(found.shape) == len(shape) and all(e in (None, f) for f, e in zip(found.shape, shape, strict=True))
    if not fits or found.dtype != dtype:
        raise WeightsError(f"{source}: {name}: found {found.dtype} {found.shape}, expected {np.dtype(dtype)} {shape}")
    if not np.isfinite(found).all():
        raise WeightsError(f"{source}: {name}: found a number that is not finite, expected finite weights")
    return found


def check_all_taken(source: Path, tensors: dict[str, np.ndarray]) -> None:
    """Raises `WeightsError` where a file holds more tensors than were taken."""
    if tensors:
        raise WeightsError(f"{source}: found {', '.join(sorted(tensors))}, expected no such tensors")


def _one_line(error: Exception) -> str:
    return " ".join((getattr(error, "strerror", None) or str(error) or type(error).__name__).split())
