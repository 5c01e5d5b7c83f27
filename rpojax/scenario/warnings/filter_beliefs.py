"""What the filters believe of sensors, burns, target and hand-over, against what the scenario declares."""

from collections.abc import Iterator, Sequence

import numpy as np

from rpojax.flight.navigation import differential_drag
from rpojax.physics.equipment_faults import LEAKS
from rpojax.scenario.numbers.start_and_limits import HANDOVER_KEYS
from rpojax.scenario.schema import ScenarioFile
from rpojax.scenario.warnings.dispersed_reach import DispersedReach
from rpojax.scenario.warnings.target_size import mean_size

MOST_OVER = 1.5
"""True error over the believed one above which a filter is over-confident."""
MOST_UNDER = 4.0
"""Believed over true error above which a filter wastes its measurements."""
_MOST_SIZE_ERROR = 1.1
"""True over believed size of the target, or the reverse, that needs no `navigation.target_size_sigma`."""
_SIZE, _SIZE_SIGMA = "navigation.target_size_m", "navigation.target_size_sigma"
_SIZE_SIGMAS = 3.0
"""Error of the log of the size in its sigmas that is no cause for a warning: a normal dispersion reaches as far."""
_SIZE_ROUNDING = 1.01
"""Factor for the rounding of a belief that is written down."""
_THRUSTER_FAULTS = ("thruster_off", "thruster_weak", *LEAKS)
_TINY = 1e-30
_TOO_WIDE = ", expected at least the "
"""Of warnings about beliefs that doubt more than they need to."""
_WITHOUT_AIR_M = 7.5e6
"""Semi-major axis from which drag is less than the pressure of sunlight, some 1100 km up."""

Belief = tuple[str, str, float, float]
"""Key of a belief, key of the truth, value of the truth at most, and value believed."""


def belief_warnings(file: ScenarioFile, reach: DispersedReach) -> list[str]:
    """Beliefs that differ too much from what the scenario declares."""
    beliefs = [*_sensor_beliefs(file, reach), *_error_beliefs(file, reach), *_handover_beliefs(file, reach)]
    found = judged_beliefs(beliefs) + _time_constant(file, reach) + _target_size(file, reach)
    return found + _unmeasured_thrust(file, reach)


def judged_beliefs(beliefs: Sequence[Belief]) -> list[str]:
    """Warnings about beliefs that are too far from the truth."""
    found = []
    for key, of_truth, truth, believed in beliefs:
        both = f"{key}: the filter believes {believed:.4g}, the truth is {truth:.4g} by {of_truth}"
        if truth > MOST_OVER * believed:
            words = f"{truth / believed:.3g} times as much, " if believed > 0.0 else ""
            found.append(f"{both}, {words}expected at most {MOST_OVER:g} times{'' if words else ' as much'}")
        elif 0.0 < MOST_UNDER * truth < believed:
            found.append(f"{both}, the {believed / truth:.3g}th part{_TOO_WIDE}{MOST_UNDER:g}th")
    return found


def is_conservative(warning: str) -> bool:
    """Whether a warning is about a belief that doubts more than it needs to, which makes no filter sure of itself."""
    return _TOO_WIDE in warning


def _sensor_beliefs(file: ScenarioFile, reach: DispersedReach) -> Iterator[Belief]:
    """Beliefs of the filters that have a counterpart in the section of a sensor."""
    pairs = [
        ("navigation.gps_noise_m", "gps.noise_m"),
        ("navigation.gps_error_sigma_m", "gps.bias_sigma_m"),
        ("attitude_filter.star_tracker_noise_deg", "star_tracker.noise_deg"),
        ("attitude_filter.angle_random_walk_deg_sqrt_s", "gyro.angle_random_walk_deg_sqrt_s"),
        ("attitude_filter.bias_walk_deg_s_sqrt_s", "gyro.bias_walk_deg_s_sqrt_s"),
        ("attitude_filter.initial_bias_sigma_deg_s", "gyro.initial_bias_sigma_deg_s"),
    ]
    if file.camera.model == "geometric":
        pairs.append(("navigation.edge_noise_px", "camera.edge_noise_px"))
    if file.chamber_pressure.enabled:
        pairs.append(("navigation.pressure_noise", "chamber_pressure.noise"))
    for key, of_truth in pairs:
        truth, believed = np.ravel(reach.ends(of_truth)[1]), np.ravel(reach.middle(key))
        worst = int(np.argmax(truth / np.maximum(believed, _TINY)))
        yield key, of_truth, float(truth[worst]), float(believed[worst])


