"""State of an OPM, which holds at its epoch alone."""

from dataclasses import replace
from typing import Final

import numpy as np

from rpojax.errors import ScenarioError
from rpojax.scenario.loading.starts.inertial_frames import to_inertial
from rpojax.scenario.loading.starts.message_text import Segment
from rpojax.scenario.loading.starts.orbit_states import OrbitState, orbit_section
from rpojax.time_scales import Instant

_ELEMENTS: Final = ("SEMI_MAJOR_AXIS", "ECCENTRICITY", "INCLINATION")
_LARGEST_DIFFERENCES: Final = (0.02, 0.02, 1.0)
"""Of the axis relative to itself, the eccentricity and the inclination [deg]; mean elements differ by less."""


def _check_elements(segment: Segment, state: OrbitState) -> None:
    """Refuses elements that are not those of the state beside them: one of both is in another frame or of another time.

    Raises:
        ScenarioError: they differ by far.
    """
    if not all(segment.fields.get(name) for name in _ELEMENTS):
        return
    of_state = orbit_section(state)
    found = (1e-3 * of_state["semi_major_axis_m"], of_state["eccentricity"], of_state["inclination_deg"])
    for name, value, most in zip(_ELEMENTS, found, _LARGEST_DIFFERENCES, strict=True):
        said = segment.number(name)
        scale = abs(said) if name == _ELEMENTS[0] else 1.0
        if not abs(value - said) <= most * scale:
            raise ScenarioError(segment.key, f"{name} = {said:g} beside a state with {value:g}", "those of one orbit")


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
    said = OrbitState(at, position, velocity, "OPM", frame, segment.fields.get("OBJECT_NAME", "UNKNOWN"))
    _check_elements(segment, said)
    return replace(said, position_m=R @ position, velocity_m_s=R @ velocity)
