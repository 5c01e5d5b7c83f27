"""Checks of a scenario that span sections: rates that divide, a sane vehicle, dispersions that can be drawn."""

import math
from typing import Any

import numpy as np
from pydantic import ValidationError

from rpojax.errors import ScenarioError
from rpojax.simulation.schema import OrbitSection, ScenarioFile, nominal

_LOWEST_PERIGEE_M = 6.47e6
"""Some 100 km above the ground; nothing stays in orbit below [m]."""


def check_together(file: ScenarioFile) -> None:
    """Checks that span sections: rates that divide, sizes in order, dispersions of keys that exist.

    Raises:
        ScenarioError: naming the key, what was found and what was expected.
    """
    rates = file.rates
    _whole(rates.plant_hz / rates.camera_hz, "rates.plant_hz", rates.plant_hz, "a whole multiple of rates.camera_hz")
    _whole(
        rates.formation_period_s * rates.camera_hz,
        "rates.formation_period_s",
        rates.formation_period_s,
        "a whole number of camera periods",
    )
    _whole(file.duration_s * rates.camera_hz, "duration_s", file.duration_s, "a whole number of camera periods")
    if file.camera.outlier_size_min_px > file.camera.outlier_size_max_px:
        raise ScenarioError(
            "camera.outlier_size_min_px", file.camera.outlier_size_min_px, "at most camera.outlier_size_max_px"
        )
    _check_orbit(file.orbit)
    _check_vehicle(file)
    _check_burns(file)
    distance = math.hypot(*file.formation.desired_position_m)
    if distance <= file.limits.keep_out_m:
        raise ScenarioError(
            "formation.desired_position_m",
            file.formation.desired_position_m,
            f"a place farther from the target than limits.keep_out_m = {file.limits.keep_out_m:g}",
        )
    seen: set[str] = set()
    for index, dispersion in enumerate(file.dispersions):
        _check_dispersion(file, index, dispersion, seen)


def _check_orbit(orbit: OrbitSection) -> None:
    perigee = orbit.semi_major_axis_m * (1.0 - orbit.eccentricity)
    if perigee <= _LOWEST_PERIGEE_M:
        expected = f"a perigee above {_LOWEST_PERIGEE_M:g} m, and semi_major_axis_m makes it {perigee:.6g} m"
        raise ScenarioError("orbit.eccentricity", orbit.eccentricity, expected)


def _check_vehicle(file: ScenarioFile) -> None:
    """Numbers of the vehicle that only together make sense."""
    wheels, period = file.wheels, file.rates.formation_period_s
    for speed, limit in zip(wheels.initial_speed_rad_s, wheels.speed_limit_rad_s, strict=True):
        if abs(speed) > limit:
            raise ScenarioError("wheels.initial_speed_rad_s", speed, f"at most the speed limit of {limit:g}")
    least = min(wheels.torque_limit_n_m)
    if wheels.torque_step_n_m > least:
        raise ScenarioError("wheels.torque_step_n_m", wheels.torque_step_n_m, f"at most the torque limit of {least:g}")
    for name in ("rise_time_s", "fall_time_s"):
        if getattr(file.thruster, name) > 0.25 * period:
            expected = f"at most a quarter of rates.formation_period_s = {period:g}"
            raise ScenarioError(f"thruster.{name}", getattr(file.thruster, name), expected)
    distance = math.hypot(*file.initial.relative_position_m)
    if distance <= file.limits.keep_out_m:
        expected = f"a start outside of limits.keep_out_m = {file.limits.keep_out_m:g}"
        raise ScenarioError("initial.relative_position_m", file.initial.relative_position_m, expected)


def _check_burns(file: ScenarioFile) -> None:
    """A look-away, centred on the burn, lies between two burn decisions."""
    period, limit, lead = file.rates.formation_period_s, file.pointing.look_away_limit_s, file.formation.lead_s
    if limit > period:
        raise ScenarioError("pointing.look_away_limit_s", limit, f"at most rates.formation_period_s = {period:g}")
    if not 0.5 * limit <= lead <= period - 0.5 * limit:
        between = f"{0.5 * limit:g} to {period - 0.5 * limit:g}"
        raise ScenarioError("formation.lead_s", lead, f"{between}, to fit pointing.look_away_limit_s = {limit:g} in")


