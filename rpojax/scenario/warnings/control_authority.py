"""Whether the thruster can give what transfer and station-keeping need."""

import functools

import jax
import numpy as np
from jaxtyping import Array, Float

from rpojax.core import quaternion
from rpojax.core.constants import STANDARD_GRAVITY
from rpojax.flight.guidance.burn_schedule import longest_on_time
from rpojax.flight.guidance.pointing_tuning import PointingTuning
from rpojax.flight.guidance.slew_profile import slew_duration
from rpojax.scenario.numbers.section_records import section_record
from rpojax.scenario.schema import ScenarioFile
from rpojax.scenario.warnings.attitude_authority import attitude_warnings
from rpojax.scenario.warnings.dispersed_reach import DispersedReach
from rpojax.scenario.warnings.nominal_motion import mean_motion, transition_matrices

_USABLE_SHARE = 2.0 / 3.0
"""Share of the thruster's velocity change that the best burns may take; those of the control law are not the best.

`inspection` with a servicer of 100 kg takes 0.55 and all of 64 runs are completed, with 150 kg 0.83 and 4 fail.
"""
HALF_TURN = (np.array([0.0, 1.0, 0.0]), np.array([0.0, -1.0, 0.0]))
"""Sight and push between which the servicer turns by half a turn; which ones does not matter."""
_MOST_BURNS = 100
_ITERATIONS = 40
_LEAST_WEIGHT = 1e-6
_TINY = 1e-12


def control_warnings(file: ScenarioFile, reach: DispersedReach) -> list[str]:
    """Velocity changes per burn period that exceed the thruster's, and errors below its least burn."""
    if file.phases:
        # The station of `formation` is not used; transfers between phases are checked with these. What all of them
        # together fill the wheels with is not.
        return attitude_warnings(file, reach, 0.0)
    transfer, propellant = _transfer(file, reach)
    found = attitude_warnings(file, reach, propellant)
    for what, (needed, available) in (
        ("the way to the station by limits.arrive_by_s", transfer),
        ("holding formation.desired_position_m", _station_keeping(file, reach)),
    ):
        if needed > _USABLE_SHARE * available:
            found.append(
                f"thruster.force_n: {what} takes {1e3 * needed:.3g} mm/s in a burn period, expected at most two "
                f"thirds of {1e3 * available:.3g} mm/s, what the thruster gives within pointing.look_away_limit_s, "
                "turns included"
            )
    return found + _residue_warning(file, reach) + _propellant_warning(reach, propellant)


def largest_delta_v_m_s(file: ScenarioFile, reach: DispersedReach, sight: np.ndarray, push: np.ndarray) -> np.ndarray:
    """Largest velocity changes (...) [m/s] along `push` (..., 3) while the target is in the direction `sight` (..., 3).

    They are zero where the look-away limit leaves less than the least burn.
    """
    on_time = longest_burns_s(file, sight, push)
    on_time = np.where(on_time >= file.thruster.minimum_on_time_s, on_time, 0.0)
    acceleration = reach.low("thruster.force_n") * reach.low("thruster.force_scale") / reach.high("servicer.mass_kg")
    return np.asarray(acceleration * on_time)


def longest_burns_s(file: ScenarioFile, sight: np.ndarray, push: np.ndarray) -> np.ndarray:
    """Time (...) [s] for a burn along `push` (..., 3) that the look-away limit leaves between two turns.

    They are from the camera's look at the target, in the direction `sight` (..., 3), and back.
    """
    pointing = _pointing_tuning(tuple(file.pointing.model_dump().items()))
    thruster, boresight = file.thruster, np.asarray(_boresight(np.array(file.camera.mounting)))
    # The roll about the line of sight is not known; off the boresight the thruster may have to turn by both angles.
    angle = np.minimum(_angle(sight, push) + _angle(boresight, np.array(thruster.direction)), np.pi)
    return np.asarray(_longest_on_times(pointing, angle.ravel(), 1.0 / file.rates.camera_hz)).reshape(angle.shape)


@jax.jit
def _boresight(mounting: Float[Array, "4"]) -> Float[Array, "3"]:
    """Boresight of the camera in B, from its mounting `q_KB`."""
    return quaternion.to_matrix(quaternion.normalize(mounting))[2]


@functools.lru_cache(maxsize=8)
def _pointing_tuning(section: tuple[tuple[str, float], ...]) -> PointingTuning:
    """Record of the section `pointing`, from its entries."""
    return section_record(PointingTuning, dict(section))


@functools.partial(jax.jit, static_argnames="dt")
def _longest_on_times(pointing: PointingTuning, angles: Float[Array, " n"], dt: float) -> Float[Array, " n"]:
    """Longest burns [s] between two turns by angles [rad] within the look-away limit."""
    return jax.vmap(lambda angle: longest_on_time(pointing, slew_duration(pointing, angle), dt))(angles)


