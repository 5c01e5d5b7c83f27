"""Causes in the vehicle: injected faults, wheels, thrust, propellant, star tracker."""

from collections.abc import Iterator
from typing import Final

import numpy as np

from rpojax.analysis.failure_causes.finding import Depth, Finding, median, number, percent
from rpojax.analysis.failure_causes.present_values import at_least, at_most, change
from rpojax.analysis.failure_causes.run_evidence import Flags, RunEvidence
from rpojax.core.constants import STANDARD_GRAVITY
from rpojax.physics.equipment_faults import KINDS, STUCK_OPEN
from rpojax.scenario.warnings.control_authority import HALF_TURN, largest_delta_v_m_s, longest_burns_s
from rpojax.simulation.outcomes.outcome_kinds import Outcome

_CERTAIN: Final = 2.0
"""Strength of what is shown or not, without a measure."""
_SATURATED: Final = 0.98
"""Share of a wheel's speed limit from which on it gives no more torque."""
_AT_LIMIT: Final = 1.0
"""Mean burn of a few periods over the longest after half a turn, from which on the thruster may be too weak. A choice:
`inspection` takes up to 1, and with 2 mN, where 7 of 16 runs fail, all take 2."""
_PERIODS: Final = 4
"""Burn periods over which that is measured."""
_BLIND: Final = 0.5
"""Share of the time without star tracker from which on it is blind."""
_SLEWS: Final = "pointing.slew_acceleration_mrad_s2"


def findings(evidence: RunEvidence) -> Iterator[Finding]:
    """Findings of the runs."""
    yield from faults(evidence)
    yield wheels(evidence)
    yield authority(evidence)
    yield coarse_burns(evidence)
    yield propellant(evidence)
    if evidence.has_signs:
        yield star_tracker(evidence)


def faults(evidence: RunEvidence) -> Iterator[Finding]:
    """Faults that were injected and began before the run failed, one finding for each kind of each fault."""
    for fault in evidence.file.faults if evidence.file.effects.faults else ():
        codes = np.round(evidence.value(f"faults.{fault.name}.kind")).astype(int)
        for code in np.unique(codes).tolist():
            if KINDS[code] != "none":
                yield _injected(evidence, fault.name, KINDS[code], codes == code)


def _injected(evidence: RunEvidence, fault: str, kind: str, is_kind: Flags) -> Finding:
    """The fault of a name in the runs in which it is of a kind."""
    start_s = evidence.value(f"faults.{fault}.start_s").astype(float)
    end_s = start_s + evidence.value(f"faults.{fault}.duration_s")
    name = kind.replace("_", " ")

    def words(chosen: Flags) -> str:
        lasting = median(np.minimum(end_s, evidence.until_s) - start_s, chosen)
        found = f"the injected fault {name} acts from {number(median(start_s, chosen))} s on, for"
        return f"{found} {number(lasting)} s{_isolated(evidence, kind, chosen)}"

    return Finding(
        "fault",
        f"injected fault: {name}",
        Depth.EQUIPMENT,
        np.where(is_kind & (start_s < evidence.until_s), _CERTAIN, 0.0),
        start_s,
        words,
        lambda _: _mended_fault(evidence, fault, kind),
    )


def _isolated(evidence: RunEvidence, kind: str, chosen: Flags) -> str:
    """When a thruster that is stuck open was shut off, or that it was not; empty for other kinds of fault."""
    if kind != STUCK_OPEN:
        return ""
    if not evidence.file.isolates_thrusters:
        return ", and nothing shuts the thruster off"
    # Not cut at an abort, after which an open thruster still burns.
    delay = np.asarray(evidence.metrics.get("isolation_delay_s", np.full(evidence.count, np.nan)), dtype=float)
    after = median(delay, chosen)
    return f"; the thruster is shut off after {number(after)} s" if np.isfinite(after) else ""


def _mended_fault(evidence: RunEvidence, fault: str, kind: str) -> str:
    """What helps against a kind of fault."""
    file = evidence.file
    # The others of a list take the place of one whose failure is known.
    is_of_list = bool(file.thrusters) and kind.startswith("thruster_")
    needed = {"chamber_pressure": file.chamber_pressure.enabled or not is_of_list}
    if kind == STUCK_OPEN:
        needed["isolation"] = file.isolation.enabled
    if not all(needed.values()):
        return " and ".join(change(file, f"{name}.enabled", "true") for name, has in needed.items() if not has)
    return f"equipment in reserve, or a shorter faults.{fault}.duration_s"


