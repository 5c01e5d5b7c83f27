"""The trained files that a scenario's camera model needs: where they are, their content, how finely to sample."""

import functools
import hashlib
import math
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rpojax.errors import ScenarioError

if TYPE_CHECKING:
    from rpojax.sensors.image_camera import Networks
    from rpojax.vision.region import Sampling

PACKAGED = "packaged"
_NEAREST = 0.8
"""Rays are at least as dense as pixels down to this share of the nearest of start and station."""


def files(tables: Mapping[str, Any]) -> dict[str, Path]:
    """Trained files by key of the section `imaging`, those that the scenario's camera model needs."""
    from rpojax.vision import detector, weights

    if tables["camera"]["model"] != "rendered":
        return {}
    packaged = {"field": weights.packaged_field, "detector": detector.packaged_detector}
    found = {}
    for key, default in packaged.items():
        name = tables["imaging"][key]
        found[key] = default() if name == PACKAGED else Path(name)
        if not found[key].is_file():
            raise ScenarioError(f"imaging.{key}", name, f"'{PACKAGED}' or the path of a file")
    return found


def digests(tables: Mapping[str, Any]) -> dict[str, str]:
    """SHA-256 of every trained file that counts."""
    return {key: hashlib.sha256(path.read_bytes()).hexdigest() for key, path in files(tables).items()}


def load(tables: Mapping[str, Any]) -> "Networks | None":
    """Content of the trained files, or None for a camera model that needs none."""
    if tables["camera"]["model"] != "rendered":
        return None
    from rpojax.sensors.image_camera import Networks
    from rpojax.vision.background import sky
    from rpojax.vision.detector import load_detector
    from rpojax.vision.weights import load_field

    paths = files(tables)
    imaging = tables["imaging"]
    return Networks(
        field=load_field(paths["field"])[0],
        detector=load_detector(paths["detector"])[0],
        sky=sky(imaging["sky_seed"]),
    )


def sampling(tables: Mapping[str, Any]) -> "Sampling | None":
    """How finely the target is sampled, for the ranges that the scenario is about."""
    if tables["camera"]["model"] != "rendered":
        return None
    from rpojax.sensors import image_camera

    camera = tables["camera"]
    focal = 0.5 * camera["width_px"] / math.tan(math.radians(0.5 * camera["field_of_view_deg"]))
    places = (tables["initial"]["relative_position_m"], tables["formation"]["desired_position_m"])
    least = _NEAREST * min(math.hypot(*place) for place in places)
    if max(camera["width_px"], camera["height_px"]) > image_camera.CANVAS_PX:
        # Nearer than this, a window of a large frame is binned so that the target stays as small.
        size = focal * tables["navigation"]["target_size_m"]
        least = max(least, size / (image_camera.FILL * image_camera.CANVAS_PX))
    return _sampling(files(tables)["field"], focal, least)


@functools.lru_cache(maxsize=8)
def _sampling(field: Path, focal_px: float, least_range_m: float) -> "Sampling":
    from rpojax.vision.region import sampling as needed
    from rpojax.vision.weights import load_field

    return needed(load_field(field)[0], focal_px, least_range_m, oversampling=1.0)
