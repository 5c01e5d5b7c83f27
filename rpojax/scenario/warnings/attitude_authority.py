"""Whether wheels and search can do what slews, the thruster's lever arm and the field of view ask of them."""

import math
from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from rpojax.flight.control.wheel_torque_allocation import allocation_matrix
from rpojax.flight.guidance.pointing_tuning import PointingTuning
from rpojax.flight.guidance.slew_profile import slew_duration
from rpojax.scenario.numbers.section_records import section_record
from rpojax.scenario.schema import ScenarioFile
from rpojax.scenario.warnings.dispersed_reach import DispersedReach
from rpojax.scenario.warnings.target_size import least_half_frame

_ACCELERATION = "slew_acceleration_mrad_s2"
_TINY = 1e-12
_MOMENTUM_SHARE = 0.5
"""Share of the wheels' momentum that burns may fill: the rest is for slews. A choice: in `inspection` with an arm of
0.15 m, which fills more than all of it, 27 of 64 runs fail."""


def attitude_warnings(file: ScenarioFile, reach: DispersedReach, way_m_s: float) -> list[str]:
    """Slews that ask more of the wheels than they have, momentum that nothing unloads, lost wheels, gaps of a search.

    The best way to the station takes `way_m_s` [m/s].
    """
    pointing = section_record(
        PointingTuning,
        {**file.pointing.model_dump(), _ACCELERATION: reach.high(f"pointing.{_ACCELERATION}")},
    )
    to_wheels, rate = map(np.asarray, _of_flight_software(np.array(file.wheels.axes), pointing))
    inertia = _inertia(file, to_wheels)
    momentum = np.array(file.wheels.inertia_kg_m2) * (
        np.array(file.wheels.speed_limit_rad_s) - np.abs(file.wheels.initial_speed_rad_s)
    )
    return [
        *_torque(file, reach, inertia),
        *_slew_momentum(inertia * rate, momentum),
        *_thruster_momentum(file, to_wheels, momentum, reach.high("servicer.mass_kg") * way_m_s),
        *_lost_wheel(file, reach),
        *_search_pattern(file, reach),
    ]


@jax.jit
def _of_flight_software(axes: Float[Array, "3 3"], pointing: PointingTuning) -> tuple[Array, Array]:
    """Matrix from body torque to wheel torques, and the largest rate of a half turn [rad/s]."""
    half_turn = jnp.full((), math.pi, dtype=axes.dtype)
    # Of a cycloid: twice the mean rate.
    return allocation_matrix(axes), 2.0 * half_turn / slew_duration(pointing, half_turn)


@dataclass(frozen=True)
class LackingTorque:
    """An acceleration of slews, by its key, that asks more torque [N m] of a wheel than that gives."""

    key: str
    wheel: int
    needed_n_m: float
    limit_n_m: float


def lacking_torques(file: ScenarioFile, reach: DispersedReach) -> list[LackingTorque]:
    """Accelerations of slews that exceed the torque of a wheel, with the wheel that lacks most of it."""
    return _lacking_torques(file, reach, _inertia(file, np.asarray(allocation_matrix(jnp.array(file.wheels.axes)))))


def _inertia(file: ScenarioFile, to_wheels: np.ndarray) -> np.ndarray:
    """Torque of each wheel over the acceleration [kg m2], the largest over all axes of rotation."""
    return np.asarray(np.linalg.norm(to_wheels @ np.array(file.servicer.inertia_kg_m2), axis=1))


def _lacking_torques(file: ScenarioFile, reach: DispersedReach, inertia: np.ndarray) -> list[LackingTorque]:
    limit = np.array(file.wheels.torque_limit_n_m)
    found = []
    for key in (f"pointing.{_ACCELERATION}", "pointing.search_acceleration_mrad_s2"):
        needed = 1e-3 * reach.high(key) * inertia
        worst = int(np.argmax(needed / limit))
        if needed[worst] > limit[worst]:
            found.append(LackingTorque(key, worst, float(needed[worst]), float(limit[worst])))
    return found


def _torque(file: ScenarioFile, reach: DispersedReach, inertia: np.ndarray) -> list[str]:
    """Accelerations of slews that exceed the torque of a wheel."""
    return [
        f"{each.key}: takes {each.needed_n_m:.3g} N m of wheel {each.wheel}, expected at most "
        f"wheels.torque_limit_n_m[{each.wheel}] = {each.limit_n_m:.3g}, or slews and settling last longer than planned"
        for each in _lacking_torques(file, reach, inertia)
    ]


def _slew_momentum(needed: np.ndarray, momentum: np.ndarray) -> list[str]:
    """Wheels whose momentum is less than a half turn needs."""
    worst = int(np.argmax(needed / np.maximum(momentum, _TINY)))
    if needed[worst] <= momentum[worst]:
        return []
    return [
        f"wheels.initial_speed_rad_s: wheel {worst} has {max(momentum[worst], 0.0):.3g} N m s up to its speed limit, "
        f"expected at least {needed[worst]:.3g} for a half turn by pointing.slew_acceleration_mrad_s2"
    ]


def _thruster_momentum(
    file: ScenarioFile, to_wheels: np.ndarray, momentum: np.ndarray, impulse_n_s: float
) -> list[str]:
    """Momentum of burns beside the centre of mass, which nothing unloads."""
    direction = np.array(file.thruster.direction) / np.linalg.norm(file.thruster.direction)
    arm = np.cross(np.array(file.thruster.position_m), direction)
    filled = impulse_n_s * np.abs(to_wheels @ arm)
    worst = int(np.argmax(filled / np.maximum(momentum, _TINY)))
    if filled[worst] <= _MOMENTUM_SHARE * momentum[worst]:
        return []
    return [
        f"thruster.position_m: the way to the station fills wheel {worst} with {filled[worst]:.3g} N m s, "
        f"which nothing unloads, expected at most half of {momentum[worst]:.3g}"
    ]


def _lost_wheel(file: ScenarioFile, reach: DispersedReach) -> list[str]:
    """A fault in all runs that leaves fewer than three axes of torque."""
    stuck = [each.name for each in file.faults if reach.kinds_of(each.name) == {"wheel_stuck"}]
    if not file.effects.faults or not stuck:
        return []
    return [
        f"faults.{stuck[0]}.kind: found 'wheel_stuck' with three wheels, expected other kinds, or runs whose attitude "
        "is not controlled any more"
    ]


def _search_pattern(file: ScenarioFile, reach: DispersedReach) -> list[str]:
    """Turns of the search that are farther from each other than the camera sees."""
    least_deg = 2.0 * math.degrees(math.atan(least_half_frame(file, reach)))
    pitch_deg = reach.high("pointing.search_pitch_deg")
    if pitch_deg <= least_deg:
        return []
    return [
        f"pointing.search_pitch_deg: found {pitch_deg:g}, expected at most the {least_deg:.3g} deg that the camera "
        "sees, or a search leaves gaps"
    ]
