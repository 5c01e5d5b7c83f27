"""Stochastic gradient descent with Adam on the tuning objective, with fresh runs at every step.

Fresh runs prevent overfitting to the noise of a few. The step size decays, and the result is the mean of the last
quarter of the iterates, which averages the remaining noise out (Polyak and Juditsky, 1992).
"""

import json
import math
import time
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Final

import jax
import numpy as np
import optax

from rpojax.analysis.gradients.rollout_evaluator import RolloutEvaluator
from rpojax.analysis.gradients.tuning import descent_state, gradient_estimator, tunable_parameters
from rpojax.analysis.gradients.tuning.descent_state import DescentState, TuningStep
from rpojax.analysis.gradients.tuning.tunable_scenario import scenario_at_horizon
from rpojax.analysis.gradients.tuning.tuning_objective import Objective, part_metrics, weight_key
from rpojax.analysis.gradients.tuning.tuning_settings import TuningSettings
from rpojax.errors import Notice, RpojaxError
from rpojax.flight.stages import Stages
from rpojax.scenario.scenario_digest import scenario_digest
from rpojax.scenario.schema import ScenarioFile
from rpojax.simulation.noise import run_keys

_AVERAGED_FRACTION: Final = 0.25
"""Fraction of the steps whose mean is the result."""
_FINAL_RATE: Final = 0.05
"""Size of the last step over that of the first."""
_ADAM_B2: Final = 0.95
_RESTART_STEPS: Final = 20
"""After so many steps, up to the middle of the descent, Adam is restarted: far from the optimum gradients are a
thousand times longer, and while its second moments remember them, less sensitive numbers do not move."""
_METHOD: Final = [_AVERAGED_FRACTION, _FINAL_RATE, _ADAM_B2, _RESTART_STEPS, "undefined counts as the worst"]
"""What must be the same for a descent to be resumed."""


@dataclass(frozen=True)
class TuningResult:
    """Result of a descent.

    Attributes:
        coordinates: (k,) mean of the averaged iterates
        values: by key, in the user's units
        steps: all
        mode: of differentiation, as `differentiation_mode`
        compile_s: compilation [s]
        memory_bytes: temporary memory of the programs [B]
    """

    coordinates: np.ndarray
    values: dict[str, Any]
    steps: tuple[TuningStep, ...]
    mode: str
    compile_s: float
    memory_bytes: int


def descend(
    file: ScenarioFile,
    settings: TuningSettings,
    progress_file: Path | None = None,
    resume: bool = False,
    on_step: Callable[[int, TuningStep], None] = lambda number, step: None,
    stages: Stages | None = None,
    on_stage: Callable[[int, str], None] = lambda number, words: None,
) -> TuningResult:
    """Tunes numbers of a scenario; each step is kept in `progress_file`, from which `resume` goes on.

    After each step `on_step` gets their number and the step; `on_stage` gets that number and what else begins: a
    compilation, the simulation after it.

    A part of the objective that is constant over the runs of the first step is warned of.

    Raises:
        RpojaxError: the scenario cannot be tuned, or its start gives no finite objective.
    """
    short = scenario_at_horizon(file, settings)
    objective = Objective(short)
    replaced = () if stages is None else stages.replaced
    tunable = tunable_parameters.select_parameters(short, settings.parameters, replaced)
    inputs = partial(tunable_parameters.run_values, short, tunable)
    evaluator = RolloutEvaluator(
        *(short, inputs, tunable.count, objective.metric_names, settings.runs, stages, objective.gradient),
        on_stage=lambda words: on_stage(len(state.steps), words),
    )
    optimizer = optax.scale_by_adam(b2=_ADAM_B2)
    of_file = {"scenario_hash": scenario_digest(file), "tuning": file.tuning.model_dump()}
    identity = {**settings.descent_record(), "method": _METHOD, **of_file}
    state = descent_state.initial_state(optimizer, tunable.initial)
    if resume and progress_file is not None:
        state = descent_state.load_state(progress_file, state, json.loads(json.dumps(identity)))
    while len(state.steps) < settings.steps:
        state = _step(evaluator, objective, tunable.nonsmooth, optimizer, settings, state)
        on_step(len(state.steps), state.steps[-1])
        if progress_file is not None:
            descent_state.save_state(progress_file, identity, state)
    x = state.iterate_sum / _averaged_steps(settings.steps)
    values = {key: np.asarray(value).tolist() for key, value in tunable.values(jax.numpy.asarray(x)).items()}
    mode = gradient_estimator.differentiation_mode(tunable.nonsmooth)
    return TuningResult(x, values, state.steps, mode, evaluator.compile_s, evaluator.program_memory_bytes)


def _check_start(undefined: dict[str, int], settings: TuningSettings) -> None:
    """Refuses a start at which no run has a value of a part of the objective: it has no derivative.

    Raises:
        RpojaxError: naming the part.
    """
    for part, runs in undefined.items():
        if runs == settings.runs:
            names = " and ".join(part_metrics(part))
            raise RpojaxError(
                f"{weight_key(part)}: found no run of {runs} with {names}, expected some; "
                "runs of a longer horizon may have it, and a weight of 0 leaves it out"
            )


def _restarts(number: int, steps: int) -> bool:
    """Whether Adam is restarted before step `number`, counted from 0, of so many."""
    return number % _RESTART_STEPS == 0 and number <= steps // 2


def _averaged_steps(steps: int) -> int:
    return max(1, round(_AVERAGED_FRACTION * steps))


def _step(
    evaluator: RolloutEvaluator,
    objective: Objective,
    nonsmooth: np.ndarray,
    optimizer: Any,
    settings: TuningSettings,
    state: DescentState,
) -> DescentState:
    number = len(state.steps)
    keys = run_keys(settings.seed, number * settings.runs + np.arange(settings.runs))
    compiled = evaluator.compile_s
    begin = time.perf_counter()
    found = gradient_estimator.estimate_gradient(evaluator, objective, nonsmooth, state.coordinates, keys)
    value, parts = objective(found.metrics)
    undefined = objective.undefined_runs(found.metrics)
    if not state.steps:
        _check_start(undefined, settings)
        for line in objective.constant_parts(found.metrics):
            warnings.warn(f"warning: {line}", Notice, stacklevel=3)
    if not math.isfinite(value):
        raise RpojaxError(f"step {number + 1}: found an objective of {value}, expected a finite one; try a lower rate")
    if not np.isfinite(found.gradient).all():
        raise RpojaxError(f"step {number + 1}: found no run with a finite gradient, expected some; try a lower rate")
    adam = optimizer.init(state.coordinates)
    if not _restarts(number, settings.steps):
        adam = jax.tree.unflatten(jax.tree.structure(adam), state.optimizer_leaves)
    rate = optax.cosine_decay_schedule(settings.rate, settings.steps, _FINAL_RATE)
    with jax.numpy_dtype_promotion("standard"):  # optax mixes types
        updates, adam = optimizer.update(found.gradient, adam)
        x = state.coordinates - np.asarray(rate(number)) * np.asarray(updates)
    run_s = time.perf_counter() - begin - (evaluator.compile_s - compiled)
    norm = float(np.linalg.norm(found.gradient))
    step = TuningStep(value, parts, undefined, norm, found.excluded_runs, found.clipped_runs, run_s)
    averaged = number >= settings.steps - _averaged_steps(settings.steps)
    leaves = [np.asarray(leaf) for leaf in jax.tree.leaves(adam)]
    return DescentState(x, leaves, state.iterate_sum + (x if averaged else 0.0), (*state.steps, step))