def _angle(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Angle [rad] between vectors (..., 3)."""
    size = np.maximum(np.linalg.norm(a, axis=-1) * np.linalg.norm(b, axis=-1), _TINY)
    return np.asarray(np.arccos(np.clip(np.sum(a * b, axis=-1) / size, -1.0, 1.0)))


def _transfer(file: ScenarioFile, reach: DispersedReach) -> tuple[tuple[float, float], float]:
    """Burn on the way to the station that is hardest for the thruster, what it can give there, and the sum of all.

    Of the starts that the dispersions reach the one that asks most, to rest at the station; all in m/s.
    """
    n, lead, period = mean_motion(file), file.formation.lead_s, file.rates.formation_period_s
    arrival = min(reach.low("limits.arrive_by_s"), lead + _MOST_BURNS * period)
    ignitions = np.arange(lead, arrival, period)
    if len(ignitions) == 0:
        return (0.0, 0.0), 0.0
    drift, *after_burns = transition_matrices(n, arrival - np.append(0.0, ignitions))
    motion = np.array(after_burns)[:, :, 3:]
    station = reach.middle("formation.desired_position_m")
    worst, total = (0.0, 0.0), 0.0
    for start in reach.axis_extremes("initial.relative_position_m", "initial.relative_velocity_m_s"):
        fraction = (ignitions / arrival)[:, None]
        sight = -(start[:3] + fraction * (station - start[:3]))
        change = np.concatenate([station, np.zeros(3)]) - drift @ start
        needed, available = _smallest_burns(file, reach, motion, change, sight)
        total = max(total, float(needed.sum()))
        hardest = int(np.argmax(needed / np.maximum(available, _TINY)))
        if needed[hardest] * max(worst[1], _TINY) > worst[0] * max(available[hardest], _TINY):
            worst = (float(needed[hardest]), float(available[hardest]))
    return worst, total


def _smallest_burns(
    file: ScenarioFile, reach: DispersedReach, motion: np.ndarray, change: np.ndarray, sight: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Burns (b,) [m/s] that make a change (6,) through `motion` (b, 6, 3), and what the thruster can give there.

    Least squares, weighted so that the largest share of what the thruster gives becomes as small as possible (Lawson's
    algorithm). `sight` (b, 3) is the direction of the target.
    """
    period = file.rates.formation_period_s
    # A velocity counts as the distance that it makes in a period.
    units = np.array([1.0, 1.0, 1.0, period, period, period])
    influence, wanted = motion * units[:, None], change * units
    weights = np.ones(len(motion))
    needed = available = np.zeros(len(motion))
    for _ in range(_ITERATIONS):
        effect = np.einsum("b,bij,bkj->ik", 1.0 / weights, influence, influence)
        burns = np.einsum("bij,i->bj", influence, np.linalg.pinv(effect) @ wanted) / weights[:, None]
        needed = np.linalg.norm(burns, axis=1)
        available = largest_delta_v_m_s(file, reach, sight, burns)
        shares = weights * needed / np.maximum(available, _TINY)
        weights = np.maximum(shares / max(float(shares.max()), _TINY), _LEAST_WEIGHT)
    return needed, available


def _station_keeping(file: ScenarioFile, reach: DispersedReach) -> tuple[float, float]:
    """Velocity change in a burn period against the relative acceleration at the station, and what there is [m/s]."""
    n = mean_motion(file)
    stations = reach.axis_extremes("formation.desired_position_m")
    push = n * n * file.rates.formation_period_s * stations * np.array([-3.0, 0.0, 1.0])
    needed = np.linalg.norm(push, axis=1)
    available = largest_delta_v_m_s(file, reach, -stations, push)
    hardest = int(np.argmax(needed / np.maximum(available, _TINY)))
    return float(needed[hardest]), float(available[hardest])


def _residue_warning(file: ScenarioFile, reach: DispersedReach) -> list[str]:
    """The largest velocity error that is not corrected, if it leaves the station within a burn period."""
    thruster, period = file.thruster, file.rates.formation_period_s
    least_burn = 1e3 * thruster.minimum_on_time_s * thruster.force_n / reach.low("servicer.mass_kg")
    dead_band = reach.high("formation.dead_band_mm_s")
    residue, key = max((least_burn, "thruster.minimum_on_time_s"), (dead_band, "formation.dead_band_mm_s"))
    drift = 1e-3 * residue * period
    if drift <= file.limits.off_station_m:
        return []
    return [
        f"{key}: velocity errors below {residue:.3g} mm/s are not corrected, which is {drift:.3g} m in a burn period, "
        f"expected at most limits.off_station_m = {file.limits.off_station_m:g}"
    ]


def _propellant_warning(reach: DispersedReach, total_m_s: float) -> list[str]:
    needed = reach.high("servicer.mass_kg") * total_m_s / (STANDARD_GRAVITY * reach.low("thruster.specific_impulse_s"))
    carried = reach.low("limits.propellant_kg")
    if needed <= carried:
        return []
    found = f"the way to the station takes {needed:.3g} kg of propellant"
    return [f"limits.propellant_kg: {found}, expected at most {carried:g}"]
