"""Comparison of timed passes: the fastest of each simulator, their ratio, and one table."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from rpojax.errors import RpojaxError

MAX_POINTING_ERROR_DEG = 0.5
"""Largest median pointing error of a valid mission."""

MAX_FORMATION_ERROR_M = 30.0
"""Largest formation error of a valid mission over its last orbit: the desired distance itself."""

COMMON = (
    "scenario `inspection`: orbit, masses, inertias, wheels, thruster, and the same dispersed runs from the same start",
    "two craft that turn, J2 and gravity-gradient torque on both, three wheels with torque limits, one offset thruster",
    "RK4 with steps of 0.2 s, attitude control every 0.2 s, guidance every 1 s, records every 1 s copied to numpy",
    "double precision; noisy sensors; the craft turns for its burns and back to the target",
    "the same cores, alternately; the fastest pass of each counts",
)

DIFFERENCES = (
    "Basilisk has no camera, no detector, no orbit filter and no attitude filter: its simulated navigation is at "
    "least as good as filtered estimates; in its favour",
    "Basilisk's orbit control plans up to three burns an orbit (`spacecraftReconfig`), rpojax decides on one every "
    "200 s by LQR; in Basilisk's favour, since each burn of rpojax is planned, checked and monitored",
    "Basilisk records four messages, rpojax some thirty channels; in Basilisk's favour",
    "drawing the dispersed values is part of rpojax's set-up and not of Basilisk's; in Basilisk's favour",
    "Basilisk's cores count as busy with runs all the time, so no core waits for another; in its favour",
    "Basilisk burns in whole steps, with a thrust that differs from run to run but not from burn to burn",
)


@dataclass(frozen=True)
class TimedPass:
    """Timing of one pass of a simulator through its runs.

    Attributes:
        simulator: "Basilisk" or "rpojax"
        at_once: runs at the same time
        runs: number of runs
        duration_s: simulated time of each [s]
        flight_rate: simulated seconds, summed over the runs, per second of simulation
        whole_rate: the same with the set-up of the runs
        cpu_s: processor time of simulation and set-up, summed over cores [s]
        setup_s: of a run [s]
        formation_error_m: median over the runs, at their end [m]
        pointing_error_deg: median over runs and time [deg]
    """

    simulator: str
    at_once: int
    runs: int
    duration_s: float
    flight_rate: float
    whole_rate: float
    cpu_s: float
    setup_s: float
    formation_error_m: float
    pointing_error_deg: float

    @property
    def cpu_rate(self) -> float:
        """Simulated seconds, summed over the runs, per second of processor time."""
        return self.runs * self.duration_s / self.cpu_s


@dataclass(frozen=True)
class MissionCheck:
    """Errors of Basilisk's mission after some orbits, which show whether it is simulated properly.

    Attributes:
        orbits: number of orbits
        formation_error_m: largest over the last orbit [m]
        pointing_error_deg: median over the last orbit [deg]
        burn_s: time with thrust [s]
    """

    orbits: int
    formation_error_m: float
    pointing_error_deg: float
    burn_s: float

    def failure(self) -> str | None:
        """Why the mission is not valid, or None."""
        if not self.formation_error_m <= MAX_FORMATION_ERROR_M:
            return (
                f"formation error: found {self.formation_error_m:.1f} m, expected at most {MAX_FORMATION_ERROR_M:g} m"
            )
        if not self.pointing_error_deg <= MAX_POINTING_ERROR_DEG:
            found = f"{self.pointing_error_deg:.2f} deg"
            return f"pointing error: found {found}, expected at most {MAX_POINTING_ERROR_DEG:g} deg"
        return None if self.burn_s > 0.0 else "burns: found none, expected at least one"


def fastest_pass(passes: Sequence[TimedPass], simulator: str) -> TimedPass:
    """The fastest pass of a simulator, set-up excluded."""
    return max((each for each in passes if each.simulator == simulator), key=lambda each: each.flight_rate)


def break_even(peer: TimedPass, ours: TimedPass, peer_start_s: float, ours_start_s: float) -> int | None:
    """Number of runs from which `ours` finishes first, given the start-up time of each [s]; None for never."""
    gain = peer.duration_s / peer.whole_rate - ours.duration_s / ours.whole_rate
    return math.ceil(max(ours_start_s - peer_start_s, 0.0) / gain) if gain > 0.0 else None


def check_options(cores: int, available: int, runs: int, duration_s: float, batches: Sequence[int]) -> None:
    """Refuses options out of range.

    Raises:
        RpojaxError: naming the option.
    """
    if not 1 <= cores <= available:
        raise RpojaxError(f"--cores: found {cores}, expected 1 to {available}")
    if runs < 1:
        raise RpojaxError(f"--runs: found {runs}, expected at least 1")
    if not (math.isfinite(duration_s) and duration_s >= 1.0):
        raise RpojaxError(f"--duration-s: found {duration_s:g}, expected at least 1")
    if not batches or min(batches) < 1:
        raise RpojaxError(f"--batches: found {list(batches)}, expected batch sizes from 1")


def report_lines(content: dict[str, Any]) -> list[str]:
    """Lines of the report: machine, table, check of Basilisk's mission, what is alike and what is not."""
    where, versions = content["where"], content["where"]["versions"]
    lines = [
        f"Scenario `{where['scenario']}`, runs of {where['duration_s']:g} s, {where['cores_used']} cores used; "
        f"{where['machine']}; jax {versions['jax']}, Python {versions['python']}",
        "",
        *_table(content),
        "",
        "Basilisk's mission, a run of each core: " + "; ".join(_check_text(check) for check in content["proofs"]),
    ]
    for title, words in (("Alike", COMMON), ("Not alike", DIFFERENCES)):
        lines += ["", f"{title}:", *(f"- {word}" for word in words)]
    return lines


