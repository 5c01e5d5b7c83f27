"""Files of landmarks: safetensors with a card, checked before use."""

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path

import jax.numpy as jnp
import numpy as np

from rpojax.vision.surface.landmarks import Landmarks
from rpojax.vision.surface.visibility_table import CELLS
from rpojax.vision.weight_files import (
    WeightsError,
    check_all_taken,
    packaged_file,
    read_model_card,
    read_tensors,
    take_tensor,
    write_tensors,
)

PACKAGED_LANDMARKS = "target.landmarks.safetensors"
"""Name of the landmarks of the packaged target."""
_FILE_KIND = "rpojax landmarks 1"
_UNIT_TOLERANCE = 1e-6
_DIGEST_DECIMALS = 6
"""Of places [m] in their digest."""


def landmark_path(path: Path | None) -> Path:
    """Path of a file of landmarks, by default that of the packaged target."""
    return packaged_file(PACKAGED_LANDMARKS) if path is None else path


def save_landmarks(landmarks: Landmarks, path: Path, card: Mapping[str, object]) -> None:
    """Writes landmarks with their card; the file is replaced as a whole."""
    tensors = {name: np.asarray(value) for name, value in vars(landmarks).items() if value is not None}
    write_tensors(path, tensors, {"kind": _FILE_KIND, "card": json.dumps(dict(card))})


def landmark_digest(landmarks: Landmarks) -> str:
    """Digest of the places of landmarks and their order, which tells what a network that finds them belongs to."""
    places = np.round(np.asarray(landmarks.positions, dtype=np.float64), _DIGEST_DECIMALS) + 0.0
    return hashlib.sha256(np.ascontiguousarray(places).tobytes()).hexdigest()


def load_landmarks(path: Path | None = None) -> tuple[Landmarks, dict[str, object]]:
    """Landmarks of a file, by default of the packaged target, and their card.

    Raises:
        WeightsError: the file is damaged or of another kind, or holds landmarks that cannot be seen.
    """
    path = landmark_path(path)
    tensors, metadata = read_tensors(path)
    if metadata.get("kind") != _FILE_KIND:
        found = metadata.get("kind", "")
        raise WeightsError(f"{path}: found kind {found!r}, expected what `rpojax landmarks` wrote")
    card = read_model_card(path, metadata)
    positions = take_tensor(path, tensors, "positions", (None, 3), np.float64)
    symmetries = take_tensor(path, tensors, "symmetries", (None, 4), np.float64)
    count, motions = len(positions), len(symmetries)
    arrays = {
        "positions": positions,
        "normals": take_tensor(path, tensors, "normals", (count, 3), np.float64),
        "visible": take_tensor(path, tensors, "visible", (CELLS * CELLS, count), np.bool_),
        "symmetries": symmetries,
        "shifts": take_tensor(path, tensors, "shifts", (motions, 3), np.float64),
        "permutations": take_tensor(path, tensors, "permutations", (motions, count), np.int32),
    }
    port = {}
    if "port_position" in tensors or "port_axis" in tensors:
        port = {name: take_tensor(path, tensors, name, (3,), np.float64) for name in ("port_position", "port_axis")}
    check_all_taken(path, tensors)
    _check(path, {**arrays, **port})
    placed = {name: jnp.asarray(each) for name, each in arrays.items()}
    return Landmarks(
        **placed,
        port_position=jnp.asarray(port["port_position"]) if port else None,
        port_axis=jnp.asarray(port["port_axis"]) if port else None,
    ), card


def _check(path: Path, known: Mapping[str, np.ndarray]) -> None:
    """Raises `WeightsError` on numbers that no landmarks have."""
    count = len(known["positions"])
    if not count or not len(known["symmetries"]):
        raise WeightsError(f"{path}: found no landmarks or no symmetry, expected landmarks and that of no turn")
    for name in ("normals", "symmetries", "port_axis"):
        lengths = np.linalg.norm(np.atleast_2d(known.get(name, np.eye(3)[0])), axis=1)
        if np.abs(lengths - 1.0).max() > _UNIT_TOLERANCE:
            raise WeightsError(f"{path}: {name}: found a vector that is not of unit length, expected unit vectors")
    if not (np.sort(known["permutations"], axis=1) == np.arange(count)).all():
        raise WeightsError(f"{path}: permutations: found a row that is none, expected each number once")
    if not (known["permutations"][0] == np.arange(count)).all():
        raise WeightsError(
            f"{path}: permutations: found a first row that exchanges landmarks, expected that of no turn"
        )
    hidden = np.flatnonzero(~known["visible"].any(axis=0))
    if len(hidden):
        numbers = ", ".join(map(str, hidden))
        raise WeightsError(f"{path}: found landmarks inside of the body ({numbers}), expected ones that can be seen")
