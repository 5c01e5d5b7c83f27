"""Distances, phases, limits, hand-over and requirements of a mission."""

import math
from dataclasses import dataclass
from typing import Any

from rpojax.scenario.own_mission.choices import Choice, Choices, tidy, tidy_all, up_to
from rpojax.scenario.own_mission.facts import MissionFacts
from rpojax.scenario.own_mission.servicer import Times
from rpojax.scenario.own_mission.target_outline import Outline

_TIME_CONSTANT = 4.0
"""Remaining distance of an approach over its speed, in burn periods."""
_HOLD_PERIODS, _END_PERIODS, _STATION_PERIODS, _ARRIVE_PERIODS = 8, 12, 30, 15
_KNOWN, _SPREAD = 0.03, 0.04
"""Error of the hand-over and spread of the start, over the distance at the start."""
_SPEED_M_S, _OF_M = 0.01, 50.0
"""Those of the velocity in a low orbit, of that distance."""
_LEAST_WIDTH_M = 0.8
_ABORT_MARGIN_M = 2.0
"""That which a mission has unless it says another."""
_CONFIDENCE = {"probability": 0.99, "consumer_risk": 0.1}


@dataclass(frozen=True)
class ApproachTimes:
    """Times and speeds of an approach.

    Attributes:
        constant_s: remaining distance over the speed
        speed_m_s: greatest
        last_speed_m_s: least
        duration_s: of the way
    """

    constant_s: float
    speed_m_s: float
    last_speed_m_s: float
    duration_s: float


def approach_times(facts: MissionFacts, times: Times) -> ApproachTimes:
    """Times of the approach from the first station to the last."""
    constant, way = _TIME_CONSTANT * times.period_s, facts.hold_m - facts.nearest_m
    last = tidy(facts.nearest_m / (2.0 * constant), 2)
    speed = max(tidy(way / (3.0 * constant), 2), last)
    falling = constant * math.log(max(min(way, speed * constant) / (last * constant), 1.0))
    duration = max(way - speed * constant, 0.0) / speed + falling + min(way / last, constant)
    return ApproachTimes(constant, speed, last, duration)


def plan_choices(facts: MissionFacts, outline: Outline, times: Times, dark_factor: float) -> Choices:
    """Keys of start, stations, phases, limits and requirements; in a dark orbit all takes a factor longer."""
    nearest, radius = facts.nearest_m, 0.5 * outline.diameter_m
    keep_out = tidy(radius + 0.25 * max(nearest - radius, 0.0))
    common = [
        Choice("initial.relative_position_m", [0.0, -facts.first_m, 0.0], "behind the target"),
        Choice("limits.keep_out_m", keep_out, f"half of {outline.diameter_m:.3g} m, and a quarter of the way to it"),
        Choice("limits.off_station_m", tidy(nearest / 3.0), f"a third of {nearest:g} m"),
        Choice("limits.lost_after_s", 3.0 * times.period_s, "three burn periods"),
        *_handover(facts, times),
    ]
    if facts.approach_m is None:
        plan = _station(facts, times, dark_factor)
    else:
        plan = _approach(facts, times, dark_factor, keep_out)
    return Choices(common, _spread(facts, times)) + plan + Choices([], _requirements(facts, keep_out, times))


def _speed(facts: MissionFacts, times: Times) -> float:
    return _SPEED_M_S * facts.first_m / _OF_M / max(times.pace, 1.0)


def _handover(facts: MissionFacts, times: Times) -> list[Choice]:
    speed = _speed(facts, times)
    return [
        Choice(
            "navigation.initial_relative_position_sigma_m",
            tidy(_KNOWN * facts.first_m),
            f"3 % of {facts.first_m:.3g} m at the start",
        ),
        Choice(
            "navigation.initial_relative_velocity_sigma_m_s",
            tidy(speed),
            f"as 1 cm/s at 50 m in a low orbit, for {facts.first_m:.3g} m and an orbit {times.pace:.3g} times as long",
        ),
    ]


def _spread(facts: MissionFacts, times: Times) -> list[Choice]:
    place = {"key": "initial.relative_position_m", "kind": "normal", "sigma": tidy(_SPREAD * facts.first_m)}
    speed = {"key": "initial.relative_velocity_m_s", "kind": "normal", "sigma": tidy(_speed(facts, times))}
    return [Choice("dispersions", place, "4 % of the distance at the start"), Choice("dispersions", speed)]


