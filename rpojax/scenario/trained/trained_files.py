"""Files of trained networks and fitted camera statistics: paths, hashes and loading of the networks."""

import hashlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rpojax.errors import ScenarioError
from rpojax.scenario.sections import NO_LANDMARKS
from rpojax.sensors.rendered_camera import Networks
from rpojax.untrusted.file_reading import FileKind, is_regular, read_bytes
from rpojax.vision import weight_files
from rpojax.vision.detector.detector_file import load_detector
from rpojax.vision.imaging.random_sky import random_sky
from rpojax.vision.landmark_network.network_file import PACKAGED_NETWORK, load_network
from rpojax.vision.radiance_field.field_file import load_field
from rpojax.vision.surface.landmarks import Landmarks

PACKAGED = "packaged"
"""Value of a key of `imaging` that selects the packaged file."""
PACKAGED_FILES = {
    "field": "target.field.safetensors",
    "detector": "detector.safetensors",
    "statistics": "target.camera.safetensors",
    "landmark_network": PACKAGED_NETWORK,
}
"""Packaged file by key of the section `imaging`."""
REQUIRED_KEYS = {"geometric": (), "statistical": ("statistics",), "rendered": ("field", "detector")}
"""Keys of the section `imaging` whose files a camera model reads."""


def required_files(tables: Mapping[str, Any]) -> dict[str, Path]:
    """Paths of the trained files that the camera model of a scenario reads, by key of the section `imaging`.

    Those of a second lens are by the key with its section.
    """
    found = {key: file_path(tables, key) for key in REQUIRED_KEYS[tables["camera"]["model"]]}
    if tables["camera"]["model"] == "rendered" and finds_landmarks(tables):
        found["landmark_network"] = file_path(tables, "landmark_network")
    if (wide := of_wide_lens(tables)) and "statistics" in found:
        found["wide_lens.statistics"] = file_path(wide, "statistics")
    return found


def finds_landmarks(tables: Mapping[str, Any]) -> bool:
    """Whether the camera finds landmarks of the target."""
    return tables["camera"].get("landmarks", NO_LANDMARKS) != NO_LANDMARKS


def of_wide_lens(tables: Mapping[str, Any]) -> dict[str, Any] | None:
    """Tables of a scenario whose camera has its second lens alone, with the statistics of this lens; None without one.

    Without statistics of its own they are the packaged ones.
    """
    lens = tables.get("wide_lens")
    if lens is None:
        return None
    camera = {**tables["camera"], "field_of_view_deg": lens["field_of_view_deg"]}
    imaging = {**tables["imaging"], "statistics": lens.get("statistics") or PACKAGED}
    return {**tables, "camera": camera, "imaging": imaging}


def file_path(tables: Mapping[str, Any], key: str) -> Path:
    """Path of one trained file.

    Raises:
        ScenarioError: there is no such file.
    """
    name = tables["imaging"].get(key, PACKAGED)
    path = _packaged_path(tables, key) if name == PACKAGED else Path(name)
    if not is_regular(path):
        raise ScenarioError(f"imaging.{key}", name, f"'{PACKAGED}' or the path of a file")
    return path


def _packaged_path(tables: Mapping[str, Any], key: str) -> Path:
    """Path of a packaged file; statistics of the camera are those for its pixels and lens, where there are some."""
    path = weight_files.packaged_file(PACKAGED_FILES[key])
    if key != "statistics":
        return path
    camera = tables["camera"]
    of_camera = path.with_name(f"target.camera.{camera['width_px']}px_{camera['field_of_view_deg']:g}deg.safetensors")
    return of_camera if of_camera.is_file() else path


def required_digests(tables: Mapping[str, Any]) -> dict[str, str]:
    """SHA-256 of the trained files that the camera model of a scenario reads."""
    return {key: file_digest(path) for key, path in required_files(tables).items()}


def file_digest(path: Path) -> str:
    """SHA-256 of a file of weights or of a mesh.

    Raises:
        FileError: it cannot be read, or is too large.
    """
    return hashlib.sha256(read_bytes(path, FileKind.WEIGHTS)).hexdigest()


def networks_for_model(tables: Mapping[str, Any], landmarks: Landmarks | None = None) -> Networks | None:
    """Radiance field, detector and sky of a rendered camera, and the network for its landmarks; None for other cameras.

    Raises:
        WeightsError: a file is damaged, or the network is one for other landmarks.
    """
    return load_networks(tables, landmarks) if tables["camera"]["model"] == "rendered" else None


def load_networks(tables: Mapping[str, Any], landmarks: Landmarks | None = None) -> Networks:
    """Radiance field, detector and sky, for any camera model, and the network for landmarks.

    Raises:
        WeightsError: a file is damaged, or the network is one for other landmarks.
    """
    path = None if landmarks is None else file_path(tables, "landmark_network")
    return Networks(
        field=load_field(file_path(tables, "field"))[0],
        detector=load_detector(file_path(tables, "detector"))[0],
        sky=random_sky(tables["imaging"]["sky_seed"]),
        landmarks=None if path is None or landmarks is None else load_network(landmarks, path)[0],
    )