def _error_beliefs(file: ScenarioFile, reach: DispersedReach) -> Iterator[Belief]:
    """Beliefs of errors that have a random and a constant part in truth."""
    pointing = np.hypot(_constant(reach, "camera.misalignment_deg"), _constant(reach, "star_tracker.misalignment_deg"))
    key = "navigation.bearing_bias_sigma_deg"
    yield key, "camera and star_tracker.misalignment_deg", float(pointing), float(reach.middle(key))
    lasting, noise = _constant(reach, "thruster.force_scale", 1.0), reach.high("thruster.magnitude_noise")
    key, of_scale = "navigation.burn_magnitude_sigma", "navigation.burn_scale_sigma"
    # Either takes the lasting error: as new in each burn, or as a state.
    believed = np.hypot(reach.middle(key), reach.middle(of_scale))
    of_truth, thrust = "thruster.magnitude_noise and force_scale", float(np.hypot(noise, lasting))
    if (reach.ends("servicer.mass_kg") != file.servicer.mass_kg).any():
        with_mass = float(np.hypot(noise, _burn_scale_error(file, reach)))
        yield key, f"{of_truth}, and servicer.mass_kg", with_mass, float(believed)
    else:
        yield key, of_truth, thrust, float(believed)
    if file.chamber_pressure.enabled:
        key = "navigation.thrust_sigma"
        yield key, of_truth, thrust, float(reach.middle(key))
    direction = np.hypot(reach.high("thruster.direction_noise_deg"), _constant(reach, "thruster.misalignment_deg"))
    key, lasting_key = "navigation.burn_direction_sigma_deg", "navigation.thrust_direction_sigma_deg"
    believed = float(np.hypot(reach.middle(key), reach.middle(lasting_key)))
    yield key, "thruster.direction_noise_deg and misalignment_deg", float(direction), believed
    if file.camera.model == "geometric":
        false, missed = reach.high("camera.outlier_probability"), reach.high("camera.miss_probability")
        key, of_truth = "navigation.miss_probability", "camera.miss_probability and outlier_probability"
        yield key, of_truth, missed + (1.0 - missed) * false, float(reach.middle(key))
    if (file.effects.drag or file.effects.solar_pressure) and file.navigation.sharing == "none":
        key = "navigation.ballistic_sigma_m2_kg"
        yield (
            key,
            "areas, masses and coefficients of both, and air",
            _ballistic_difference(file, reach),
            float(reach.middle(key)),
        )


def _ballistic_difference(file: ScenarioFile, reach: DispersedReach) -> float:
    """Area over mass of the target less that of the servicer [m^2/kg], for the coefficients and the air of the filter.

    It is the root mean square of what dispersions of areas, masses, coefficients and density reach.
    """

    def of(craft: str, coefficient: str, believed: float, air: float) -> tuple[float, float]:
        keys = [f"{craft}_surface.area_m2", f"{craft}_surface.{coefficient}", f"{craft}.mass_kg"]
        area, true, mass = (float(reach.middle(key)) for key in keys)
        found = area * true / believed / mass * air
        return found, found * float(np.linalg.norm([_relative_spread(reach, key) for key in keys]))

    kinds = []
    if file.effects.drag and reach.low("orbit.semi_major_axis_m") < _WITHOUT_AIR_M:
        air = float(reach.middle("atmosphere.density_kg_m3")) / max(file.atmosphere.density_kg_m3, _TINY)
        kinds.append(("drag_coefficient", differential_drag.DRAG_COEFFICIENT, air))
    if file.effects.solar_pressure:
        kinds.append(("pressure_coefficient", differential_drag.PRESSURE_COEFFICIENT, 1.0))
    differences = []
    for kind in kinds:
        (target, target_spread), (servicer, servicer_spread) = of("target", *kind), of("servicer", *kind)
        differences.append(np.linalg.norm([target - servicer, target_spread, servicer_spread]))
    return float(max(differences, default=0.0))


def _relative_spread(reach: DispersedReach, key: str) -> float:
    """Standard deviation of a number over its middle, if its dispersion reaches three sigma."""
    low, high = reach.ends(key)
    return float((high - low) / 6.0 / max(abs(0.5 * (low + high)), _TINY))


