"""Ray sampling of rendered images for the ranges of a scenario."""

import functools
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rpojax.flight.guidance import detector_window
from rpojax.scenario.trained.trained_files import file_path
from rpojax.sensors import detector_input
from rpojax.vision.radiance_field.field_file import load_field
from rpojax.vision.radiance_field.ray_budget import RaySampling, choose_ray_sampling

_RANGE_MARGIN = 0.8
"""Rays are at least as dense as pixels down to this fraction of the lesser of start and station range."""


def sampling_for_model(tables: Mapping[str, Any]) -> RaySampling | None:
    """Ray sampling of a rendered camera, None for other camera models."""
    return image_sampling(tables) if tables["camera"]["model"] == "rendered" else None


def image_sampling(tables: Mapping[str, Any]) -> RaySampling:
    """Ray sampling of the target for the ranges of the scenario, for any camera model."""
    camera = tables["camera"]
    focal = 0.5 * camera["width_px"] / math.tan(math.radians(0.5 * camera["field_of_view_deg"]))
    least = _RANGE_MARGIN * range_limits(tables)[0]
    if max(camera["width_px"], camera["height_px"]) > detector_input.MAX_INPUT_PX:
        # At lesser ranges a window of a large frame is binned, so that the target does not become larger in pixels.
        size = focal * tables["navigation"]["target_size_m"] / tables["target"]["scale"]
        least = max(least, size / (detector_window.TARGET_FRACTION * detector_input.MAX_INPUT_PX))
    return _cached_sampling(file_path(tables, "field"), focal, least)


def range_limits(tables: Mapping[str, Any]) -> tuple[float, float]:
    """Lesser and greater of the ranges of start and station [m], at which a target of scale 1 looks as large."""
    positions = (tables["initial"]["relative_position_m"], tables["formation"]["desired_position_m"])
    near, far = sorted(math.hypot(*position) / tables["target"]["scale"] for position in positions)
    return near, far


@functools.lru_cache(maxsize=8)
def _cached_sampling(field: Path, focal_px: float, least_range_m: float) -> RaySampling:
    return choose_ray_sampling(load_field(field)[0], focal_px, least_range_m, oversampling=1.0)
