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
    from rpojax.vision.radiance_field.ray_budget import Sampling

PACKAGED = "packaged"
FILES = {
    "field": "target.field.safetensors",
    "detector": "detector.safetensors",
    "statistics": "target.camera.safetensors",
}
"""Keys of the section `imaging` that name a file, and the packaged ones."""
RANGE = "range of start and station [m]"
_NEEDED = {"geometric": (), "statistical": ("statistics",), "rendered": ("field", "detector")}
_NEAREST = 0.8
"""Rays are at least as dense as pixels down to this share of the nearest of start and station."""
_CAMERA = ("width_px", "height_px", "field_of_view_deg")
_IMAGING = ("exposure", "full_well", "read_noise", "blur_px", "score_threshold")


def files(tables: Mapping[str, Any]) -> dict[str, Path]:
    """Trained files that the scenario's camera model needs, by key of the section `imaging`."""
    return {key: file_of(tables, key) for key in _NEEDED[tables["camera"]["model"]]}


def file_of(tables: Mapping[str, Any], key: str) -> Path:
    """Path of one trained file; raises `ScenarioError` where there is none."""
    from rpojax.vision import weight_files

    name = tables["imaging"][key]
    path = weight_files.asset(FILES[key]) if name == PACKAGED else Path(name)
    if not path.is_file():
        raise ScenarioError(f"imaging.{key}", name, f"'{PACKAGED}' or the path of a file")
    return path


def digests(tables: Mapping[str, Any]) -> dict[str, str]:
    """SHA-256 of every trained file that counts."""
    return {key: digest(path) for key, path in files(tables).items()}


def digest(path: Path) -> str:
    """SHA-256 of a file."""
    return hashlib.sha256(path.read_bytes()).hexdigest()


def load(tables: Mapping[str, Any]) -> "Networks | None":
    """What pictures are made with and looked at with, or None for a camera model without pictures."""
    if tables["camera"]["model"] != "rendered":
        return None
    return load_networks(tables)


def load_networks(tables: Mapping[str, Any]) -> "Networks":
    """Field, detector and sky, whatever the camera model."""
    from rpojax.sensors.rendered_camera import Networks
    from rpojax.vision.detector.two_stage_detector import load_detector
    from rpojax.vision.imaging.stars_and_earth import sky
    from rpojax.vision.weight_files import load_field

    return Networks(
        field=load_field(file_of(tables, "field"))[0],
        detector=load_detector(file_of(tables, "detector"))[0],
        sky=sky(tables["imaging"]["sky_seed"]),
    )


def fitted_for(tables: Mapping[str, Any]) -> dict[str, Any]:
    """What of a scenario a fitted camera depends on."""
    camera = {f"camera.{key}": tables["camera"][key] for key in _CAMERA}
    imaging = {f"imaging.{key}": tables["imaging"][key] for key in _IMAGING}
    return {**camera, **imaging, "target.hull_m": tables["target"]["hull_m"]}


def made_with(tables: Mapping[str, Any]) -> dict[str, str]:
    """SHA-256 of the files whose pictures and boxes a fitted camera is like, by key."""
    return {f"imaging.{key}": digest(file_of(tables, key)) for key in _NEEDED["rendered"]}


def limits(tables: Mapping[str, Any]) -> dict[str, tuple[float, float]]:
    """What a scenario asks of a fitted camera's views: smallest and largest value by key."""
    camera = tables["camera"]
    return {
        RANGE: ranges(tables),
        "camera.phase_limit_deg": (0.0, camera["phase_limit_deg"]),
        "camera.sun_exclusion_deg": (camera["sun_exclusion_deg"], 180.0),
    }


def load_statistics(tables: Mapping[str, Any]) -> "CameraStatistics | None":
    """The fitted camera, or None for another camera model; raises `ScenarioError` where it was fitted for another."""
    if tables["camera"]["model"] != "statistical":
        return None
    from rpojax.sensors import statistical_camera_file

    statistics, card = statistical_camera_file.load_statistics(file_of(tables, "statistics"))
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
    for key, (low, high) in limits(tables).items():
        found = views.get(key) if isinstance(views, dict) else None
        if not found or low < found[0] or high > found[1]:
            raise ScenarioError(key, (low, high), f"within {found}, as in imaging.statistics; {advice}")


def sampling(tables: Mapping[str, Any]) -> "Sampling | None":
    """How finely the target is sampled, or None for a camera model without pictures."""
    return picture_sampling(tables) if tables["camera"]["model"] == "rendered" else None


def picture_sampling(tables: Mapping[str, Any]) -> "Sampling":
    """How finely pictures sample the target, for the ranges that the scenario is about."""
    from rpojax.sensors import rendered_camera

    camera = tables["camera"]
    focal = 0.5 * camera["width_px"] / math.tan(math.radians(0.5 * camera["field_of_view_deg"]))
    least = _NEAREST * ranges(tables)[0]
    if max(camera["width_px"], camera["height_px"]) > rendered_camera.CANVAS_PX:
        # Nearer than this, a window of a large frame is binned so that the target stays as small.
        size = focal * tables["navigation"]["target_size_m"]
        least = max(least, size / (rendered_camera.FILL * rendered_camera.CANVAS_PX))
    return _sampling(file_of(tables, "field"), focal, least)


def ranges(tables: Mapping[str, Any]) -> tuple[float, float]:
    """The nearer and the farther of start and station [m]."""
    places = (tables["initial"]["relative_position_m"], tables["formation"]["desired_position_m"])
    near, far = sorted(math.hypot(*place) for place in places)
    return near, far


@functools.lru_cache(maxsize=8)
def _sampling(field: Path, focal_px: float, least_range_m: float) -> "Sampling":
    from rpojax.vision.radiance_field.ray_budget import sampling as needed
    from rpojax.vision.weight_files import load_field

    return needed(load_field(field)[0], focal_px, least_range_m, oversampling=1.0)
