"""Whether the thrusters can hold places in the frame of a target that turns."""

import math

import numpy as np

from rpojax.flight.control import thruster_allocation
from rpojax.flight.guidance.target_frame import AUTHORITY_RATIO
from rpojax.scenario.phases.phase_sections import PhaseSection
from rpojax.scenario.phases.reference_sections import ArcSection
from rpojax.scenario.schema import ScenarioFile
from rpojax.scenario.warnings.dispersed_reach import DispersedReach


def target_frame_warnings(file: ScenarioFile, reach: DispersedReach) -> list[str]:
    """Places of the turning frame that take more than half of the thrust to stay at, and arcs that are too short."""
    found: list[str] = []
    if not any(phase.frame == "target" for phase in file.phases) or not file.thrusters:
        return found
    thrust = _authority(file) / reach.high("servicer.mass_kg")
    rate = math.radians(max(abs(each) for each in reach.ends("target.tumble_rate_deg_s")))
    for before, phase in zip([None, *file.phases[:-1]], file.phases, strict=True):
        if phase.frame != "target":
            continue
        radius = max([_radius(each) for each in (before, phase) if each is not None])
        needed = rate**2 * radius
        if thrust < AUTHORITY_RATIO * needed:
            found.append(
                f"phases.{phase.name}.frame: {radius:g} m from a target that turns at "
                f"{math.degrees(rate):.3g} deg/s the servicer is pulled outwards by {1e3 * needed:.3g} mm/s^2, "
                f"expected at most "
                f"{1e3 * thrust / AUTHORITY_RATIO:.3g} mm/s^2, half of what its thrusters give in any direction"
            )
        elif isinstance(phase.reference, ArcSection):
            found += _arc_warnings(phase, radius, rate, thrust)
    return found


def _radius(phase: PhaseSection) -> float:
    """Greatest distance from the target that a reference names [m]."""
    table = phase.reference.model_dump()
    places = [math.hypot(*table[key]) for key in ("position_m", "end_position_m") if key in table]
    return max([*places, *(table[key] for key in ("radius_m", "distance_m") if key in table)], default=0.0)


def _arc_warnings(phase: PhaseSection, radius: float, rate: float, thrust: float) -> list[str]:
    """An arc over half a turn, of a servicer at rest beside the target, that takes far more than the thrust."""
    duration = phase.reference.duration_s
    turn = 1.25 * rate + 1.875 * math.pi / duration
    needed = radius * (turn**2 + 6.0 * rate / duration + 5.8 * math.pi / duration**2)
    if needed <= _ARC_RATIO * thrust:
        return []
    return [
        f"phases.{phase.name}.reference.duration_s: in {duration:g} s an arc over half a turn takes up to "
        f"{1e3 * needed:.3g} mm/s^2, expected at most {1e3 * _ARC_RATIO * thrust:.3g} mm/s^2, twice what the thrusters "
        "give in any direction"
    ]


_ARC_RATIO = 2.0
"""Greatest acceleration of an arc, at its most unfavourable attitude, over what the thrusters give [-]. A choice: then
one of a hundred arcs from any attitude takes more than they give."""


def _authority(file: ScenarioFile) -> float:
    """Force [N] that the thrusters give in any direction without torque."""
    force = np.array([each.force_n for each in file.thrusters])
    direction, position = (
        np.array([getattr(each, key) for each in file.thrusters]) for key in ("direction", "position_m")
    )
    return thruster_allocation.force_authority(thruster_allocation.wrench_matrix(force, direction, position))
