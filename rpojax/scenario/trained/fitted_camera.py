"""Fitted camera statistics of a scenario, and the conditions under which the fit is valid."""

import json
import math
from collections.abc import Mapping
from typing import Any

from rpojax.core.pytree import replace
from rpojax.errors import ScenarioError
from rpojax.scenario.trained import target_landmarks
from rpojax.scenario.trained.image_sampling import range_limits
from rpojax.scenario.trained.trained_files import (
    PACKAGED,
    REQUIRED_KEYS,
    file_digest,
    file_path,
    finds_landmarks,
    of_wide_lens,
)
from rpojax.sensors import statistical_camera_file
from rpojax.sensors.statistical_camera import CameraStatistics
from rpojax.vision.surface.landmark_file import landmark_digest

RANGE_KEY = "range of start and station [m]"
LANDMARKS_KEY = "camera.landmarks"
_CAMERA_KEYS = ("width_px", "height_px", "field_of_view_deg")
_IMAGING_KEYS = ("exposure", "full_well", "read_noise", "blur_px", "fill_light", "score_threshold")
_OPTIONAL_KEYS = ("camera.distortion", "imaging.bloom", "imaging.bloom_radius_px", "imaging.exposure_time_s")
"""Of these a card has those only that are not None; older ones know none."""


def fitted_for(tables: Mapping[str, Any]) -> dict[str, Any]:
    """Values of the keys on which a fitted camera depends."""
    camera = {f"camera.{key}": tables["camera"][key] for key in _CAMERA_KEYS}
    imaging = {f"imaging.{key}": tables["imaging"][key] for key in _IMAGING_KEYS}
    optional = {key: _value(tables, key) for key in _OPTIONAL_KEYS}
    if optional["imaging.bloom"] is None:
        optional["imaging.bloom_radius_px"] = None
    given = {key: value for key, value in optional.items() if value is not None}
    return {**camera, **imaging, **given, "target.hull_m": tables["target"]["hull_m"]}


def _value(tables: Mapping[str, Any], key: str) -> Any:
    section, _, leaf = key.partition(".")
    return tables[section].get(leaf)


def made_with(tables: Mapping[str, Any]) -> dict[str, str]:
    """SHA-256 of the network files to which a camera is fitted, by key."""
    found = {f"imaging.{key}": file_digest(file_path(tables, key)) for key in REQUIRED_KEYS["rendered"]}
    landmarks = target_landmarks.landmarks_for_camera(tables)
    if landmarks is None:
        return found
    found["imaging.landmark_network"] = file_digest(file_path(tables, "landmark_network"))
    return {**found, LANDMARKS_KEY: landmark_digest(landmarks)}


def view_limits(tables: Mapping[str, Any], through_wide_lens: bool = False) -> dict[str, tuple[float, float]]:
    """Least and greatest value of the viewing conditions of a scenario through a lens, by key."""
    camera = tables["camera"]
    return {
        RANGE_KEY: ranges_in_use(tables, through_wide_lens),
        "camera.phase_limit_deg": (0.0, camera["phase_limit_deg"]),
        "camera.sun_exclusion_deg": (camera["sun_exclusion_deg"], 180.0),
    }


def ranges_in_use(tables: Mapping[str, Any], through_wide_lens: bool = False) -> tuple[float, float]:
    """Least and greatest range [m] of start, station and phases at which a lens is in use.

    It is that at which a target of scale 1 looks as large.
    """
    scale, references = tables["target"]["scale"], [phase["reference"] for phase in tables.get("phases") or ()]
    distances = [
        math.hypot(*each[key]) for each in references for key in ("position_m", "end_position_m") if key in each
    ]
    distances += [each["radius_m"] for each in references if "radius_m" in each]
    ranges = [*range_limits(tables), *(distance / scale for distance in distances)]
    near, far = min(ranges), max(ranges)
    if (lens := tables.get("wide_lens")) is None:
        return near, far
    if through_wide_lens:
        return near, min(far, lens["return_range_m"] / scale)
    return min(max(near, lens["switch_range_m"] / scale), far), far


def statistics_for_model(tables: Mapping[str, Any], through_wide_lens: bool = False) -> CameraStatistics | None:
    """Fitted statistics of a statistical camera, None for other camera models.

    Raises:
        ScenarioError: the file was fitted for other settings, networks or viewing conditions.
    """
    if tables["camera"]["model"] != "statistical":
        return None

    statistics, card = statistical_camera_file.load_statistics(file_path(tables, "statistics"))
    known = card.get("fitted_for")
    known = known if isinstance(known, dict) else {}
    expected = fitted_for(tables)
    for key in (*expected, *(key for key in _OPTIONAL_KEYS if key in known and key not in expected)):
        found, value = known.get(key), expected.get(key)
        if json.dumps(found) != json.dumps(value):
            raise ScenarioError(
                key, value, f"{found}, as in imaging.statistics; `rpojax calibrate-camera-model` fits another"
            )
    _check_card(tables, card, through_wide_lens)
    if finds_landmarks(tables):
        return statistics
    return replace(statistics, landmarks=None)


def wide_statistics_for_model(tables: Mapping[str, Any]) -> CameraStatistics | None:
    """Fitted statistics of a statistical camera through its second lens, None without one.

    Raises:
        ScenarioError: as of `statistics_for_model`.
    """
    if tables["camera"]["model"] != "statistical" or (wide := of_wide_lens(tables)) is None:
        return None
    try:
        return statistics_for_model(wide, through_wide_lens=True)
    except ScenarioError as error:
        name = tables["wide_lens"].get("statistics") or PACKAGED
        raise ScenarioError("wide_lens.statistics", name, f"statistics of this lens: {error}") from None


def _check_card(tables: Mapping[str, Any], card: Mapping[str, Any], through_wide_lens: bool) -> None:
    """Refuses statistics fitted to other networks, or for a smaller range of viewing conditions."""
    advice = "`rpojax calibrate-camera-model` fits another"
    networks, views = card.get("made_with"), card.get("limits")
    for key, value in made_with(tables).items():
        found = networks.get(key) if isinstance(networks, dict) else None
        if found != value:
            section, _, leaf = key.partition(".")
            name = tables[section][leaf]
            raise ScenarioError(key, name, f"the file that imaging.statistics was fitted with; {advice}")
    for key, (low, high) in view_limits(tables, through_wide_lens).items():
        found = views.get(key) if isinstance(views, dict) else None
        if not found or low < found[0] or high > found[1]:
            raise ScenarioError(key, (low, high), f"within {found}, as in imaging.statistics; {advice}")
