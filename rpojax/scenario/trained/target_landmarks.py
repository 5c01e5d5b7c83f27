"""Landmarks of the target that the camera finds, from the file that a scenario names."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rpojax.errors import ScenarioError
from rpojax.scenario.sections import NO_LANDMARKS
from rpojax.scenario.trained.trained_files import PACKAGED
from rpojax.untrusted.file_reading import is_regular
from rpojax.vision.surface import landmark_file
from rpojax.vision.surface.landmarks import Landmarks


def landmarks_for_camera(tables: Mapping[str, Any]) -> Landmarks | None:
    """Landmarks of a scenario, None of one whose camera finds none.

    Raises:
        RpojaxError: the file cannot be used.
    """
    path = landmark_path(tables)
    return None if path is None else landmark_file.load_landmarks(path)[0]


def landmark_path(tables: Mapping[str, Any]) -> Path | None:
    """Path of the file of landmarks, None of a camera that finds none.

    Raises:
        ScenarioError: there is no such file.
    """
    name = tables["camera"].get("landmarks", NO_LANDMARKS)
    if name == NO_LANDMARKS:
        return None
    path = landmark_file.landmark_path(None if name == PACKAGED else Path(name))
    if not is_regular(path):
        raise ScenarioError("camera.landmarks", name, f"'{NO_LANDMARKS}', '{PACKAGED}' or the path of a file")
    return path
