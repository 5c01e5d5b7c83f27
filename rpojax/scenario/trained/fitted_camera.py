"""Fitted camera statistics of a scenario, and the conditions under which the fit is valid."""

import json
from collections.abc import Mapping
from typing import Any

from rpojax.errors import ScenarioError
from rpojax.scenario.trained.image_sampling import range_limits
from rpojax.scenario.trained.trained_files import REQUIRED_KEYS, file_digest, file_path, of_wide_lens
from rpojax.sensors import statistical_camera_file
from rpojax.sensors.statistical_camera import CameraStatistics

RANGE_KEY = "range of start and station [m]"
_CAMERA_KEYS = ("width_px", "height_px", "field_of_view_deg")
_IMAGING_KEYS = ("exposure", "full_well", "read_noise", "blur_px", "score_threshold")


def fitted_for(tables: Mapping[str, Any]) -> dict[str, Any]:
    """Values of the keys on which a fitted camera depends."""
    camera = {f"camera.{key}": tables["camera"][key] for key in _CAMERA_KEYS}
    imaging = {f"imaging.{key}": tables["imaging"][key] for key in _IMAGING_KEYS}
    return {**camera, **imaging, "target.hull_m": tables["target"]["hull_m"]}


def made_with(tables: Mapping[str, Any]) -> dict[str, str]:
    """SHA-256 of the network files to which a camera is fitted, by key."""
    return {f"imaging.{key}": file_digest(file_path(tables, key)) for key in REQUIRED_KEYS["rendered"]}


def view_limits(tables: Mapping[str, Any]) -> dict[str, tuple[float, float]]:
    """Least and greatest value of the viewing conditions of a scenario, by key."""
    camera = tables["camera"]
    return {
        RANGE_KEY: range_limits(tables),
        "camera.phase_limit_deg": (0.0, camera["phase_limit_deg"]),
        "camera.sun_exclusion_deg": (camera["sun_exclusion_deg"], 180.0),
    }


def statistics_for_model(tables: Mapping[str, Any]) -> CameraStatistics | None:
    """Fitted statistics of a statistical camera, None for other camera models.

    Raises:
        ScenarioError: the file was fitted for other settings, networks or viewing conditions.
    """
    if tables["camera"]["model"] != "statistical":
        return None

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


def wide_statistics_for_model(tables: Mapping[str, Any]) -> CameraStatistics | None:
    """Fitted statistics of a statistical camera through its second lens, None without one.

    Raises:
        ScenarioError: as of `statistics_for_model`.
    """
    if tables["camera"]["model"] != "statistical" or (wide := of_wide_lens(tables)) is None:
        return None
    try:
        return statistics_for_model(wide)
    except ScenarioError as error:
        name = tables["wide_lens"]["statistics"]
        raise ScenarioError("wide_lens.statistics", name, f"statistics of this lens: {error}") from None


def _check_card(tables: Mapping[str, Any], card: Mapping[str, Any]) -> None:
    """Refuses statistics fitted to other networks, or for a smaller range of viewing conditions."""
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
