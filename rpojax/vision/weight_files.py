"""Weight files: safetensors with a model card, checked for names, shapes, types and size before use."""

from collections.abc import Mapping
from importlib import resources
from pathlib import Path

import numpy as np
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save

from rpojax.errors import RpojaxError
from rpojax.untrusted.file_reading import FileError, FileKind, check_readable
from rpojax.untrusted.json_reading import parse_json
from rpojax.untrusted.structure_limits import StructureError


class WeightsError(RpojaxError):
    """A weight file cannot be used."""


def packaged_file(name: str) -> Path:
    """Path of a weight file that comes with the package."""
    return Path(str(resources.files("rpojax.vision") / "assets" / name))


def write_tensors(path: Path, tensors: Mapping[str, np.ndarray], metadata: Mapping[str, str]) -> None:
    """Writes arrays by name; the file is replaced as a whole."""
    partial = path.with_name(path.name + ".part")
    content = save({name: np.asarray(value, order="C") for name, value in tensors.items()}, dict(metadata))
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        partial.write_bytes(content)
        partial.replace(path)
    except OSError as error:
        raise WeightsError(f"{path}: cannot be written ({error.strerror}), expected a writable place") from None


def read_tensors(path: Path) -> tuple[dict[str, np.ndarray], dict[str, str]]:
    """Arrays and metadata of a file; raises `WeightsError` if it cannot be read as safetensors."""
    try:
        check_readable(path, FileKind.WEIGHTS)
        with safe_open(path, framework="numpy") as content:
            return {name: content.get_tensor(name) for name in content.keys()}, dict(content.metadata() or {})  # noqa: SIM118
    except FileError as error:
        raise WeightsError(f"{path}: cannot be read ({error.found}), expected {error.expected}") from None
    # Types of tensors that NumPy does not know raise errors of many kinds.
    except (OSError, SafetensorError, ValueError, TypeError, KeyError, AttributeError, RecursionError) as error:
        raise WeightsError(f"{path}: cannot be read ({_one_line(error)}), expected weights in safetensors") from None


def read_model_card(source: Path, metadata: Mapping[str, str]) -> dict[str, object]:
    """Model card of a file; raises `WeightsError` if it is no JSON object."""
    try:
        card = parse_json(metadata.get("card", "{}"))
    except StructureError:
        raise WeightsError(f"{source}: found a card that is no JSON, expected an object") from None
    if not isinstance(card, dict):
        raise WeightsError(f"{source}: found a card that is a {type(card).__name__}, expected an object")
    return card


def take_tensor(
    source: Path, tensors: dict[str, np.ndarray], name: str, shape: tuple[int | None, ...], dtype: type
) -> np.ndarray:
    """Removes and returns a tensor of a required shape (None: any length) and type; raises `WeightsError`."""
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
    """Raises `WeightsError` if a file holds more tensors than were taken."""
    if tensors:
        raise WeightsError(f"{source}: found {', '.join(sorted(tensors))}, expected no such tensors")


def _one_line(error: Exception) -> str:
    return " ".join((getattr(error, "strerror", None) or str(error) or type(error).__name__).split())
