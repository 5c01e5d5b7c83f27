"""Checks that the camera can find landmarks of the target of the scenario."""

import numpy as np
from scipy.spatial import ConvexHull

from rpojax.errors import ScenarioError
from rpojax.scenario.schema import ScenarioFile
from rpojax.scenario.sections import NO_LANDMARKS
from rpojax.scenario.trained import target_landmarks
from rpojax.sensors.additional.landmark_camera import MOST

_TOLERANCE = 0.1
"""Distance of landmarks from the hull, and difference of their reach, over that of the hull: of the same body."""


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
    _check_knowledge(file)
    positions = np.asarray(landmarks.positions)
    if len(positions) > MOST:
        raise ScenarioError("camera.landmarks", len(positions), f"at most {MOST} landmarks")
    hull = np.asarray(file.target.hull_m)
    reach = np.linalg.norm(hull, axis=1).max()
    # (facets, 4): outward normals and offsets; how far each landmark is outside of each.
    facets = ConvexHull(hull).equations
    outside = (positions @ facets[:, :3].T + facets[:, 3]).max(axis=1)
    spread = np.linalg.norm(positions, axis=1).max()
    if outside.max() > _TOLERANCE * reach or spread < (1.0 - _TOLERANCE) * reach:
        found = f"landmarks up to {spread:.3g} m from the centre of mass and {max(outside.max(), 0.0):.2g} m outside"
        raise ScenarioError("camera.landmarks", found, f"those of the target, whose hull reaches {reach:.3g} m")


def _check_knowledge(file: ScenarioFile) -> None:
    """Refuses a target of another size than flight software thinks, and probabilities of more than one."""
    assert file.landmarks is not None
    expected = "1 with landmarks, whose places flight software knows"
    if file.target.scale != 1.0:
        raise ScenarioError("target.scale", file.target.scale, expected)
    if any("target.scale" in each.key_texts for each in file.dispersions):
        raise ScenarioError("target.scale", "a dispersion", expected)
    for kind in ("", "shaded_"):
        missed, false = getattr(file.landmarks, f"{kind}miss_probability"), file.landmarks.outlier_probability
        if missed + false > 1.0:
            expected = f"at most {1.0 - false:g}, as outlier_probability is {false:g}"
            raise ScenarioError(f"landmarks.{kind}miss_probability", missed, expected)
