"""Worst case: the most likely combination of dispersions that violates a requirement, confirmed by simulation.

Everything that is not a function of standard normal variables (sensor noise, hand-over errors, choices) keeps what a
run's own random key gives: a search is on one run of a campaign, and several runs are searched.
"""

import dataclasses
import tempfile
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np

from rpojax.analysis.gradients.rollout_evaluator import RolloutEvaluator
from rpojax.analysis.reliability.form_search import find_design_point
from rpojax.analysis.reliability.metric_limit import MetricLimit, select_limit
from rpojax.analysis.reliability.search_settings import LimitChoice, SearchSettings
from rpojax.analysis.reliability.simulated_limit_state import (
    EvaluationCosts,
    SimulatedLimitState,
    make_evaluator,
    measure_costs,
)
from rpojax.analysis.reliability.worst_case_record import WorstCase
from rpojax.campaign import preflight, run_and_resume
from rpojax.campaign.storage import folder_creation
from rpojax.errors import RpojaxError
from rpojax.runtime.progress import stage
from rpojax.scenario.dispersed_numbers import standard_normal_space
from rpojax.scenario.dispersed_numbers.standard_normal_space import StandardNormalSpace
from rpojax.scenario.schema import ScenarioFile
from rpojax.scenario.team.members import refuse_team
from rpojax.simulation.noise import run_keys

_MAX_STARTS = 64


def worst_case(
    file: ScenarioFile,
    *,
    requirement: str | None = None,
    metric: str | None = None,
    limit: float | None = None,
    bound: str = "at most",
    starts: int = 4,
    budget: float = 400.0,
    seed: int = 0,
    run_directory: Path | str | None = None,
    force: bool = False,
    progress: bool = True,
) -> WorstCase:
    """The most likely combination of dispersions that violates a limit, searched with derivatives and then simulated.

    Args:
        file: scenario with dispersions
        requirement: metric of one of the scenario's requirements
        metric: another metric, in place of `requirement`
        limit: of `metric`, in its unit
        bound: side of `limit` on which the metric must stay, 'at most' or 'at least'
        starts: searches at a time, each with the sensor noise of another run
        budget: greatest cost of the search, in runs
        seed: master seed of the runs
        run_directory: campaign folder to make for the confirming run; by default it is not kept
        force: replace `run_directory` if it is there
        progress: show progress on stderr

    Raises:
        RpojaxError: an option names no limit or no search, nothing can be moved, or the folder cannot be used.
    """
    choice = LimitChoice(requirement, metric, limit, bound)
    settings = SearchSettings(starts=starts, budget=budget)
    return find_worst_case(file, choice, settings, seed, run_directory=run_directory, force=force, progress=progress)


def find_worst_case(
    file: ScenarioFile,
    choice: LimitChoice,
    settings: SearchSettings,
    seed: int,
    *,
    run_directory: Path | str | None = None,
    force: bool = False,
    progress: bool = True,
) -> WorstCase:
    """The worst case for records of a limit and of settings, as `worst_case` finds it.

    Raises:
        RpojaxError: an option names no limit or no search, nothing can be moved, or the folder cannot be used.
    """
    if run_directory is not None:
        preflight.check_folder(Path(run_directory), force)
    refuse_team(file, "derivatives of runs")
    chosen = select_limit(file, choice)
    space = standard_normal_space.make_space(file)
    settings = dataclasses.replace(settings, screening_points=max(settings.screening_points, settings.starts))
    check_settings(settings)
    with stage("searching (compiling takes minutes, seconds the next time)", not progress):
        found = search_worst_case(space, chosen, settings, seed)
    with stage("simulating the worst case", not progress):
        if run_directory is not None:
            with folder_creation.made_whole(Path(run_directory), force) as made:
                return dataclasses.replace(found, simulated_value=simulate_worst_case(found, made))
        with tempfile.TemporaryDirectory() as folder:
            return dataclasses.replace(found, simulated_value=simulate_worst_case(found, Path(folder) / "run"))


def check_settings(settings: SearchSettings) -> None:
    """Refuses settings of a search that finds nothing.

    Raises:
        RpojaxError: naming the argument.
    """
    if not 1 <= settings.starts <= _MAX_STARTS:
        raise RpojaxError.of_argument("starts", f"found {settings.starts}, expected 1 to {_MAX_STARTS}")
    if not settings.budget >= settings.screening_points:
        raise RpojaxError.of_argument(
            "budget", f"found {settings.budget:g}, expected at least the {settings.screening_points} first runs"
        )


def search_worst_case(
    space: StandardNormalSpace,
    limit: MetricLimit,
    settings: SearchSettings,
    seed: int,
    evaluator: RolloutEvaluator | None = None,
    costs: EvaluationCosts | None = None,
) -> WorstCase:
    """The most likely violation of a limit in runs of a seed; a compiled `evaluator` and its `costs` may be reused.

    Raises:
        RpojaxError: the settings can find nothing.
    """
    check_settings(settings)
    used = evaluator or make_evaluator(space, (limit.metric,), settings.starts)
    measured = costs or measure_costs(used)
    found = find_design_point(SimulatedLimitState(used, limit, measured, seed), space.dimension, settings, seed)
    point = found.nearest_violation or found.smallest_margin
    key = run_keys(seed, np.array([point.replicate]))[0]
    values = jax.jit(space.values_at)(jnp.asarray(point.z), jnp.asarray(key))
    arrays = {name: np.asarray(value) for name, value in values.items()}
    return WorstCase(limit, space, seed, found, measured, used.compile_s, arrays)


def simulate_worst_case(found: WorstCase, directory: Path) -> float:
    """Metric of the reported point, simulated as `rpojax run` does into a campaign folder; NaN if it is frozen.

    Raises:
        RpojaxError: the folder cannot be used.
    """
    campaign = run_and_resume.run_campaign(
        found.pinned_scenario,
        1,
        directory,
        found.seed,
        first_run=found.reported_point.replicate,
        block_size=1,
        progress=False,
    )
    return float(campaign.metrics[found.limit.metric][0])
