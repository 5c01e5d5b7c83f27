"""Replay of one run of a campaign from its seed and run id, with any values observed at every tick.

A stored history has what a report needs, in single precision; ROS messages and the viewer need attitudes, covariances,
measurements and commands. A run simulated alone differs in its last digits from the same run in the campaign's batch,
and a decision at a threshold may then differ: `compare_with_campaign` tells by how much.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Generic, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from rpojax.campaign import rerender, single_run
from rpojax.campaign.execution import campaign_engine
from rpojax.campaign.rerun import check_run_id
from rpojax.campaign.storage.campaign_folder import Campaign, trace_stride
from rpojax.core.numerics import gradient_safe
from rpojax.core.pytree import concatenate
from rpojax.dispersions.designs.run_range import RunRange
from rpojax.flight.stages import Stages
from rpojax.runtime.progress import Progress, ProgressCallback
from rpojax.runtime.thread_pools import thread_pool
from rpojax.scenario.params import Params
from rpojax.scenario.plugins import plugin_registry
from rpojax.scenario.schema import ScenarioFile
from rpojax.scenario.static_settings import Scenario
from rpojax.scenario.team.members import member_files, member_names
from rpojax.simulation.state import State, elapsed_time
from rpojax.simulation.step import step
from rpojax.simulation.team import team_step
from rpojax.simulation.team.member_axes import TeamParams
from rpojax.simulation.team.team_state import TeamState
from rpojax.simulation.telemetry import Telemetry

Values = TypeVar("Values")
TickObserver = Callable[[Stages, Scenario, Params, Telemetry], Any]
"""Function that returns the arrays to keep of a tick. One of a module, as compiled functions are cached by it."""
_TickRecord = tuple[Any, dict[str, Array], Array]
PosedImage = tuple[np.ndarray, Mapping[str, np.ndarray]]
"""Image (p, p, 3), uint8 sRGB codes, and the poses it was rendered with."""

_TICKS_PER_SEGMENT = 200
"""Approximate number of ticks between two reports of progress."""


@dataclass(frozen=True)
class ReplayedRun(Generic[Values]):
    """One run, up to its end or its failure.

    Attributes:
        file: scenario of the campaign; a replay is in double precision, whatever precision the scenario has
        seed: master seed
        run_id: number of the run
        run_range: runs that the design of experiments covers
        params: dispersed parameters
        failed_at_s: time at which the run was frozen [s], nan for one that reached its end
        values: what was observed, ticks first
        poses: `time_s`, `range_m` and the poses for rendering images again, ticks first, as in a history
        servicer: number of the servicer of a team, None for one alone
    """

    file: ScenarioFile
    seed: int
    run_id: int
    run_range: RunRange
    params: Params
    failed_at_s: float
    values: Values
    poses: dict[str, np.ndarray]
    servicer: int | None = None

    @property
    def servicer_name(self) -> str | None:
        """Name of the servicer of a team, None of one alone."""
        return None if self.servicer is None else member_names(self.file)[self.servicer]

    @property
    def servicer_file(self) -> ScenarioFile:
        """Scenario of the servicer."""
        return self.file if self.servicer is None else member_files(self.file)[self.servicer]

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
    """Comparison of a replay with the samples of the range that a campaign stores of every run.

    Attributes:
        samples: number of samples that both have
        range_difference_m: largest difference [m]
        same_end: both reached the end, or both were frozen at the same time
    """

    samples: int
    range_difference_m: float
    same_end: bool


def replay_servicers(
    campaign: Campaign,
    run_id: int,
    observe_tick: TickObserver,
    stages: Stages | None = None,
    on_progress: ProgressCallback | None = None,
) -> tuple[ReplayedRun, ...]:
    """Simulates a run of a campaign again, and returns it for each servicer of a team, or for the one servicer.

    A run of a team ends for all when it ends for one.

    Raises:
        RpojaxError: there is no such run, or scenario, trained files or stages are not those of the campaign.
    """
    check_run_id(campaign, run_id)
    if on_progress:
        on_progress(Progress(0.0, 1, 0, compiled=False))
    file, in_double = _files(campaign, stages)
    chosen, options = plugin_registry.stages_of(file, stages), campaign.configuration.options
    arguments = (in_double, options.seed, run_id, options.design_range)
    if file.servicers:
        scenario, team, state = single_run.initialise_team_run(*arguments, stages=chosen)
        simulate = _team_segments(scenario, chosen, observe_tick, team)
        params = [jax.tree.map(np.asarray, team.member(number)) for number in range(team.count)]
    else:
        scenario, own, state = single_run.initialise_run(*arguments, stages=chosen)
        simulate, params = partial(_simulate_segment, scenario, chosen, observe_tick, own), [own]
    state, (values, poses, running) = _in_segments(scenario, simulate, state, on_progress)
    end = int(running.reshape(len(running), -1).all(axis=1).sum())
    failed_at = float(np.min(state.failed_at))
    failed_at = failed_at if failed_at < file.duration_s else np.nan
    runs = []
    for number, own in enumerate(params):
        rows = np.s_[:end, ..., number] if file.servicers else np.s_[:end]
        # Serialisers of messages view the memory of an array, which that of one servicer of a team has gaps in.
        observed, places = jax.tree.map(lambda array, rows=rows: np.ascontiguousarray(array[rows]), (values, poses))
        servicer = number if file.servicers else None
        runs.append(ReplayedRun(file, *arguments[1:], own, failed_at, observed, places, servicer))
    return tuple(runs)


def _files(campaign: Campaign, stages: Stages | None) -> tuple[ScenarioFile, ScenarioFile]:
    """Scenario of a campaign, and the same in double precision."""
    file = campaign_engine.recreate_engine(campaign.configuration, jax.devices()[:1], stages).file
    return file, file.model_copy(update={"precision": "double"})


def _in_segments(
    scenario: Scenario,
    simulate: Callable[[Any, int], tuple[Any, _TickRecord]],
    state: Any,
    on_progress: ProgressCallback | None,
) -> tuple[Any, Any]:
    """State at the end of a run, and the records of all of its ticks."""
    segments = -(-scenario.ticks // _TICKS_PER_SEGMENT)
    segment_ticks = -(-scenario.ticks // segments)
    records = []
    with thread_pool(1) as pool:
        for number in range(segments):
            if on_progress and number > 0:
                on_progress(Progress(number / segments, 1, 0, compiled=True))
            state, record = pool.submit(simulate, state, segment_ticks).result()
            records.append(jax.tree.map(np.asarray, record))
    # The last segment may extend beyond the end of the scenario.
    return state, jax.tree.map(lambda each: each[: scenario.ticks], concatenate(records))


def _team_segments(
    scenario: Scenario, stages: Stages, observe_tick: TickObserver, team: TeamParams
) -> Callable[[TeamState, int], tuple[TeamState, _TickRecord]]:
    """Simulation of some ticks of a team, which is compiled once; records (..., N) of all servicers."""
    observe = replace(team, mode="jax")

    def of_one(own: Params, seen: Telemetry) -> _TickRecord:
        return observe_tick(stages, scenario, own, seen), _recorded_poses(scenario, seen), seen.running

    def body(carry: TeamState, _: None) -> tuple[TeamState, _TickRecord]:
        after, telemetry = team_step.step(scenario, team, carry, stages)
        return after, observe.each(of_one)(telemetry)

    compiled = jax.jit(lambda state, ticks: jax.lax.scan(body, state, None, length=ticks), static_argnums=1)
    return lambda state, ticks: compiled(state, ticks)


@partial(jax.jit, static_argnums=(0, 1, 2, 5))
def _simulate_segment(
    scenario: Scenario, stages: Stages, observe_tick: TickObserver, params: Params, state: State, ticks: int
) -> tuple[State, _TickRecord]:
    def body(carry: State, _: None) -> tuple[State, _TickRecord]:
        after, telemetry = step(scenario, params, carry, stages)
        observed = observe_tick(stages, scenario, params, telemetry)
        return after, (observed, _recorded_poses(scenario, telemetry), telemetry.running)

    return jax.lax.scan(body, state, None, length=ticks)


def _recorded_poses(scenario: Scenario, telemetry: Telemetry) -> dict[str, Array]:
    truth = telemetry.truth
    return {
        "time_s": elapsed_time(scenario, truth, telemetry.tick),
        "range_m": gradient_safe.norm(truth.r_ST_N),
        "r_TN_N": truth.r_TN_N,
        "r_ST_N": truth.r_ST_N,
        "q_TN": truth.q_TN,
        "q_BN": truth.q_BN,
        "window_px": telemetry.frame.window.astype(jnp.float32),
    }


def rerendered_images(run: ReplayedRun, ticks: Sequence[int]) -> Iterator[PosedImage]:
    """Images of a rendered camera at some ticks, rendered again, each with its poses."""
    return rerender.render_images(run.file, run.seed, run.run_id, run.poses, ticks, run.run_range, run.servicer)


def compare_all(runs: Sequence[ReplayedRun], campaign: Campaign) -> ReplayAgreement | None:
    """Comparison of all servicers: samples of each, their largest difference, and whether all have the same end."""
    found = [each for run in runs if (each := compare_with_campaign(run, campaign)) is not None]
    if not found:
        return None
    return ReplayAgreement(
        min(each.samples for each in found),
        max(each.range_difference_m for each in found),
        all(each.same_end for each in found),
    )


def compare_with_campaign(run: ReplayedRun, campaign: Campaign) -> ReplayAgreement | None:
    """Comparison of a replay with the campaign's record of the run; None where there is no record yet."""
    rows = np.flatnonzero(campaign.run_ids == run.run_id)
    if not len(rows):
        return None
    traces = campaign.traces if run.servicer is None else campaign.servicers("traces")
    recorded = traces["range_m"][rows[0]]
    if run.servicer is not None:
        recorded = recorded[run.servicer]
    replayed = run.poses["range_m"][:: trace_stride(run.file)]
    samples = min(int(np.isfinite(recorded).sum()), len(replayed))
    # The stored trace is in single precision, so the replayed one is rounded too.
    difference = np.abs(
        recorded[:samples].astype(np.float64) - replayed[:samples].astype(np.float32).astype(np.float64)
    )
    same_end = np.array_equal(campaign.frozen_at_s[rows[0]], run.failed_at_s, equal_nan=True)
    return ReplayAgreement(samples, float(difference.max(initial=0.0)), same_end)