def _whole(ratio: float, key: str, found: float, expected: str) -> None:
    if not 0.5 <= ratio < math.inf or not math.isclose(ratio, round(ratio), rel_tol=1e-9):
        raise ScenarioError(key, found, expected)


def _check_dispersion(file: ScenarioFile, index: int, dispersion: Any, seen: set[str]) -> None:
    where = f"dispersions.{index}"
    value = nominal(file, dispersion.key)
    if value is None:
        raise ScenarioError(
            f"{where}.key", dispersion.key, "the key of a number in this scenario, such as 'servicer.mass_kg'"
        )
    if dispersion.key in seen:
        raise ScenarioError(f"{where}.key", dispersion.key, "a key that no other dispersion draws")
    seen.add(dispersion.key)
    shape = np.shape(value)
    expected = {"direction": (3,), "attitude": (4,), "small_rotation": (4,)}.get(dispersion.kind)
    if expected is not None and shape != expected:
        raise ScenarioError(f"{where}.kind", dispersion.kind, f"a key with {expected[0]} components")
    sigma = getattr(dispersion, "sigma", getattr(dispersion, "sigma_deg", 0.0))
    wanted = (3,) if dispersion.kind == "small_rotation" else shape
    if np.ndim(sigma) and np.shape(sigma) != wanted:
        raise ScenarioError(f"{where}.sigma", sigma, f"one number, or numbers of shape {wanted}")
    if dispersion.kind == "choice":
        named = any(isinstance(choice, str) for choice in dispersion.values)
        if named != (dispersion.key == "fault.kind"):
            expected_values = "kinds of fault" if dispersion.key == "fault.kind" else "numbers"
            raise ScenarioError(f"{where}.values", dispersion.values, expected_values)
        if any(np.shape(choice) != shape for choice in dispersion.values):
            raise ScenarioError(f"{where}.values", dispersion.values, f"values of shape {shape}")
    elif dispersion.key in ("fault.kind", "fault.wheel"):
        raise ScenarioError(f"{where}.kind", dispersion.kind, f"'choice' for {dispersion.key}")
    if dispersion.kind == "log_normal" and np.any(np.asarray(value) <= 0.0):
        raise ScenarioError(f"{where}.key", dispersion.key, "a nominal value above zero for a log-normal")
    _check_drawn_values(file, where, dispersion, value)


def _check_drawn_values(file: ScenarioFile, where: str, dispersion: Any, value: Any) -> None:
    """Values that a dispersion is sure to draw, or to come near to, must be acceptable for their key."""
    candidates: dict[str, list[Any]] = {}
    if dispersion.kind == "uniform":
        candidates = {end: [np.full(np.shape(value), getattr(dispersion, end)).tolist()] for end in ("low", "high")}
    elif dispersion.kind == "choice":
        candidates = {"values": dispersion.values}
    for name, drawn in candidates.items():
        for candidate in drawn:
            # The ends of a uniform, all components at once, are drawn by no run: only their limits one by one count.
            fault = _fault(file, dispersion.key, candidate, whole=dispersion.kind == "choice")
            if fault is not None:
                found = getattr(dispersion, name) if dispersion.kind == "uniform" else candidate
                raise ScenarioError(f"{where}.{name}", found, f"what {dispersion.key} can be: {fault}")


def _fault(file: ScenarioFile, key: str, value: Any, whole: bool) -> str | None:
    """Why a key cannot hold a value, or None if it can; `whole` counts checks of all components together too."""
    section_name, _, name = key.partition(".")
    section = getattr(file, section_name)
    try:
        type(section).model_validate({**section.model_dump(), name: value})
    except ValidationError as error:
        for fault in error.errors():
            if whole or fault["type"] != "value_error":
                return fault["msg"].removeprefix("Value error, expected ").removeprefix("Input should be ")
    return None
