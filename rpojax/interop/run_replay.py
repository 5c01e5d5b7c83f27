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
from rpojax.campaign.rerun import check_run_id
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
TickObserver = Callable[[Stages, Scenario, Params, Telemetry], Any]
"""What is kept of a tick: arrays in a structure. A function of a module, as programs are kept by it."""
_TickRecord = tuple[Any, dict[str, Array], Array]
PosedPicture = tuple[np.ndarray, Mapping[str, np.ndarray]]
"""A picture (p, p, 3), uint8 sRGB codes, and the poses that it was taken with."""

_TICKS_PER_SEGMENT = 200
"""About so many ticks are flown between two reports of progress."""


@dataclass(frozen=True)
class ReplayedRun(Generic[Values]):
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
    population: designs.RunRange
    params: Params
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

    def tick(self, index: int) -> Values:
        """Values of one tick."""
        return jax.tree.map(lambda values: values[index], self.values)


@dataclass(frozen=True)
class ReplayAgreement:
    """How a flight compares with the samples of the range that a campaign keeps of every run.

    Attributes:
        samples: that both have
        range_difference_m: largest difference
        same_end: both completed, or both failed at the same time
    """

    samples: int
    range_difference_m: float
    same_end: bool


def replay(
    campaign: Campaign,
    run_id: int,
    observe_tick: TickObserver,
    stages: Stages | None = None,
    on_progress: run_and_resume.ProgressCallback | None = None,
) -> ReplayedRun:
    """Flies a run of a campaign again.

    Raises:
        RpojaxError: there is no such run, or scenario, trained files or stages are not those of the campaign.
    """
    check_run_id(campaign, run_id)
    file = block_runner.engine_from_configuration(campaign.configuration, jax.devices()[:1], stages).file
    # A run alone is flown in double precision; how far that is from the campaign is found out in any case.
    in_double = file.model_copy(update={"precision": "double"})
    population = designs.recorded_run_range(campaign.configuration)
    scenario, params, state = single_run.initialise_run(in_double, campaign.configuration["seed"], run_id, population)
    segments = -(-scenario.ticks // _TICKS_PER_SEGMENT)
    segment_ticks = -(-scenario.ticks // segments)
    records = []
    for number in range(segments):
        if on_progress:
            on_progress(run_and_resume.Progress(number / segments, 1, 0, compiled=number > 0))
        state, record = _simulate_segment(scenario, stages or Stages(), observe_tick, segment_ticks, params, state)
        records.append(jax.tree.map(np.asarray, record))
    # The last segment may go beyond the end of the scenario.
    failed_at = float(state.failed_at) if float(state.failed_at) < file.duration_s else np.nan
    *record, running = jax.tree.map(lambda *each: np.concatenate(each)[: scenario.ticks], *records)
    values, poses = jax.tree.map(lambda each: each[: int(running.sum())], record)
    return ReplayedRun(file, campaign.configuration["seed"], run_id, population, params, failed_at, values, poses)


@partial(jax.jit, static_argnums=(0, 1, 2, 3))
def _simulate_segment(
    scenario: Scenario, stages: Stages, observe_tick: TickObserver, ticks: int, params: Params, state: State
) -> tuple[State, _TickRecord]:
    def body(carry: State, _: None) -> tuple[State, _TickRecord]:
        after, seen = closed_loop.tick(stages, scenario, params, carry)
        return after, (observe_tick(stages, scenario, params, seen), _recorded_poses(scenario, seen), seen.running)

    return jax.lax.scan(body, state, None, length=ticks)


def _recorded_poses(scenario: Scenario, telemetry: Telemetry) -> dict[str, Array]:
    truth = telemetry.truth
    return {
        "time_s": telemetry.tick.astype(jnp.float64) * scenario.tick_s,
        "range_m": safe.norm(truth.r_ST_N),
        "r_TN_N": truth.r_TN_N,
        "r_ST_N": truth.r_ST_N,
        "q_TN": truth.q_TN,
        "q_BN": truth.q_BN,
        "window_px": telemetry.frame.window.astype(jnp.float32),
    }


def rerendered_pictures(run: ReplayedRun, ticks: Sequence[int]) -> Iterator[PosedPicture]:
    """Pictures (p, p, 3), uint8 sRGB codes, with the poses, that a rendered camera took in some ticks, taken again."""
    return rerender.render_images(run.file, run.seed, run.run_id, run.poses, ticks, run.population)


def compare_with_campaign(run: ReplayedRun, campaign: Campaign) -> ReplayAgreement | None:
    """How far a flight is from what the campaign recorded of the run; None where it has not recorded it yet."""
    rows = np.flatnonzero(campaign.run_ids == run.run_id)
    if not len(rows):
        return None
    recorded = campaign.traces["range_m"][rows[0]]
    replayed = run.poses["range_m"][:: trace_stride(run.file)]
    samples = min(int(np.isfinite(recorded).sum()), len(replayed))
    # The trace is kept in single precision, so that of the flight is rounded likewise.
    difference = np.abs(
        recorded[:samples].astype(np.float64) - replayed[:samples].astype(np.float32).astype(np.float64)
    )
    same_end = np.array_equal(campaign.failed_at_s[rows[0]], run.failed_at_s, equal_nan=True)
    return ReplayAgreement(samples, float(difference.max(initial=0.0)), same_end)
