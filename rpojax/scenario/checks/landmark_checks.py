"""Checks that the camera can find landmarks of the target of the scenario."""

import numpy as np

from rpojax.errors import ScenarioError
from rpojax.scenario.schema import NO_LANDMARKS, ScenarioFile
from rpojax.scenario.trained import target_landmarks
from rpojax.sensors.additional.landmark_camera import MOST

_OUTSIDE = 1.1
"""Reach of landmarks over that of the hull, up to which they are of the same body."""


def check_landmarks(file: ScenarioFile) -> None:
    """Refuses landmarks without a camera that finds them, of another target, or of a team.

    Raises:
        ScenarioError: naming the key.
    """
    if file.camera.landmarks == NO_LANDMARKS:
        if file.landmarks is not None:
            raise ScenarioError("landmarks", "a section", "camera.landmarks beside it")
        return
    if file.servicers:
        raise ScenarioError("camera.landmarks", file.camera.landmarks, "a scenario of one servicer")
    landmarks = target_landmarks.landmarks_for_camera(file.model_dump())
    assert landmarks is not None
    positions = np.asarray(landmarks.positions)
    if len(positions) > MOST:
        raise ScenarioError("camera.landmarks", len(positions), f"at most {MOST} landmarks")
    reach, of_hull = (np.linalg.norm(np.asarray(each), axis=1).max() for each in (positions, file.target.hull_m))
    if not of_hull / _OUTSIDE < reach < of_hull * _OUTSIDE:
        found = f"landmarks up to {reach:.3g} m from the centre of mass"
        raise ScenarioError("camera.landmarks", found, f"those of the target, whose hull reaches {of_hull:.3g} m")