def _station(facts: MissionFacts, times: Times, dark_factor: float) -> Choices:
    duration = up_to(_STATION_PERIODS * times.period_s * dark_factor, 100.0)
    return Choices(
        [
            Choice("duration_s", duration, f"{duration / times.period_s:.0f} burn periods"),
            Choice("formation.desired_position_m", [0.0, -facts.hold_m, 0.0], "behind the target"),
            Choice(
                "limits.arrive_by_s", up_to(_ARRIVE_PERIODS * times.period_s * dark_factor, 100.0), "half of the run"
            ),
        ]
    )


def _approach(facts: MissionFacts, times: Times, dark_factor: float, keep_out_m: float) -> Choices:
    found = approach_times(facts, times)
    first, end = _HOLD_PERIODS * times.period_s, _END_PERIODS * times.period_s
    duration = up_to(dark_factor * (1.5 * (first + found.duration_s) + end), 100.0)
    reason = (
        f"hold of {first:.0f} s, approach of {found.duration_s:.0f} s, half as much to spare, {end:.0f} s at the end"
    )
    nearest = facts.nearest_m
    margin = tidy(min(_ABORT_MARGIN_M, (nearest - keep_out_m) / 3.0), 2)
    # Before darkness an approach stops; it catches up afterwards, which leads aside by a quarter of the distance.
    share, angle = (4.0, 20.0) if dark_factor > 1.0 else (8.0, 10.0)
    width = tidy(max(nearest / share, _LEAST_WIDTH_M), 2)
    corridor = {"axis": [0.0, -1.0, 0.0], "half_angle_deg": angle, "width_m": width}
    hold_far: dict[str, Any] = {
        "name": "hold_far",
        "reference": {"kind": "hold", "position_m": [0.0, -facts.hold_m, 0.0]},
        "until": {
            "time_s": first,
            "range_sigma_m": tidy(0.06 * facts.hold_m),
            "range_sigma_for_s": 0.5 * times.period_s,
        },
        "timeout_s": up_to(2.5 * first * dark_factor, 10.0),
        "on_timeout": "abort",
    }
    approach: dict[str, Any] = {
        "name": "approach",
        "reference": {
            "kind": "approach",
            "end_position_m": [0.0, -nearest, 0.0],
            "max_speed_m_s": found.speed_m_s,
            "time_constant_s": found.constant_s,
            "final_speed_m_s": found.last_speed_m_s,
        },
        "corridor": corridor,
        "until": {
            "arrival_box_m": tidy_all([nearest / each for each in (24.0, 12.0, 24.0)], 2),
            "arrival_for_s": 0.5 * times.period_s,
        },
        "timeout_s": up_to(2.0 * found.duration_s * dark_factor, 10.0),
        "on_timeout": "abort",
    }
    hold_near = {
        "name": "hold_near",
        "reference": {"kind": "hold", "position_m": [0.0, -nearest, 0.0]},
        "corridor": corridor,
    }
    way = f"{facts.hold_m - nearest:g} m in {found.duration_s:.0f} s, at most the way left over {found.constant_s:g} s"
    values = [
        Choice("duration_s", duration, reason),
        Choice("mission.abort_margin_m", margin, f"at most a third of the way from {keep_out_m:g} to {nearest:g} m"),
        Choice("limits.arrive_by_s", first, "the hold before the approach"),
    ]
    known = f"until the range is known to 6 % of {facts.hold_m:g} m"
    return Choices(
        values, [Choice("phases", hold_far, known), Choice("phases", approach, way), Choice("phases", hold_near)]
    )


def _requirements(facts: MissionFacts, keep_out_m: float, times: Times) -> list[Choice]:
    nearest = facts.nearest_m
    of_phase = {} if facts.approach_m is None else {"phase": "hold_near"}

    def one(metric: str, bound: str, limit: float, reason: str, **more: Any) -> Choice:
        return Choice("requirements", {"metric": metric, "bound": bound, "limit": limit, **_CONFIDENCE, **more}, reason)

    share, words = (12.0, "a twelfth") if facts.approach_m is None else (8.0, "an eighth")
    asked = [
        one("formation_error_rms_m", "at most", tidy(nearest / share, 2), f"{words} of {nearest:g} m", **of_phase),
        one(
            "min_range_m",
            "at least",
            tidy(0.5 * (nearest + keep_out_m)),
            f"half-way between the station and the keep-out sphere of {keep_out_m:g} m",
        ),
        one("wheel_speed_peak_fraction", "at most", 0.8, ""),
    ]
    if facts.approach_m is None:
        # A phase begins between two decisions, so that with phases two burns may count as in one period.
        asked.append(one("look_away_peak_s", "at most", times.look_away_s, "as pointing.look_away_limit_s"))
    return asked
