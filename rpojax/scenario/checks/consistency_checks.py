"""Checks of a scenario that span sections: integer ratios of rates, a feasible vehicle, valid dispersions."""

import math

from rpojax.errors import ScenarioError
from rpojax.scenario.checks.dispersion_checks import check_dispersions
from rpojax.scenario.checks.lamp_checks import check_lamp
from rpojax.scenario.checks.landmark_checks import check_landmarks
from rpojax.scenario.checks.listed_design_checks import check_design
from rpojax.scenario.checks.optics_checks import check_optics
from rpojax.scenario.checks.phase_checks import check_phases
from rpojax.scenario.checks.ranging_checks import check_ranging
from rpojax.scenario.checks.requirement_checks import check_requirements
from rpojax.scenario.checks.target_checks import check_target
from rpojax.scenario.checks.target_frame_checks import check_target_frame
from rpojax.scenario.checks.thruster_checks import check_faults, check_thrusters
from rpojax.scenario.checks.wide_lens_checks import check_wide_lens
from rpojax.scenario.measurement_delays import check_delays
from rpojax.scenario.schema import ScenarioFile
from rpojax.scenario.sections import OrbitSection
from rpojax.scenario.trained.coverage_surface import mesh_path

_LONGEST_COMMAND_DELAY_S = 2.0
"""Longest delay of a command [s]: attitude control of half a rad/s bandwidth is not stable beyond."""
_MIN_PERIGEE_M = 6.47e6
"""Least radius of the perigee [m], some 100 km above the ground."""


def check_consistency(file: ScenarioFile) -> None:
    """Checks all conditions of a scenario that span sections.

    Raises:
        ScenarioError: naming the key, what was found and what was expected.
    """
    rates = file.rates
    _check_whole_number(
        rates.plant_hz / rates.camera_hz, "rates.plant_hz", rates.plant_hz, "a whole multiple of rates.camera_hz"
    )
    _check_whole_number(
        rates.formation_period_s * rates.camera_hz,
        "rates.formation_period_s",
        rates.formation_period_s,
        "a whole number of camera periods",
    )
    _check_whole_number(
        file.duration_s * rates.camera_hz, "duration_s", file.duration_s, "a whole number of camera periods"
    )
    steps = rates.command_delay_s * rates.plant_hz
    if not math.isclose(steps, round(steps), abs_tol=1e-9) or rates.command_delay_s > _LONGEST_COMMAND_DELAY_S:
        expected = f"a whole number of plant steps, at most {_LONGEST_COMMAND_DELAY_S:g} s"
        raise ScenarioError("rates.command_delay_s", rates.command_delay_s, expected)
    if file.camera.outlier_size_min_px > file.camera.outlier_size_max_px:
        raise ScenarioError(
            "camera.outlier_size_min_px", file.camera.outlier_size_min_px, "at most camera.outlier_size_max_px"
        )
    _check_orbit(file.orbit)
    _check_vehicle(file)
    check_target_frame(file)
    _check_burn_timing(file)
    distance = math.hypot(*file.formation.desired_position_m)
    if not file.phases and distance <= file.limits.keep_out_m:
        raise ScenarioError(
            "formation.desired_position_m",
            file.formation.desired_position_m,
            f"a place farther from the target than limits.keep_out_m = {file.limits.keep_out_m:g}",
        )
    _check_precision(file)
    check_requirements(file)
    mesh_path(file.model_dump())
    check_target(file)
    check_thrusters(file)
    check_phases(file)
    check_ranging(file)
    check_landmarks(file)
    check_delays(file)
    check_lamp(file)
    check_wide_lens(file)
    check_optics(file)
    check_dispersions(file)
    check_design(file)
    check_faults(file)


def _check_precision(file: ScenarioFile) -> None:
    """Allows single precision only with settings for which it has been compared with double precision."""
    if file.precision == "double":
        return
    model, integrator = file.camera.model, file.effects.integrator
    plant_hz, duration_s = file.rates.plant_hz, file.duration_s
    for key, found, known, expected in (
        ("camera.model", model, model != "rendered", "'geometric' or 'statistical'"),
        ("effects.integrator", integrator, integrator == "rk4", "'rk4'"),
        ("rates.plant_hz", plant_hz, plant_hz <= _MAX_SINGLE_PLANT_HZ, f"at most {_MAX_SINGLE_PLANT_HZ:g}"),
        ("duration_s", duration_s, duration_s <= _MAX_SINGLE_DURATION_S, f"at most {_MAX_SINGLE_DURATION_S:g}"),
    ):
        if not known:
            raise ScenarioError(key, found, f"{expected} with precision = 'single'")


_MAX_SINGLE_DURATION_S = 20000.0
"""Longest duration [s] at which the precisions have been compared; after a day their means differ."""
_MAX_SINGLE_PLANT_HZ = 50.0
"""Highest rate [Hz]; a relative position of 50 m is accurate to 0.1 mm at this rate, to 2 cm at 1000 Hz."""


def _check_orbit(orbit: OrbitSection) -> None:
    perigee = orbit.semi_major_axis_m * (1.0 - orbit.eccentricity)
    if perigee <= _MIN_PERIGEE_M:
        expected = f"a perigee above {_MIN_PERIGEE_M:g} m, and semi_major_axis_m makes it {perigee:.6g} m"
        raise ScenarioError("orbit.eccentricity", orbit.eccentricity, expected)


def _check_vehicle(file: ScenarioFile) -> None:
    """Checks vehicle parameters against each other."""
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


def _check_burn_timing(file: ScenarioFile) -> None:
    """Checks that a look-away, centred on the burn, fits between two burn decisions."""
    period, limit, lead = file.rates.formation_period_s, file.pointing.look_away_limit_s, file.formation.lead_s
    if not file.turns_for_burns:
        return
    if limit > period:
        raise ScenarioError("pointing.look_away_limit_s", limit, f"at most rates.formation_period_s = {period:g}")
    if not 0.5 * limit <= lead <= period - 0.5 * limit:
        between = f"{0.5 * limit:g} to {period - 0.5 * limit:g}"
        raise ScenarioError("formation.lead_s", lead, f"{between}, to fit pointing.look_away_limit_s = {limit:g} in")


def _check_whole_number(ratio: float, key: str, found: float, expected: str) -> None:
    if not 0.5 <= ratio < math.inf or not math.isclose(ratio, round(ratio), rel_tol=1e-9):
        raise ScenarioError(key, found, expected)