def _burn_scale_error(file: ScenarioFile, reach: DispersedReach) -> float:
    """Root mean square of the lasting relative error of burns, by thrust and by a mass that is not as known on board.

    The ends of dispersions are three sigma.
    """
    of_thrust, of_mass = "thruster.force_scale", "servicer.mass_kg"
    ratio = float(reach.middle(of_thrust) / reach.middle(of_mass)) * file.servicer.mass_kg
    spread = np.hypot(_relative_spread(reach, of_thrust), _relative_spread(reach, of_mass))
    return float(np.hypot(ratio - 1.0, ratio * spread))


def _constant(reach: DispersedReach, key: str, ideal: float = 0.0) -> float:
    """Root mean square of a constant error, whose dispersion reaches three sigma; of the worst component."""
    low, high = reach.ends(key)
    return float(np.max(np.hypot(0.5 * (low + high) - ideal, (high - low) / 6.0)))


def _unmeasured_thrust(file: ScenarioFile, reach: DispersedReach) -> list[str]:
    """Faults of the thruster of which flight software learns nothing."""
    if not file.effects.faults or file.chamber_pressure.enabled:
        return []
    kinds = reach.fault_kinds
    found = [kind for kind in _THRUSTER_FAULTS if kind in kinds]
    return [
        f"chamber_pressure.enabled: found false with a fault of the kind {kind!r}, expected true, or flight software "
        + ("does not notice it" if kind in LEAKS else "believes that burns give their full velocity change")
        for kind in found[:1]
    ]


def _handover_beliefs(file: ScenarioFile, reach: DispersedReach) -> Iterator[Belief]:
    """Errors of the hand-over that the filter is told, against the true ones where the scenario has them."""
    handover = file.initial.handover
    if handover is None:
        return
    for index, name in enumerate(HANDOVER_KEYS):
        told = float(reach.middle(f"navigation.initial_{name}"))
        if handover.covariance is not None:
            variances = np.diag(np.array(handover.covariance))[3 * index : 3 * index + 3]
            yield f"navigation.initial_{name}", "initial.handover.covariance", float(np.sqrt(variances.max())), told
        elif getattr(handover, name) is not None:
            true = float(np.max(reach.ends(f"initial.handover.{name}")[1]))
            yield f"navigation.initial_{name}", f"initial.handover.{name}", true, told


def _time_constant(file: ScenarioFile, reach: DispersedReach) -> list[str]:
    key, of_truth = "navigation.gps_error_time_constant_s", "gps.bias_time_constant_s"
    believed, (low, high) = float(reach.middle(key)), reach.ends(of_truth)
    if file.gps.bias_sigma_m == 0.0 or (believed / MOST_UNDER <= low and high <= believed * MOST_UNDER):
        return []
    truth = float(high if high > believed * MOST_UNDER else low)
    return [
        f"{key}: the filter believes {believed:.4g}, the truth is {truth:.4g} by {of_truth}, "
        f"expected within a factor of {MOST_UNDER:g}"
    ]


def _target_size(file: ScenarioFile, reach: DispersedReach) -> list[str]:
    nominal, (low, high) = mean_size(file.target.hull_m), reach.ends("target.scale")
    believed, sigma = float(reach.middle(_SIZE)), float(reach.middle(_SIZE_SIGMA))
    tolerated = max(np.log(_MOST_SIZE_ERROR), _SIZE_SIGMAS * sigma + np.log(_SIZE_ROUNDING))
    worst = max((nominal * low, nominal * high), key=lambda size: abs(np.log(size / believed)))
    if abs(np.log(worst / believed)) <= tolerated:
        return []
    side = "" if low == high else "up to " if worst > believed else "down to "
    spans = " x ".join(f"{span * worst / nominal:.3g}" for span in np.ptp(np.array(file.target.hull_m), axis=0))
    return [
        f"{_SIZE}: the filter believes {believed:.4g} m, and the root of width times height in the picture of a hull "
        f"of {spans} m, target.scale included, in the mean over all attitudes is {side}{worst:.4g} m: ranges are "
        f"estimated {max(worst / believed, believed / worst):.3g} times too {'near' if worst > believed else 'far'}, "
        f"expected at most {np.exp(tolerated):.3g} with {_SIZE_SIGMA} = {sigma:g}"
    ]
