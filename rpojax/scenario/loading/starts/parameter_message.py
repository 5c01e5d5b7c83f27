"""State of an OPM, which holds at its epoch alone."""

import math
from typing import Final

import numpy as np

from rpojax.core.constants import MU_EARTH
from rpojax.errors import ScenarioError
from rpojax.scenario.loading.starts.inertial_frames import to_inertial
from rpojax.scenario.loading.starts.message_text import Segment
from rpojax.scenario.loading.starts.orbit_states import OrbitState
from rpojax.time_scales import Instant

_ELEMENTS: Final = ("SEMI_MAJOR_AXIS", "ECCENTRICITY", "INCLINATION")
_LARGEST_DIFFERENCES: Final = (0.02, 0.02, 1.0)
"""Of the axis relative to itself, the eccentricity and the inclination [deg]; mean elements differ by less."""


def _check_elements(segment: Segment, position: np.ndarray, velocity: np.ndarray) -> None:
    """Refuses elements that are not those of the state beside them: one of both is in another frame or of another time.

    Raises:
        ScenarioError: they differ by far.
    """
    if not all(segment.fields.get(name) for name in _ELEMENTS):
        return
    said = [segment.number(name) for name in _ELEMENTS]
    radius, momentum = float(np.linalg.norm(position)), np.cross(position, velocity)
    with np.errstate(all="ignore"):
        axis = 1e-3 / (2.0 / radius - float(velocity @ velocity) / MU_EARTH)
        eccentricity = float(np.linalg.norm(np.cross(velocity, momentum) / MU_EARTH - position / radius))
        inclination = math.degrees(math.atan2(math.hypot(momentum[0], momentum[1]), momentum[2]))
    found = (axis, eccentricity, inclination)
    for name, of_state, value, most in zip(_ELEMENTS, found, said, _LARGEST_DIFFERENCES, strict=True):
        scale = abs(value) if name == _ELEMENTS[0] else 1.0
        if not abs(of_state - value) <= most * scale:
            raise ScenarioError(
                segment.key, f"{name} = {value:g} beside a state with {of_state:g}", "those of one orbit"
            )


def state_of(segment: Segment, epoch: Instant | None, key: str) -> OrbitState:
    """State of an OPM, whose epoch must be the one asked for.

    Raises:
        ScenarioError: it is of another epoch or not about the Earth.
    """
    segment.check("CENTER_NAME", "EARTH")
    at, frame = segment.time("EPOCH"), segment.needed("REF_FRAME")
    if epoch not in (None, at):
        raise ScenarioError(key, f"an OPM with the state at {at.utc()} alone", f"one at {epoch.utc()}, or an OEM")
    position = 1e3 * np.array([segment.number(name) for name in ("X", "Y", "Z")])
    velocity = 1e3 * np.array([segment.number(name) for name in ("X_DOT", "Y_DOT", "Z_DOT")])
    R = to_inertial(frame, segment.time("REF_FRAME_EPOCH") if segment.fields.get("REF_FRAME_EPOCH") else at, key)
    _check_elements(segment, position, velocity)
    return OrbitState(at, R @ position, R @ velocity, "OPM", frame, segment.fields.get("OBJECT_NAME", "UNKNOWN"))
