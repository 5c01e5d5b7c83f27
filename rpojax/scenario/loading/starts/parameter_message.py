"""State of an OPM, which holds at its epoch alone."""

import numpy as np

from rpojax.errors import ScenarioError
from rpojax.scenario.loading.starts.inertial_frames import to_inertial
from rpojax.scenario.loading.starts.message_text import Segment
from rpojax.scenario.loading.starts.orbit_states import OrbitState
from rpojax.time_scales import Instant


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
    return OrbitState(at, R @ position, R @ velocity, "OPM", frame, segment.fields.get("OBJECT_NAME", "UNKNOWN"))
