"""Checks of phases in the frame of a target that turns: it is known, it can be followed, and its port can be seen."""

import math
from collections.abc import Sequence
from typing import Final

import numpy as np

from rpojax.errors import ScenarioError
from rpojax.flight.navigation.landmark_measurement import FEWEST
from rpojax.flight.navigation.target_attitude_ekf import LARGEST_SIGMA
from rpojax.scenario.phases.phase_sections import PhaseSection
from rpojax.scenario.schema import ScenarioFile
from rpojax.scenario.sections import NO_LANDMARKS
from rpojax.scenario.trained import target_landmarks
from rpojax.vision.surface.landmarks import Landmarks, are_free

_KINDS: Final = ("hold", "arc", "approach", "retreat", "fly_around")
"""References that do not need the orbit."""


def check_target_frame(file: ScenarioFile) -> None:
    """Refuses phases in the target's frame that cannot follow it.

    Raises:
        ScenarioError: naming the key, what was found and what was expected.
    """
    turning = [phase for phase in file.phases if phase.frame == "target"]
    if not turning:
        return
    for before, phase in zip([None, *file.phases[:-1]], file.phases, strict=True):
        if phase.frame == "target":
            _check_follows(file, before, phase)
    _check_port(file, turning)


def _check_follows(file: ScenarioFile, before: PhaseSection | None, phase: PhaseSection) -> None:
    key = f"phases.{phase.name}"
    if file.camera.landmarks == NO_LANDMARKS:
        expected = "'hill', or camera.landmarks, which show how the target turns"
        raise ScenarioError(f"{key}.frame", phase.frame, expected)
    if phase.control != "continuous":
        raise ScenarioError(
            f"{key}.control", phase.control, "'continuous': burns between turns follow no turning place"
        )
    if phase.reference.kind not in _KINDS:
        expected = f"one of {', '.join(_KINDS)} in the frame of the target"
        raise ScenarioError(f"{key}.reference.kind", phase.reference.kind, expected)
    if before is None:
        raise ScenarioError(
            f"{key}.frame", phase.frame, "'hill' in the first phase, before the target's attitude is known"
        )
    if before.frame == "hill":
        _check_way_into_it(before, phase)
    if phase.on_timeout == "hold" and phase.timeout_s is not None:
        expected = "'next' or 'abort' in the frame of the target: a hold would stop beside a target that turns on"
        raise ScenarioError(f"{key}.on_timeout", phase.on_timeout, expected)
    if file.mission.hold_at_s <= file.duration_s:
        expected = f"none within the run, as {phase.name} follows a target that turns on while the servicer holds"
        raise ScenarioError("mission.hold_at_s", file.mission.hold_at_s, expected)


def _check_way_into_it(before: PhaseSection, phase: PhaseSection) -> None:
    """Refuses a way into the frame with an attitude that is not known, or straight past the target."""
    until = before.until.model_dump() if before.until else {}
    sigma = until.get("attitude_sigma_deg")
    if sigma is None:
        expected = f"attitude_sigma_deg, as {phase.name} follows the target's attitude"
        raise ScenarioError(f"phases.{before.name}.until", ", ".join(until) or "nothing", expected)
    largest = math.degrees(LARGEST_SIGMA)
    if sigma >= largest:
        expected = f"less than {largest:.3g}, from which on the filter gives the attitude up"
        raise ScenarioError(f"phases.{before.name}.until.attitude_sigma_deg", sigma, expected)
    if before.on_timeout == "next" and before.timeout_s is not None:
        expected = f"'hold' or 'abort', as {phase.name} needs the attitude that until.attitude_sigma_deg waits for"
        raise ScenarioError(f"phases.{before.name}.on_timeout", before.on_timeout, expected)
    if phase.reference.kind != "arc":
        expected = "'arc' first in the frame of the target: where it begins there is only known on board"
        raise ScenarioError(f"phases.{phase.name}.reference.kind", phase.reference.kind, expected)


def _check_port(file: ScenarioFile, turning: Sequence[PhaseSection]) -> None:
    """Refuses landmarks without a port, and ends of ways from which too few of them can be seen."""
    landmarks = target_landmarks.landmarks_for_camera(file.model_dump())
    assert landmarks is not None
    if landmarks.port_axis is None:
        expected = (
            f"landmarks with a port (rpojax landmarks --port-position), as phase {turning[0].name} flies before it"
        )
        raise ScenarioError("camera.landmarks", file.camera.landmarks, expected)
    for phase in turning:
        reference = phase.reference.model_dump()
        for key in ("position_m", "end_position_m"):
            if key in reference and (seen := _landmarks_seen(file, np.asarray(reference[key]), landmarks)) < FEWEST:
                found = f"{list(reference[key])}, from where {seen} landmarks are within the frame"
                expected = f"a place that sees at least {FEWEST}"
                raise ScenarioError(f"phases.{phase.name}.reference.{key}", found, expected)


def _landmarks_seen(file: ScenarioFile, place: np.ndarray, landmarks: Landmarks) -> int:
    """Landmarks that a camera at a place [m] sees which points at the centre of mass, however it rolls."""
    lines = place - np.asarray(landmarks.positions)
    distance, lens = np.linalg.norm(place), file.camera
    if file.wide_lens is not None and distance < file.wide_lens.switch_range_m:
        lens = file.wide_lens
    cosine = lines @ place / (np.linalg.norm(lines, axis=1) * distance)
    within = cosine > math.cos(math.radians(0.5 * lens.field_of_view_deg))
    return int(np.sum(np.asarray(are_free(landmarks.visible, lines)) & within))
