"""Whether the thrusters can hold places in the frame of a target that turns."""

import math

import numpy as np

from rpojax.flight.control import thruster_allocation
from rpojax.flight.guidance.target_frame import AUTHORITY_RATIO
from rpojax.scenario.schema import ScenarioFile
from rpojax.scenario.warnings.dispersed_reach import DispersedReach


def target_frame_warnings(file: ScenarioFile, reach: DispersedReach) -> list[str]:
    """Places of the turning frame that take more than half of the thrust to stay at."""
    found: list[str] = []
    if not any(phase.frame == "target" for phase in file.phases) or not file.thrusters:
        return found
    thrust = _authority(file) / reach.high("servicer.mass_kg")
    rate = math.radians(max(abs(each) for each in reach.ends("target.tumble_rate_deg_s")))
    for before, phase in zip([None, *file.phases[:-1]], file.phases, strict=True):
        if phase.frame != "target":
            continue
        tables = [each.reference.model_dump() for each in (before, phase) if each is not None]
        radii = [math.hypot(*each[key]) for each in tables for key in ("position_m", "end_position_m") if key in each]
        needed = rate**2 * max(radii, default=0.0)
        if thrust < AUTHORITY_RATIO * needed:
            found.append(
                f"phases.{phase.name}.frame: {max(radii):g} m from a target that turns at "
                f"{math.degrees(rate):.3g} deg/s the servicer is pulled outwards by {1e3 * needed:.3g} mm/s^2, "
                f"expected at most "
                f"{1e3 * thrust / AUTHORITY_RATIO:.3g} mm/s^2, half of what its thrusters give in any direction"
            )
    return found


def _authority(file: ScenarioFile) -> float:
    """Force [N] that the thrusters give in any direction without torque."""
    force = np.array([each.force_n for each in file.thrusters])
    direction, position = (
        np.array([getattr(each, key) for each in file.thrusters]) for key in ("direction", "position_m")
    )
    return thruster_allocation.force_authority(thruster_allocation.wrench_matrix(force, direction, position))
