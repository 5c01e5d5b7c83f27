"""A run of a campaign flown once more, alone, with all that somebody wants to know of its ticks.

A stored history has what a report needs, in single precision; messages and the viewer say more: both attitudes,
covariances, what every sensor gave, commands. So the run is flown again from its seed and number. Alone its last digits
are others than in the campaign's batch, and what hangs on a threshold may then go another way: how far the flight is
from what the campaign recorded is found out, and said.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, Generic, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from rpojax.campaign import rerender, run_and_resume, single_run
from rpojax.campaign.execution import block_runner
from rpojax.campaign.rerun import check_run
from rpojax.campaign.storage.campaign_folder import Campaign, trace_stride
from rpojax.core.numerics import safe
from rpojax.dispersions import designs
from rpojax.flight.computer import Stages
from rpojax.scenario.params import Params
from rpojax.scenario.scenario_file import Scenario
from rpojax.scenario.schema import ScenarioFile
from rpojax.simulation import closed_loop
from rpojax.simulation.closed_loop import State, Telemetry

Values = TypeVar("Values")
Observe = Callable[[Stages, Scenario, Params, Telemetry], Any]
"""What is kept of a tick: arrays in a structure. A function of a module, as programs are kept by it."""
Seen = tuple[Any, dict[str, Array], Array]
Shot = tuple[np.ndarray, Mapping[str, np.ndarray]]
"""A picture (p, p, 3), uint8 sRGB codes, and the poses that it was taken with."""

_SEGMENT_TICKS = 200
"""About so many ticks are flown between two reports of progress."""


@dataclass(frozen=True)
class Flight(Generic[Values]):
    """One run, up to its end or its failure.

    Attributes:
        file: scenario of the campaign; the run is flown in double precision whatever it asks for
        seed: master seed
        run_id: number of the run
        population: runs that its design was made for
        chosen: its dispersed numbers
        failed_at_s: when it failed [s], nan for a completed run
        values: what was observed, ticks first
        poses: `time_s`, `range_m` and what a picture can be taken again from, ticks first, as a history has it
    """

    file: ScenarioFile
    seed: int
    run_id: int
    population: designs.Population
    chosen: Params
    failed_at_s: float
    values: Values
    poses: dict[str, np.ndarray]

    @property
    def time_s(self) -> np.ndarray:
        """Time of each tick [s] since the start."""
        return self.poses["time_s"]

    @property
    def ticks(self) -> int:
        """Number of ticks."""
        return len(self.time_s)

    def tick(self, number: int) -> Values:
        """Values of one tick."""
        return jax.tree.map(lambda values: values[number], self.values)


@dataclass(frozen=True)
class Agreement:
    """How a flight compares with the samples of the range that a campaign keeps of every run.

    Attributes:
        samples: that both have
        range_difference_m: largest difference
        same_end: both completed, or both failed at the same time
    """

    samples: int
    range_difference_m: float
    same_end: bool


def fly(
    found: Campaign,
    run_id: int,
    observe: Observe,
    stages: Stages | None = None,
    on_progress: run_and_resume.Report | None = None,
) -> Flight:
    """Flies a run of a campaign again.

    Raises:
        RpojaxError: there is no such run, or scenario, trained files or stages are not those of the campaign.
    """
    check_run(found, run_id)
    file = block_runner.engine_of(found.asked, jax.devices()[:1], stages).file
    # A run alone is flown in double precision; how far that is from the campaign is found out in any case.
    double = file.model_copy(update={"precision": "double"})
    population = designs.population_of(found.asked)
    static, chosen, state = single_run.dispersed(double, found.asked["seed"], run_id, population)
    count = -(-static.ticks // _SEGMENT_TICKS)
    segment = -(-static.ticks // count)
    parts = []
    for number in range(count):
        if on_progress:
            on_progress(run_and_resume.Progress(number / count, 1, 0, compiled=number > 0))
        state, seen = _advance(static, stages or Stages(), observe, segment, chosen, state)
        parts.append(jax.tree.map(np.asarray, seen))
    # The last segment may go beyond the end of the scenario.
    failed_at = float(state.failed_at) if float(state.failed_at) < file.duration_s else np.nan
    *seen, running = jax.tree.map(lambda *each: np.concatenate(each)[: static.ticks], *parts)
    values, poses = jax.tree.map(lambda each: each[: int(running.sum())], seen)
    return Flight(file, found.asked["seed"], run_id, population, chosen, failed_at, values, poses)


@partial(jax.jit, static_argnums=(0, 1, 2, 3))
def _advance(
    static: Scenario, stages: Stages, observe: Observe, ticks: int, chosen: Params, state: State
) -> tuple[State, Seen]:
    def body(carry: State, _: None) -> tuple[State, Seen]:
        after, seen = closed_loop.tick(stages, static, chosen, carry)
        return after, (observe(stages, static, chosen, seen), _poses(static, seen), seen.running)

    return jax.lax.scan(body, state, None, length=ticks)


def _poses(static: Scenario, seen: Telemetry) -> dict[str, Array]:
    truth = seen.truth
    return {
        "time_s": seen.tick.astype(jnp.float64) * static.tick_s,
        "range_m": safe.norm(truth.r_ST_N),
        "r_TN_N": truth.r_TN_N,
        "r_ST_N": truth.r_ST_N,
        "q_TN": truth.q_TN,
        "q_BN": truth.q_BN,
        "window_px": seen.frame.window.astype(jnp.float32),
    }


def pictures(flight: Flight, ticks: Sequence[int]) -> Iterator[Shot]:
    """Pictures (p, p, 3), uint8 sRGB codes, with the poses, that a rendered camera took in some ticks, taken again."""
    return rerender.pictures(flight.file, flight.seed, flight.run_id, flight.poses, ticks, flight.population)


def compare(flight: Flight, found: Campaign) -> Agreement | None:
    """How far a flight is from what the campaign recorded of the run; None where it has not recorded it yet."""
    rows = np.flatnonzero(found.run_ids == flight.run_id)
    if not len(rows):
        return None
    recorded = found.traces["range_m"][rows[0]]
    flown = flight.poses["range_m"][:: trace_stride(flight.file)]
    both = min(int(np.isfinite(recorded).sum()), len(flown))
    # The trace is kept in single precision, so that of the flight is rounded likewise.
    off = np.abs(recorded[:both].astype(np.float64) - flown[:both].astype(np.float32).astype(np.float64))
    same_end = np.array_equal(found.failed_at_s[rows[0]], flight.failed_at_s, equal_nan=True)
    return Agreement(both, float(off.max(initial=0.0)), same_end)
