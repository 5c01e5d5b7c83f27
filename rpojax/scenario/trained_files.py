"""The trained files that a scenario's camera model needs: where they are, their content, how finely to sample."""

import functools
import hashlib
import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rpojax.errors import ScenarioError

if TYPE_CHECKING:
    from rpojax.sensors.rendered_camera import Networks
    from rpojax.sensors.statistical_camera import CameraStatistics
    from rpojax.vision.radiance_field.ray_budget import RaySampling

PACKAGED = "packaged"
PACKAGED_FILES = {
    "field": "target.field.safetensors",
    "detector": "detector.safetensors",
    "statistics": "target.camera.safetensors",
}
"""Keys of the section `imaging` that name a file, and the packaged ones."""
RANGE_KEY = "range of start and station [m]"
_REQUIRED_KEYS = {"geometric": (), "statistical": ("statistics",), "rendered": ("field", "detector")}
_RANGE_MARGIN = 0.8
"""Rays are at least as dense as pixels down to this share of the nearest of start and station."""
_CAMERA_KEYS = ("width_px", "height_px", "field_of_view_deg")
_IMAGING_KEYS = ("exposure", "full_well", "read_noise", "blur_px", "score_threshold")


def required_files(tables: Mapping[str, Any]) -> dict[str, Path]:
    """Trained files that the scenario's camera model needs, by key of the section `imaging`."""
    return {key: file_path(tables, key) for key in _REQUIRED_KEYS[tables["camera"]["model"]]}


def file_path(tables: Mapping[str, Any], key: str) -> Path:
    """Path of one trained file; raises `ScenarioError` where there is none."""
    from rpojax.vision import weight_files

    name = tables["imaging"][key]
    path = weight_files.packaged_file(PACKAGED_FILES[key]) if name == PACKAGED else Path(name)
    if not path.is_file():
        raise ScenarioError(f"imaging.{key}", name, f"'{PACKAGED}' or the path of a file")
    return path


def required_digests(tables: Mapping[str, Any]) -> dict[str, str]:
    """SHA-256 of every trained file that counts."""
    return {key: file_digest(path) for key, path in required_files(tables).items()}


def file_digest(path: Path) -> str:
    """SHA-256 of a file."""
    return hashlib.sha256(path.read_bytes()).hexdigest()


def networks_for_model(tables: Mapping[str, Any]) -> "Networks | None":
    """What pictures are made with and looked at with, or None for a camera model without pictures."""
    if tables["camera"]["model"] != "rendered":
        return None
    return load_networks(tables)


def load_networks(tables: Mapping[str, Any]) -> "Networks":
    """Field, detector and sky, whatever the camera model."""
    from rpojax.sensors.rendered_camera import Networks
    from rpojax.vision.detector.two_stage_detector import load_detector
    from rpojax.vision.imaging.stars_and_earth import random_sky
    from rpojax.vision.weight_files import load_field

    return Networks(
        field=load_field(file_path(tables, "field"))[0],
        detector=load_detector(file_path(tables, "detector"))[0],
        sky=random_sky(tables["imaging"]["sky_seed"]),
    )


def fitted_for(tables: Mapping[str, Any]) -> dict[str, Any]:
    """What of a scenario a fitted camera depends on."""
    camera = {f"camera.{key}": tables["camera"][key] for key in _CAMERA_KEYS}
    imaging = {f"imaging.{key}": tables["imaging"][key] for key in _IMAGING_KEYS}
    return {**camera, **imaging, "target.hull_m": tables["target"]["hull_m"]}


def made_with(tables: Mapping[str, Any]) -> dict[str, str]:
    """SHA-256 of the files whose pictures and boxes a fitted camera is like, by key."""
    return {f"imaging.{key}": file_digest(file_path(tables, key)) for key in _REQUIRED_KEYS["rendered"]}


def view_limits(tables: Mapping[str, Any]) -> dict[str, tuple[float, float]]:
    """What a scenario asks of a fitted camera's views: smallest and largest value by key."""
    camera = tables["camera"]
    return {
        RANGE_KEY: range_limits(tables),
        "camera.phase_limit_deg": (0.0, camera["phase_limit_deg"]),
        "camera.sun_exclusion_deg": (camera["sun_exclusion_deg"], 180.0),
    }


def statistics_for_model(tables: Mapping[str, Any]) -> "CameraStatistics | None":
    """The fitted camera, or None for another camera model; raises `ScenarioError` where it was fitted for another."""
    if tables["camera"]["model"] != "statistical":
        return None
    from rpojax.sensors import statistical_camera_file

    statistics, card = statistical_camera_file.load_statistics(file_path(tables, "statistics"))
    known = card.get("fitted_for")
    for key, value in fitted_for(tables).items():
        found = known.get(key) if isinstance(known, dict) else None
        if json.dumps(found) != json.dumps(value):
            raise ScenarioError(
                key, value, f"{found}, as in imaging.statistics; `rpojax calibrate-camera-model` fits another"
            )
    _check_card(tables, card)
    return statistics


def _check_card(tables: Mapping[str, Any], card: Mapping[str, Any]) -> None:
    """Raises `ScenarioError` where a camera was fitted for other networks, or views are not among those it was."""
    advice = "`rpojax calibrate-camera-model` fits another"
    networks, views = card.get("made_with"), card.get("limits")
    for key, value in made_with(tables).items():
        found = networks.get(key) if isinstance(networks, dict) else None
        if found != value:
            name = tables["imaging"][key.partition(".")[2]]
            raise ScenarioError(key, name, f"the file that imaging.statistics was fitted with; {advice}")
    for key, (low, high) in view_limits(tables).items():
        found = views.get(key) if isinstance(views, dict) else None
        if not found or low < found[0] or high > found[1]:
            raise ScenarioError(key, (low, high), f"within {found}, as in imaging.statistics; {advice}")


def sampling_for_model(tables: Mapping[str, Any]) -> "RaySampling | None":
    """How finely the target is sampled, or None for a camera model without pictures."""
    return picture_sampling(tables) if tables["camera"]["model"] == "rendered" else None


def picture_sampling(tables: Mapping[str, Any]) -> "RaySampling":
    """How finely pictures sample the target, for the ranges that the scenario is about."""
    from rpojax.sensors import rendered_camera

    camera = tables["camera"]
    focal = 0.5 * camera["width_px"] / math.tan(math.radians(0.5 * camera["field_of_view_deg"]))
    least = _RANGE_MARGIN * range_limits(tables)[0]
    if max(camera["width_px"], camera["height_px"]) > rendered_camera.MAX_INPUT_PX:
        # Nearer than this, a window of a large frame is binned so that the target stays as small.
        size = focal * tables["navigation"]["target_size_m"]
        least = max(least, size / (rendered_camera.TARGET_FRACTION * rendered_camera.MAX_INPUT_PX))
    return _cached_sampling(file_path(tables, "field"), focal, least)


def range_limits(tables: Mapping[str, Any]) -> tuple[float, float]:
    """The nearer and the farther of start and station [m]."""
    places = (tables["initial"]["relative_position_m"], tables["formation"]["desired_position_m"])
    near, far = sorted(math.hypot(*place) for place in places)
    return near, far


@functools.lru_cache(maxsize=8)
def _cached_sampling(field: Path, focal_px: float, least_range_m: float) -> "RaySampling":
    from rpojax.vision.radiance_field.ray_budget import choose_ray_sampling as needed
    from rpojax.vision.weight_files import load_field

    return needed(load_field(field)[0], focal_px, least_range_m, oversampling=1.0)