def wheels(evidence: RunEvidence) -> Finding:
    """Wheels reach their greatest speed."""
    speed = evidence.trace("wheel_speed_fraction")
    peak = np.max(np.where(np.isfinite(speed), speed, 0.0), axis=1, initial=0.0)
    at_s = evidence.first_s(speed >= _SATURATED)
    wheels_of_file = evidence.file.wheels
    loaded = np.max(np.abs(wheels_of_file.initial_speed_rad_s) / np.array(wheels_of_file.speed_limit_rad_s))
    held = np.array(wheels_of_file.inertia_kg_m2) * np.array(wheels_of_file.speed_limit_rad_s)

    def words(chosen: Flags) -> str:
        begin = f"; they start at {percent(float(loaded))}" if loaded > 0.1 else ""
        return (
            f"a wheel reaches its greatest speed ({percent(median(peak, chosen))} of {number(float(held.min()))} "
            f"N m s, first at {number(median(at_s, chosen))} s{begin})"
        )

    def mend(_: Flags) -> str:
        if loaded > 0.5:
            return f"{change(evidence.file, 'wheels.initial_speed_rad_s', 'near 0')} before the start"
        faster = change(
            evidence.file, "wheels.speed_limit_rad_s", [2.0 * each for each in wheels_of_file.speed_limit_rad_s]
        )
        return f"wheels of {number(2.0 * float(held.min()))} N m s ({faster}), or a smaller {_SLEWS}"

    strength = np.where(peak >= _SATURATED, _CERTAIN, peak / _SATURATED * 0.99)
    return Finding("wheels", "wheels are saturated", Depth.ROOT, strength, at_s, words, mend, may_follow=True)


def _periods_s(evidence: RunEvidence) -> float:
    """Longest burn period of the scenario [s]."""
    own = [phase.control_period_s or evidence.file.rates.formation_period_s for phase in evidence.file.phases]
    return max(own, default=evidence.file.rates.formation_period_s)


def _available_m_s(evidence: RunEvidence) -> float:
    """Velocity change that the longest burn after a half turn gives [m/s], by the nominal vehicle."""
    return float(largest_delta_v_m_s(evidence.file, evidence.reach, *HALF_TURN))


def authority(evidence: RunEvidence) -> Finding:
    """Burns are as long as they may be and do not stop the drift."""
    file, period_s, available = evidence.file, _periods_s(evidence), _available_m_s(evidence)
    spent = evidence.trace("delta_v_m_s")
    step = 1 if len(evidence.time_s) < 2 else max(1, round(_PERIODS * period_s / float(np.diff(evidence.time_s).min())))
    gained = spent[:, step:] - spent[:, :-step]
    most = np.max(np.where(np.isfinite(gained), gained, 0.0), axis=1, initial=0.0) / _PERIODS
    share = most / available if available > 0.0 else np.zeros(evidence.count)
    off = _off_station(evidence)

    def words(chosen: Flags) -> str:
        return (
            f"burns took {number(1e3 * median(most, chosen))} mm/s in a period, and within the look-away limit the "
            f"thruster gives {number(1e3 * available)} mm/s after half a turn"
        )

    def mend(chosen: Flags) -> str:
        wanted = file.thruster.force_n * max(2.0, 1.5 * median(share, chosen) / _AT_LIMIT)
        return f"{change(file, 'thruster.force_n', wanted)}, or a longer pointing.look_away_limit_s"

    title, strength = "the thruster is too weak", np.where(off.any(axis=1), share / _AT_LIMIT, 0.0)
    return Finding("authority", title, Depth.ROOT, strength, evidence.first_s(off), words, mend, may_follow=True)


def _off_station(evidence: RunEvidence) -> Flags:
    """(runs, samples) whether a run is farther off than `limits.off_station_m` after its arrival."""
    error = evidence.trace("formation_error_m")
    late = np.resize(evidence.time_s, error.shape[1]) >= evidence.value("limits.arrive_by_s")[:, None]
    return np.asarray((error > evidence.value("limits.off_station_m")[:, None]) & late)


