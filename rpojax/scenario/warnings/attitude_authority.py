"""Whether wheels and search can do what slews, the thruster's lever arm and the field of view ask of them."""

import math
from collections.abc import Sequence

import numpy as np

from rpojax.dispersions.designs.design_sections import GridDesign, TableDesign
from rpojax.dispersions.kinds.choice import Choice
from rpojax.scenario.schema import ScenarioFile
from rpojax.scenario.warnings.dispersed_reach import DispersedReach

_LARGEST_TURN = math.pi
_MOMENTUM_SHARE = 0.5
"""Share of the wheels' momentum that burns may fill: the rest is for slews. A choice: in `inspection` with an arm of
0.15 m, which fills more than all of it, 27 of 64 runs fail."""


def attitude_warnings(file: ScenarioFile, reach: DispersedReach, way_m_s: float) -> list[str]:
    """Slews that ask more of the wheels than they have, momentum that nothing unloads, lost wheels, gaps of a search.

    The best way to the station takes `way_m_s` [m/s].
    """
    to_wheels = np.abs(np.linalg.inv(np.array(file.wheels.axes).T) @ np.array(file.servicer.inertia_kg_m2))
    # Largest over all axes of rotation, by wheel.
    inertia = np.linalg.norm(to_wheels, axis=1)
    momentum = np.array(file.wheels.inertia_kg_m2) * (
        np.array(file.wheels.speed_limit_rad_s) - np.abs(file.wheels.initial_speed_rad_s)
    )
    return [
        *_torque(file, reach, inertia),
        *_slew_momentum(reach, inertia, momentum),
        *_thruster_momentum(file, reach, momentum, way_m_s),
        *_lost_wheel(file),
        *_search_pattern(file, reach),
    ]


def _torque(file: ScenarioFile, reach: DispersedReach, inertia: np.ndarray) -> list[str]:
    """Accelerations of slews that exceed the torque of a wheel."""
    limit = np.array(file.wheels.torque_limit_n_m)
    found = []
    for key in ("pointing.slew_acceleration_mrad_s2", "pointing.search_acceleration_mrad_s2"):
        needed = 1e-3 * reach.high(key) * inertia
        worst = int(np.argmax(needed / limit))
        if needed[worst] > limit[worst]:
            found.append(
                f"{key}: takes {needed[worst]:.3g} N m of wheel {worst}, expected at most "
                f"wheels.torque_limit_n_m[{worst}] = {limit[worst]:.3g}, or slews and settling last longer than planned"
            )
    return found


def _slew_momentum(reach: DispersedReach, inertia: np.ndarray, momentum: np.ndarray) -> list[str]:
    """Rates of a half turn for which the wheels have no momentum left."""
    # Of the cycloid of `slew_profile.slew_duration`: twice the mean rate.
    rate = math.sqrt(2.0 * _LARGEST_TURN * 1e-3 * reach.high("pointing.slew_acceleration_mrad_s2") / math.pi)
    worst = int(np.argmax(inertia * rate / np.maximum(momentum, 1e-12)))
    if inertia[worst] * rate <= momentum[worst]:
        return []
    return [
        f"wheels.initial_speed_rad_s: wheel {worst} has {max(momentum[worst], 0.0):.3g} N m s up to its speed limit, "
        f"expected at least {inertia[worst] * rate:.3g} for a half turn by pointing.slew_acceleration_mrad_s2"
    ]


def _thruster_momentum(file: ScenarioFile, reach: DispersedReach, momentum: np.ndarray, way_m_s: float) -> list[str]:
    """Momentum of burns beside the centre of mass, which nothing unloads."""
    direction = np.array(file.thruster.direction) / np.linalg.norm(file.thruster.direction)
    arm = np.cross(np.array(file.thruster.position_m), direction)
    impulse = reach.high("servicer.mass_kg") * way_m_s
    filled = impulse * np.abs(np.linalg.inv(np.array(file.wheels.axes).T) @ arm)
    worst = int(np.argmax(filled / np.maximum(momentum, 1e-12)))
    if filled[worst] <= _MOMENTUM_SHARE * momentum[worst]:
        return []
    return [
        f"thruster.position_m: the way to the station fills wheel {worst} with {filled[worst]:.3g} N m s, "
        f"which nothing unloads, expected at most half of {momentum[worst]:.3g}"
    ]


def _lost_wheel(file: ScenarioFile) -> list[str]:
    """A fault in all runs that leaves fewer than three axes of torque."""
    if not file.effects.faults or set(fault_kinds(file)) != {"wheel_stuck"}:
        return []
    return [
        "fault.kind: found 'wheel_stuck' with three wheels, expected other kinds, or runs whose attitude is not "
        "controlled any more"
    ]


def _search_pattern(file: ScenarioFile, reach: DispersedReach) -> list[str]:
    """Turns of the search that are farther from each other than the camera sees."""
    camera = file.camera
    half = 0.5 * math.radians(reach.low("camera.field_of_view_deg"))
    least_deg = 2.0 * math.degrees(math.atan(math.tan(half) * min(1.0, camera.height_px / camera.width_px)))
    pitch_deg = reach.high("pointing.search_pitch_deg")
    if pitch_deg <= least_deg:
        return []
    return [
        f"pointing.search_pitch_deg: found {pitch_deg:g}, expected at most the {least_deg:.3g} deg that the camera "
        "sees, or a search leaves gaps"
    ]


def fault_kinds(file: ScenarioFile) -> Sequence[str]:
    """Kinds of fault that the runs of a scenario may have."""
    key = "fault.kind"
    if isinstance(file.design, TableDesign | GridDesign) and key in file.design.values:
        return [str(kind) for kind in file.design.values[key]]
    for entry in file.dispersions:
        if isinstance(entry, Choice) and entry.key == key:
            return [str(kind) for kind in entry.values]
    return [file.fault.kind]
