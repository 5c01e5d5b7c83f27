"""Replay of one run of a campaign from its seed and run id, with any values observed at every tick.

A stored history has what a report needs, in single precision; ROS messages and the viewer need attitudes, covariances,
measurements and commands. A run simulated alone differs in its last digits from the same run in the campaign's batch,
and a decision at a threshold may then differ: `compare_with_campaign` tells by how much.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
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
from rpojax.runtime.progress_bar import Progress, ProgressCallback
from rpojax.scenario.params import Params
from rpojax.scenario.plugins import plugin_registry
from rpojax.scenario.schema import ScenarioFile
from rpojax.scenario.static_settings import Scenario
from rpojax.scenario.team.members import refuse_team
from rpojax.simulation.state import State, elapsed_time
from rpojax.simulation.step import step
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
    """

    file: ScenarioFile
    seed: int
    run_id: int
    run_range: RunRange
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
    """Comparison of a replay with the samples of the range that a campaign stores of every run.

    Attributes:
        samples: number of samples that both have
        range_difference_m: largest difference [m]
        same_end: both reached the end, or both were frozen at the same time
    """

    samples: int
    range_difference_m: float
    same_end: bool


def replay(
    campaign: Campaign,
    run_id: int,
    observe_tick: TickObserver,
    stages: Stages | None = None,
    on_progress: ProgressCallback | None = None,
) -> ReplayedRun:
    """Simulates a run of a campaign again.

    Raises:
        RpojaxError: there is no such run, the scenario has a team, or scenario, trained files or stages are not those
            of the campaign.
    """
    check_run_id(campaign, run_id)
    refuse_team(campaign.file, "an export, which replays one servicer alone")
    file = campaign_engine.recreate_engine(campaign.configuration, jax.devices()[:1], stages).file
    in_double = file.model_copy(update={"precision": "double"})
    options = campaign.configuration.options
    run_range = options.design_range
    scenario, params, state = single_run.initialise_run(in_double, options.seed, run_id, run_range)
    segments = -(-scenario.ticks // _TICKS_PER_SEGMENT)
    segment_ticks = -(-scenario.ticks // segments)
    records = []
    for number in range(segments):
        if on_progress:
            on_progress(Progress(number / segments, 1, 0, compiled=number > 0))
        state, record = _simulate_segment(
            scenario, plugin_registry.stages_of(file, stages), observe_tick, segment_ticks, params, state
        )
        records.append(jax.tree.map(np.asarray, record))
    # The last segment may extend beyond the end of the scenario.
    failed_at = float(state.failed_at) if float(state.failed_at) < file.duration_s else np.nan
    *record, running = jax.tree.map(lambda each: each[: scenario.ticks], concatenate(records))
    values, poses = jax.tree.map(lambda each: each[: int(running.sum())], record)
    return ReplayedRun(file, options.seed, run_id, run_range, params, failed_at, values, poses)


@partial(jax.jit, static_argnums=(0, 1, 2, 3))
def _simulate_segment(
    scenario: Scenario, stages: Stages, observe_tick: TickObserver, ticks: int, params: Params, state: State
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
    return rerender.render_images(run.file, run.seed, run.run_id, run.poses, ticks, run.run_range)


def compare_with_campaign(run: ReplayedRun, campaign: Campaign) -> ReplayAgreement | None:
    """Comparison of a replay with the campaign's record of the run; None where there is no record yet."""
    rows = np.flatnonzero(campaign.run_ids == run.run_id)
    if not len(rows):
        return None
    recorded = campaign.traces["range_m"][rows[0]]
    replayed = run.poses["range_m"][:: trace_stride(run.file)]
    samples = min(int(np.isfinite(recorded).sum()), len(replayed))
    # The stored trace is in single precision, so the replayed one is rounded too.
    difference = np.abs(
        recorded[:samples].astype(np.float64) - replayed[:samples].astype(np.float32).astype(np.float64)
    )
    same_end = np.array_equal(campaign.frozen_at_s[rows[0]], run.failed_at_s, equal_nan=True)
    return ReplayAgreement(samples, float(difference.max(initial=0.0)), same_end)