def _check_text(check: dict[str, Any]) -> str:
    return (
        f"in orbit {check['orbits']} formation error at most {check['formation_error_m']:.1f} m, "
        f"pointing error {check['pointing_error_deg']:.2f} deg (median), {check['burn_s']:.0f} s of burns until then"
    )


def _table(content: dict[str, Any]) -> list[str]:
    versions, (peer, ours) = content["where"]["versions"], content["best"].values()
    span = f"runs of {peer['duration_s']:g} s per hour"
    compared = {
        "run-seconds per second, simulation alone": "flight_rate",
        "run-seconds per second, with set-up": "whole_rate",
        "run-seconds per second of processor time, with set-up": "cpu_rate",
        f"{span}, simulation alone": "runs_per_hour",
        f"{span}, with set-up": "runs_per_hour_with_setup",
    }
    lines = [f"| | Basilisk {versions['Basilisk']} | rpojax {versions['rpojax']} | ratio |", "|---|---:|---:|---:|"]
    for label, key in compared.items():
        lines.append(_row(label, peer[key], ours[key], f"**{_three_digits(ours[key] / peer[key])}**"))
    starts = content["starts"]
    return [
        *lines,
        _row("runs at once", peer["at_once"], ours["at_once"]),
        _row("set-up of a run, ms", 1e3 * peer["setup_s"], 1e3 * ours["setup_s"]),
        _row("tracing and compiling, s", 0.0, starts["compile"]),
        _row("imports, s", starts["Basilisk"], starts["rpojax"]),
        "| number of runs from which rpojax finishes first, imports and compiling included | | "
        f"{_break_even(content)} | |",
        _row("formation error at the end, median, m", peer["formation_error_m"], ours["formation_error_m"]),
        _row("pointing error, median, deg", peer["pointing_error_deg"], ours["pointing_error_deg"]),
    ]


def _row(label: str, peer: float, ours: float, ratio: str = "") -> str:
    return f"| {label} | {_three_digits(peer)} | {_three_digits(ours)} | {ratio} |"


def _break_even(content: dict[str, Any]) -> str:
    return "none" if content["break_even_runs"] is None else _three_digits(content["break_even_runs"])


def _three_digits(value: float) -> str:
    """Number with three significant digits, or all of its integer part."""
    if value == 0.0:
        return "0"
    digits = 0 if isinstance(value, int) else max(2 - math.floor(math.log10(abs(value))), 0)
    return f"{value:,.{digits}f}".replace(",", " ")


def as_json(
    passes: Sequence[TimedPass], checks: Sequence[MissionCheck], starts: dict[str, float], where: dict[str, Any]
) -> dict[str, Any]:
    """All figures as JSON: passes, the fastest of each simulator and their ratios, checks, start-up and provenance.

    `starts` holds the import time of both by name, and the compilation time of the fastest batch as `compile` [s].
    """
    peer, ours = fastest_pass(passes, "Basilisk"), fastest_pass(passes, "rpojax")
    return {
        "ratio": ours.flight_rate / peer.flight_rate,
        "ratio_with_setup": ours.whole_rate / peer.whole_rate,
        "ratio_by_cpu_time": ours.cpu_rate / peer.cpu_rate,
        "break_even_runs": break_even(peer, ours, starts["Basilisk"], starts["rpojax"] + starts["compile"]),
        "best": {each.simulator: _pass_json(each) for each in (peer, ours)},
        "passes": [_pass_json(each) for each in passes],
        "proofs": [vars(check) for check in checks],
        "starts": starts,
        "where": where,
        "alike": list(COMMON),
        "not_alike": list(DIFFERENCES),
    }


def _pass_json(timed: TimedPass) -> dict[str, Any]:
    hour = 3600.0 / timed.duration_s
    return {
        **vars(timed),
        "cpu_rate": timed.cpu_rate,
        "runs_per_hour": timed.flight_rate * hour,
        "runs_per_hour_with_setup": timed.whole_rate * hour,
    }
