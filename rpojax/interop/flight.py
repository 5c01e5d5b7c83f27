"""One run with the attitude of both craft: from its kept history, or flown once more, alone.

Only the history of a rendered camera holds attitudes. Any other run is flown again, in memory; what that shows is the
run of the campaign but for the last digits, and what hangs on a threshold may then go another way.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import jax
import numpy as np

from rpojax.campaign import design, filming, single
from rpojax.campaign.design import Population
from rpojax.campaign.rerun import check_run
from rpojax.campaign.store import Campaign
from rpojax.core.frames import hill_frame
from rpojax.errors import RpojaxError
from rpojax.flight.computer import Stages
from rpojax.simulation import closed_loop, scenario, telemetry
from rpojax.simulation.closed_loop import State
from rpojax.simulation.params import Params
from rpojax.simulation.scenario import Scenario
from rpojax.simulation.schema import ScenarioFile

Count = Callable[[int, int], None]
Channels = dict[str, np.ndarray]

_SEGMENT = 200
"""Ticks between two words about the progress."""
_OWN = ("R_HN", "relative_covariance_H")


@dataclass(frozen=True)
class Flight:
    """A run, tick by tick up to its end or its failure.

    Attributes:
        file: scenario
        seed: master seed of the campaign
        run_id: number of the run
        population: runs for which the campaign's design was made
        chosen: its dispersed numbers
        channels: as a history holds them, time first, with `q_TN`, `q_BN`, `r_TN_N` and `r_ST_N`
        R_HN: (ticks, 3, 3) inertial to Hill
        covariance_H: (ticks, 3, 3) of the relative position [m^2]; a kept history knows its diagonal only
        again: whether the run was flown again for this
        moved_m: largest way from the true positions of the kept history to those of the flight; None without one
    """

    file: ScenarioFile
    seed: int
    run_id: int
    population: Population
    chosen: Params
    channels: Channels
    R_HN: np.ndarray
    covariance_H: np.ndarray
    again: bool
    moved_m: float | None

    @property
    def ticks(self) -> int:
        """Number of ticks."""
        return len(self.channels["time_s"])


def flight_of(found: Campaign, run_id: int, count: Count | None = None) -> Flight:
    """A run of a campaign; `count` is told the ticks done and to do while it is flown again.

    Raises:
        RpojaxError: there is no such run, it cannot be flown again, or it failed in its first tick.
    """
    check_run(found, run_id)
    file, seed, population = found.file, found.info["seed"], design.population_of(found.info)
    history = found.history(run_id) if run_id in found.history_ids else None
    if history is not None and filming.can_show(history, file) and len(history["time_s"]) > 1:
        chosen = single.dispersed(file, seed, run_id, population)[1]
        return _cut(Flight(file, seed, run_id, population, chosen, *_posed(history), again=False, moved_m=None))
    _check_same(file, found.info, run_id)
    flown, chosen = fly(file, seed, run_id, population, count)
    R_HN, covariance = (np.asarray(flown.pop(name), dtype=np.float64) for name in _OWN)
    moved = None if history is None else _moved(history, flown)
    return _cut(Flight(file, seed, run_id, population, chosen, flown, R_HN, covariance, again=True, moved_m=moved))


def fly(
    file: ScenarioFile, seed: int, run_id: int, population: Population | None = None, count: Count | None = None
) -> tuple[Channels, Params]:
    """All channels of a run, the poses and `relative_covariance_H` (ticks, 3, 3) [m^2] with them, and its numbers."""
    static, chosen, state = single.dispersed(file, seed, run_id, population)
    length = min(_SEGMENT, static.ticks)
    pieces = []
    for begin in range(0, static.ticks, length):
        state, seen = _segment(static, length, chosen, state)
        pieces.append(jax.tree.map(np.asarray, seen))
        if count is not None:
            count(min(begin + length, static.ticks), static.ticks)
    joined = {name: np.concatenate([piece[name] for piece in pieces])[: static.ticks] for name in pieces[0]}
    desired = np.asarray(file.formation.desired_position_m)
    return {"time_s": np.arange(static.ticks) * static.tick_s, "rho_desired_H": desired, **joined}, chosen


@partial(jax.jit, static_argnums=(0, 1))
def _segment(static: Scenario, length: int, chosen: Params, state: State) -> tuple[State, telemetry.Channels]:
    def body(carry: State, _: None) -> tuple[State, telemetry.Channels]:
        after, seen = closed_loop.tick(Stages(), static, chosen, carry)
        truth = seen.truth
        R_HN = hill_frame(truth.r_TN_N, truth.v_TN_N)[0]
        P_N = seen.flight.orbit.relative.covariance[:3, :3]
        poses = {name: getattr(truth, name) for name in ("r_TN_N", "r_ST_N", "q_TN", "q_BN")}
        own = {"R_HN": R_HN, "relative_covariance_H": R_HN @ P_N @ R_HN.T}
        return after, {**telemetry.observe(static, chosen, seen), **poses, **own}

    return jax.lax.scan(body, state, None, length=length)


def _check_same(file: ScenarioFile, info: Mapping[str, Any], run_id: int) -> None:
    """Refuses to fly another run than that of the campaign."""
    if stages := info["stages"]:
        raise RpojaxError(f"run {run_id}: found replaced stages {sorted(stages)}, expected a history with attitudes")
    if scenario.digest(file) != info["scenario_hash"]:
        raise RpojaxError("imaging: found other trained files, expected those that the campaign was run with")


def _posed(history: Mapping[str, np.ndarray]) -> tuple[Channels, np.ndarray, np.ndarray]:
    """A kept history with attitudes, its Hill frames, and its covariances, which it knows along the Hill axes only.

    The orbit's plane comes from how its radius turns: in single precision that is good to 1e-4 rad.
    """
    radius = history["r_TN_N"].astype(np.float64)
    motion = np.gradient(radius, axis=0)
    R_HN = np.stack([_unit(radius), np.zeros_like(radius), _unit(np.cross(radius, motion))], axis=1)
    R_HN[:, 1] = np.cross(R_HN[:, 2], R_HN[:, 0])
    sigma = history["relative_sigma_H"].astype(np.float64)
    return dict(history), R_HN, np.eye(3) * sigma[:, :, None] ** 2


def _unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def _moved(history: Mapping[str, np.ndarray], flown: Mapping[str, np.ndarray]) -> float | None:
    """Largest difference of the true positions [m] at the times that both have."""
    if "rho_H" not in history:
        return None
    _, kept, again = np.intersect1d(history["time_s"], flown["time_s"], return_indices=True)
    way = np.linalg.norm(history["rho_H"][kept].astype(np.float64) - flown["rho_H"][again], axis=1)
    return float(np.nanmax(way)) if np.isfinite(way).any() else None


def _cut(flight: Flight) -> Flight:
    """The flight up to its failure."""
    finite = np.isfinite(flight.channels["range_m"])
    alive = finite & flight.channels.get("running", finite)
    end = len(alive) if alive.all() else int(alive.argmin())
    if end == 0:
        raise RpojaxError(f"run {flight.run_id}: found no tick before it failed, expected a run that flew")
    channels = {name: values if name == "rho_desired_H" else values[:end] for name, values in flight.channels.items()}
    return replace(flight, channels=channels, R_HN=flight.R_HN[:end], covariance_H=flight.covariance_H[:end])