def coarse_burns(evidence: RunEvidence) -> Finding:
    """The least burn is too much, or longer than a burn may be, or the dead band is too wide."""
    file, available, period_s = evidence.file, _available_m_s(evidence), _periods_s(evidence)
    acceleration = file.thruster.force_n * evidence.value("thruster.force_scale") / evidence.value("servicer.mass_kg")
    by_burn, by_band = file.thruster.minimum_on_time_s * acceleration, 1e-3 * file.formation.dead_band_mm_s
    least = np.maximum(by_burn, by_band)
    drift_m, off_m = least * period_s, evidence.value("limits.off_station_m")
    strength = 2.0 * drift_m / off_m
    if available <= 0.0:
        strength = np.full(evidence.count, _CERTAIN)
    left_s = float(longest_burns_s(file, *HALF_TURN)) if available <= 0.0 else np.inf
    is_band = available > 0.0 and bool(np.median(by_burn) < by_band)
    title = "the dead band is too wide" if is_band else "the least burn is too long"

    def words(chosen: Flags) -> str:
        change_mm_s, metres = number(1e3 * median(least, chosen)), number(median(drift_m, chosen))
        if is_band:
            return f"{title}: errors below {change_mm_s} mm/s are not corrected, {metres} m in a burn period"
        found = f"{title}: {number(file.thruster.minimum_on_time_s)} s give {change_mm_s} mm/s, {metres} m in a burn "
        found += "period, and smaller errors are not corrected"
        if available > 0.0:
            return found
        return f"{found}; half a turn and back leave {number(left_s)} s for a burn within the look-away limit"

    def mend(chosen: Flags) -> str:
        share = 0.5 * median(off_m, chosen) / median(drift_m, chosen)
        if is_band:
            return at_most(file, "formation.dead_band_mm_s", share * file.formation.dead_band_mm_s)
        longest_s = min(share * file.thruster.minimum_on_time_s, left_s)
        wanted = at_most(file, "thruster.minimum_on_time_s", longest_s)
        if share < 1.0:
            return wanted
        longer_s = file.pointing.look_away_limit_s + file.thruster.minimum_on_time_s - left_s
        return f"{wanted}, or {at_least(file, 'pointing.look_away_limit_s', longer_s)}"

    at_s = evidence.first_s(_off_station(evidence))
    return Finding("authority", title, Depth.ROOT, strength, at_s, words, mend)


def propellant(evidence: RunEvidence) -> Finding:
    """The propellant is used up."""
    file = evidence.file
    spent = evidence.trace("delta_v_m_s")
    mass = evidence.value("servicer.mass_kg")[:, None]
    used = mass * -np.expm1(-spent / (STANDARD_GRAVITY * file.thruster.specific_impulse_s))
    limit = evidence.value("limits.propellant_kg")
    most = np.max(np.where(np.isfinite(used), used, 0.0), axis=1, initial=0.0)
    out = evidence.outcomes == str(Outcome.OUT_OF_PROPELLANT)

    def words(chosen: Flags) -> str:
        since = median(evidence.failed_at_s, chosen)
        return f"the propellant of {number(median(limit, chosen))} kg is used up at {number(since)} s"

    def mend(_: Flags) -> str:
        if evidence.completed.any():
            taken_kg = float(most[evidence.completed].max())
            return f"{at_least(file, 'limits.propellant_kg', taken_kg)}, as completed runs take"
        return "a larger limits.propellant_kg"

    return Finding(
        "propellant",
        "propellant is used up",
        Depth.ROOT,
        np.where(out, _CERTAIN, 0.0),
        evidence.failed_at_s,
        words,
        mend,
    )


def star_tracker(evidence: RunEvidence) -> Finding:
    """The star tracker is blind."""
    blind, ticks = evidence.sign("no_star_tracker"), evidence.sign("ticks")
    share, at_s = evidence.worst_share(blind, ticks)
    whole = blind.sum(axis=1) / np.maximum(ticks.sum(axis=1), 1)

    def words(chosen: Flags) -> str:
        return (
            f"the star tracker is blind in {percent(median(share, chosen))} of the worst ten minutes "
            f"({percent(median(whole, chosen))} of the time)"
        )

    def mend(_: Flags) -> str:
        return "another star_tracker.boresight, or a baffle for a smaller star_tracker.sun_exclusion_deg"

    return Finding("star_tracker", "the star tracker is blind", Depth.ROOT, share / _BLIND, at_s, words, mend)
