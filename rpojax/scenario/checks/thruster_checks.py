"""Checks of thrusters and tank, and of the reaction control system: it can push and turn the servicer every way."""

import numpy as np

from rpojax.errors import ScenarioError
from rpojax.flight.control import thruster_allocation
from rpojax.physics.equipment_faults import LEAKS
from rpojax.scenario.checks.ranging_checks import angle_from_camera_deg
from rpojax.scenario.schema import ScenarioFile
from rpojax.scenario.warnings.dispersed_reach import DispersedReach

_AXES = ("force along x", "force along y", "force along z", "torque about x", "torque about y", "torque about z")
_NO_SHARE = 1e-3
"""Share of what one thruster gives below which an axis has no authority [-]: the accuracy of the allocation."""


def check_thrusters(file: ScenarioFile) -> None:
    """Checks names, pulses and authority of the thrusters.

    Raises:
        ScenarioError: naming the key, what was found and what was expected.
    """
    if file.effects.inertia_change and not file.effects.center_of_mass_shift:
        expected = "false, or effects.center_of_mass_shift = true: the inertia is that about the centre of mass"
        raise ScenarioError("effects.inertia_change", True, expected)
    if file.effects.inertia_change:
        _check_tank(file)
    if not file.thrusters:
        if file.isolation.enabled:
            raise ScenarioError("isolation.enabled", True, "false, or [[thrusters]] with isolation valves")
        if file.effects.plume:
            raise ScenarioError("effects.plume", True, "false, or [[thrusters]] whose plumes push the target")
        return
    names = [each.name for each in file.thrusters]
    for each in file.thrusters:
        if names.count(each.name) > 1:
            raise ScenarioError("thrusters.name", each.name, "a name that no other thruster has")
        if each.minimum_on_s > 0.5 / file.rates.plant_hz:
            expected = f"at most half of a step of the plant, {0.5 / file.rates.plant_hz:g} s: a pulse fits into one"
            raise ScenarioError(f"thrusters.{each.name}.minimum_on_s", each.minimum_on_s, expected)
    if file.servicers:
        expected = "none in a team, whose servicers turn to burn"
        raise ScenarioError("thrusters", f"{len(names)} of them with [[servicers]]", expected)
    _check_authority(file, np.ones(len(names), dtype=bool), "thrusters")
    if file.plume.inhibit_within_m > 0.0:
        _check_authority(file, _away_from_boresight(file), "plume.inhibit_angle_deg")


def check_faults(file: ScenarioFile) -> None:
    """Refuses faults of one name, and of thrusters that there are not; dispersions have been checked.

    Raises:
        ScenarioError: naming the key, what was found and what was expected.
    """
    if not file.faults:
        return
    names, reach = [each.name for each in file.faults], DispersedReach(file)
    for each in file.faults:
        if names.count(each.name) > 1:
            raise ScenarioError("faults.name", each.name, "a name that no other fault has")
        leaks = sorted(reach.kinds_of(each.name) & set(LEAKS))
        if file.effects.faults and leaks and not file.thrusters:
            expected = "another kind, or [[thrusters]]: the one thruster neither sticks open nor leaks"
            raise ScenarioError(f"faults.{each.name}.kind", leaks[0], expected)
        last, key = len(file.thrusters) - 1, f"faults.{each.name}.thruster"
        if file.thrusters and (most := max(each.thruster, reach.high(key))) > last:
            raise ScenarioError(key, most, f"at most {last}, the last of [[thrusters]]")


def _check_tank(file: ScenarioFile) -> None:
    """Refuses a tank so far out that without its propellant the rest has the inertia of no body."""
    full, propellant = file.servicer.mass_kg, file.limits.propellant_kg
    if propellant >= full:
        raise ScenarioError("limits.propellant_kg", propellant, f"less than servicer.mass_kg = {full:g}")
    tank = np.array(file.thruster.tank_position_m)
    # The tank's own inertia, and that of the rest about its centre of mass, which lies opposite.
    with_lever = propellant * full / (full - propellant) * (tank @ tank * np.eye(3) - np.outer(tank, tank))
    sphere = 0.4 * propellant * file.thruster.tank_radius_m**2 * np.eye(3)
    dry = np.linalg.eigvalsh(np.array(file.servicer.inertia_kg_m2) - with_lever - sphere)
    if dry[0] <= 0.0 or dry[2] > dry[0] + dry[1]:
        found = ", ".join(f"{each:.3g}" for each in dry)
        expected = f"a tank within the body: without its {propellant:g} kg moments of inertia would be {found} kg m^2"
        raise ScenarioError("thruster.tank_position_m", file.thruster.tank_position_m, expected)


def _away_from_boresight(file: ScenarioFile) -> np.ndarray:
    """Which thrusters may fire near a target on the camera's boresight."""
    # A plume leaves against the force.
    plumes_B = (-np.array(each.direction) for each in file.thrusters)
    return np.array([angle_from_camera_deg(file, plume_B) for plume_B in plumes_B]) > file.plume.inhibit_angle_deg


def _check_authority(file: ScenarioFile, used: np.ndarray, key: str) -> None:
    """Refuses thrusters of which those `used` leave the servicer without force or torque in some direction."""
    force = np.array([each.force_n for each in file.thrusters])
    force = np.where(used, force, 0.0)
    direction = np.array([each.direction for each in file.thrusters])
    position = np.array([each.position_m for each in file.thrusters])
    authority = thruster_allocation.axis_authority(thruster_allocation.wrench_matrix(force, direction, position))
    arm = np.linalg.norm(position, axis=1).max()
    least = _NO_SHARE * force.max() * np.array([1.0, 1.0, 1.0, arm, arm, arm])
    for sign, row in zip("+-", authority, strict=True):
        for axis, found, needed in zip(_AXES, row, least, strict=True):
            if found <= needed:
                unit = "N" if axis.startswith("force") else "N m"
                expected = f"thrusters that give {axis} to both sides with nothing else beside it"
                if not used.all():
                    expected += ", also without those whose plumes point along the camera's boresight"
                raise ScenarioError(key, f"{abs(found):.3g} {unit} of {axis}, {sign} side", expected)
