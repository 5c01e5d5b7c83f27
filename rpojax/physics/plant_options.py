"""Static options of the plant, which a scenario holds."""

from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True)
class Effects:
    """Switches of the plant's effects. What is off is not compiled.

    Attributes:
        integrator: "rk4", or "rk8" for checks
        zonal_degree: of the Earth's gravity; 0 for a point mass
        sun_gravity: third-body gravity of the Sun
        moon_gravity: third-body gravity of the Moon
        drag: force and torque of the air
        solar_pressure: force and torque of sunlight, with the Earth's shadow
        gravity_gradient: gravity-gradient torque
        wheel_friction: friction in the wheels' bearings
        wheel_torque_steps: wheel drives quantise their torque
        thruster_ramps: thrust rises and falls in finite times
        center_of_mass_shift: propellant used moves the centre of mass
        inertia_change: propellant used changes the inertia
        faults: equipment can fail
        plume: the small thrusters' plumes push and turn the target
    """

    integrator: Literal["rk4", "rk8"] = "rk4"
    zonal_degree: int = 2
    sun_gravity: bool = False
    moon_gravity: bool = False
    drag: bool = False
    solar_pressure: bool = False
    gravity_gradient: bool = True
    wheel_friction: bool = False
    wheel_torque_steps: bool = False
    thruster_ramps: bool = False
    center_of_mass_shift: bool = False
    faults: bool = False
    plume: bool = False
    inertia_change: bool = False


FaultKind = Literal[
    "none",
    "wheel_stuck",
    "wheel_friction",
    "thruster_off",
    "thruster_weak",
    "gps_outage",
    "star_tracker_blind",
    "camera_blackout",
    "radio_off",
    "thruster_stuck_open",
    "thruster_leak",
]
"""Kinds of equipment faults."""


def is_fault_kind(key: str) -> bool:
    """Whether a key, such as `faults.first.kind`, is that of a kind of fault, whose values are names."""
    return _is_of_fault(key, "kind")


def is_category(key: str) -> bool:
    """Whether the numbers of a key are codes without an order: kinds of fault, and the wheels that they are of."""
    return is_fault_kind(key) or _is_of_fault(key, "wheel")


def _is_of_fault(key: str, name: str) -> bool:
    parts = key.split(".")
    return len(parts) == 3 and parts[0] == "faults" and parts[2] == name
