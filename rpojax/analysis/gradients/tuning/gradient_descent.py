"""Stochastic gradient descent with Adam on the tuning objective, with fresh runs at every step.

Fresh runs prevent overfitting to the noise of a few. The step size decays, and the result is the mean of the last
quarter of the iterates, which averages the remaining noise out (Polyak and Juditsky, 1992).

Gradient of the tuning objective: derivatives of runs where they are smooth, finite differences where they are not.

A run depends smoothly on the noises of its filter and the gains of its attitude control: there the gradient is the
derivative of the loop. The gate, the control law and the schedule act through decisions (a box refused, a burn inside
the dead band). Between two decisions the derivative of a run tells nothing of the next one, and its mean over runs has
so long a tail that hundreds of runs do not determine its sign. There the gradient is a difference of two batches of the
same runs, with a step so long that many decisions lie in between.
"""

import json
import math
import time
import warnings
from collections.abc import Callable
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any, Final

import jax
import jax.numpy as jnp
import numpy as np
import optax

from rpojax.analysis.gradients.rollout_evaluator import FORWARD_MODE_MAX_INPUTS, RolloutEvaluator, RolloutResult
from rpojax.analysis.gradients.tuning import tunable_parameters
from rpojax.analysis.gradients.tuning.tunable_parameters import scenario_at_horizon
from rpojax.analysis.gradients.tuning.tuning_objective import Objective, part_metrics, weight_key
from rpojax.analysis.gradients.tuning.tuning_settings import TuningSettings
from rpojax.campaign.storage import atomic_files
from rpojax.errors import Notice, ResultError, RpojaxError
from rpojax.flight.stages import Stages
from rpojax.scenario.scenario_digest import scenario_digest
from rpojax.scenario.schema import ScenarioFile
from rpojax.simulation.noise import run_keys
from rpojax.untrusted.file_reading import FileKind

CLIP_RATIO: Final = 10.0
"""Longest gradient of a run over the median of all that are not zero."""
DIFFERENCE_HALF_WIDTH: Final = 0.4
"""Step of the differences to either side, in coordinates: a third less and a half more of a number."""
_AVERAGED_FRACTION: Final = 0.25
"""Fraction of the steps whose mean is the result."""
_FINAL_RATE: Final = 0.05
"""Size of the last step over that of the first."""
_ADAM_B2: Final = 0.95
_RESTART_STEPS: Final = 20
"""Number of steps after which Adam is restarted, up to the middle of the descent: far from the optimum gradients are a
thousand times longer, and while its second moments remember them, less sensitive numbers do not move."""
_METHOD: Final = [_AVERAGED_FRACTION, _FINAL_RATE, _ADAM_B2, _RESTART_STEPS, "undefined counts as the worst"]
"""What must be the same for a descent to be resumed."""


@dataclass(frozen=True)
class GradientEstimate:
    """Metrics of a batch, and the gradient of the objective.

    Attributes:
        metrics: (runs, metrics)
        gradient: (k,) of the objective
        excluded_runs: runs without a finite gradient
        clipped_runs: runs whose gradient was clipped
    """

    metrics: np.ndarray
    gradient: np.ndarray
    excluded_runs: int
    clipped_runs: int


def differentiation_mode(nonsmooth: np.ndarray) -> str:
    """Name of the method of differentiation; flags (k,) mark the numbers that act through decisions."""
    derivative = "forward" if len(nonsmooth) <= FORWARD_MODE_MAX_INPUTS else "reverse"
    if nonsmooth.all():
        return "differences"
    return f"{derivative} and differences" if nonsmooth.any() else derivative


def estimate_gradient(
    evaluator: RolloutEvaluator, objective: Objective, nonsmooth: np.ndarray, x: np.ndarray, keys: np.ndarray
) -> GradientEstimate:
    """Gradient of the objective at coordinates `x` (k,) over runs with random keys (runs, 2).

    `nonsmooth` (k,) flags the numbers that act through decisions. The gradient is not finite where no run has a finite
    one.
    """
    found, gradient, excluded, clipped = _pathwise_gradient(evaluator, objective, nonsmooth, x, keys)
    if nonsmooth.any():
        gradient[nonsmooth] = _finite_differences(evaluator, objective, nonsmooth, x, keys)
    return GradientEstimate(found.metrics, gradient, excluded, clipped)


def run_gradients(
    evaluator: RolloutEvaluator, objective: Objective, x: np.ndarray, keys: np.ndarray
) -> tuple[RolloutResult, np.ndarray]:
    """Metrics of runs at coordinates (k,), and the derivative (runs, k) of each run's contribution to the objective."""
    inputs = np.tile(x, (len(keys), 1))
    is_reverse = evaluator.input_count > FORWARD_MODE_MAX_INPUTS
    found = evaluator.gradient(inputs, keys) if is_reverse else evaluator.jacobian(inputs, keys)
    cotangents = np.asarray(objective.gradient(jnp.asarray(found.metrics), jnp.ones(len(keys))))[..., None]
    # What undefined metrics contribute is constant, whatever their derivatives.
    if found.jacobian is not None:
        return found, np.where(cotangents == 0.0, 0.0, cotangents * found.jacobian).sum(axis=1)
    assert found.gradient is not None
    return found, np.where((cotangents == 0.0).all(axis=1), 0.0, found.gradient)


def clipped_sum(gradients: np.ndarray) -> tuple[np.ndarray, int, int]:
    """Sum (k,) of the gradients (runs, k) of runs, and how many were excluded as not finite, and clipped.

    Next to a discrete event the derivative of a run may be enormous while that of the mean is not. Runs without any
    metric have no gradient, and do not shorten those of the others.
    """
    finite = np.isfinite(gradients).all(axis=1)
    kept = gradients[finite]
    if len(kept) == 0:
        return np.full(gradients.shape[1], math.nan), len(gradients), 0
    norms = np.linalg.norm(kept, axis=1)
    longest = CLIP_RATIO * np.median(norms[norms > 0.0]) if norms.any() else 0.0
    factors = np.where(norms > longest, longest / np.where(norms > 0.0, norms, 1.0), 1.0)
    total = (kept * factors[:, None]).sum(axis=0)
    return total * len(gradients) / len(kept), int((~finite).sum()), int((factors < 1.0).sum())


def _pathwise_gradient(
    evaluator: RolloutEvaluator, objective: Objective, nonsmooth: np.ndarray, x: np.ndarray, keys: np.ndarray
) -> tuple[RolloutResult, np.ndarray, int, int]:
    """Metrics, and the clipped sum (k,) of the derivatives of runs, where any number is smooth."""
    if nonsmooth.all():
        return evaluator.evaluate(np.tile(x, (len(keys), 1)), keys), np.zeros(len(x)), 0, 0
    found, gradients = run_gradients(evaluator, objective, x, keys)
    return found, *clipped_sum(np.where(nonsmooth, 0.0, gradients))


def _finite_differences(
    evaluator: RolloutEvaluator, objective: Objective, nonsmooth: np.ndarray, x: np.ndarray, keys: np.ndarray
) -> np.ndarray:
    """Central differences of the objective; a run that loses a metric on one side points away from that side."""
    differences = []
    for index in np.flatnonzero(nonsmooth):
        move = DIFFERENCE_HALF_WIDTH * np.eye(len(x))[index]
        sides = [evaluator.evaluate(np.tile(x + sign * move, (len(keys), 1)), keys).metrics for sign in (1.0, -1.0)]
        up, down = (objective(side)[0] for side in sides)
        differences.append((up - down) / (2.0 * DIFFERENCE_HALF_WIDTH))
    return np.array(differences)


@dataclass(frozen=True)
class TuningStep:
    """Record of one step.

    Attributes:
        objective: its value
        parts: of it, without their weights
        undefined: by part, runs without a value of it, which count as the worst
        gradient_norm: of the mean over runs
        left_out: runs without a finite gradient
        shortened: runs whose gradient was clipped
        run_s: time without compilation [s]
    """

    objective: float
    parts: dict[str, float]
    undefined: dict[str, int]
    gradient_norm: float
    left_out: int
    shortened: int
    run_s: float


@dataclass(frozen=True)
class DescentState:
    """State between two steps.

    Attributes:
        coordinates: (k,) present iterate
        optimizer_leaves: leaves of the state of Adam
        iterate_sum: (k,) sum of the averaged iterates so far
        steps: made so far
    """

    coordinates: np.ndarray
    optimizer_leaves: list[np.ndarray]
    iterate_sum: np.ndarray
    steps: tuple[TuningStep, ...]


def initial_state(optimizer: Any, x: np.ndarray) -> DescentState:
    """State before the first step at coordinates `x` (k,)."""
    return DescentState(x, [np.asarray(leaf) for leaf in jax.tree.leaves(optimizer.init(x))], np.zeros_like(x), ())


def load_state(progress_file: Path, initial: DescentState, identity: dict[str, Any]) -> DescentState:
    """State in a file, of the same structure as an initial one.

    Raises:
        ResultError: the file holds none, or that of a tuning with another identity.
    """
    content = atomic_files.read_json(progress_file, "the progress of a tuning", FileKind.PROGRESS)
    another = f"{progress_file}: found the progress of another tuning, expected that of this one"
    try:
        if content["of"] != identity:
            raise ResultError(another)
        leaves = [
            np.asarray(leaf, dtype=kind.dtype).reshape(kind.shape)
            for leaf, kind in zip(content["optimizer"], initial.optimizer_leaves, strict=True)
        ]
        steps = tuple(TuningStep(**step) for step in content["steps"])
        coordinates, iterate_sum = (np.asarray(content[name], dtype=float) for name in ("x", "tail"))
    except (KeyError, TypeError, ValueError) as error:
        raise ResultError(f"{progress_file}: found {error!r}, expected the progress of a tuning") from None
    if coordinates.shape != initial.coordinates.shape:
        raise ResultError(another)
    return DescentState(coordinates, leaves, iterate_sum, steps)


def save_state(progress_file: Path, identity: dict[str, Any], state: DescentState) -> None:
    """Writes a state, and the identity of its tuning."""
    content = {
        "of": identity,
        "x": state.coordinates.tolist(),
        "optimizer": [leaf.tolist() for leaf in state.optimizer_leaves],
        "tail": state.iterate_sum.tolist(),
        "steps": [asdict(step) for step in state.steps],
    }
    atomic_files.write_json(progress_file, content)


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
    state = initial_state(optimizer, tunable.initial)
    if resume and progress_file is not None:
        state = load_state(progress_file, state, json.loads(json.dumps(identity)))
    while len(state.steps) < settings.steps:
        state = _step(evaluator, objective, tunable.nonsmooth, optimizer, settings, state)
        on_step(len(state.steps), state.steps[-1])
        if progress_file is not None:
            save_state(progress_file, identity, state)
    x = state.iterate_sum / _averaged_steps(settings.steps)
    values = {key: np.asarray(value).tolist() for key, value in tunable.values(jax.numpy.asarray(x)).items()}
    mode = differentiation_mode(tunable.nonsmooth)
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
                f"runs of a longer horizon (--horizon, horizon_s, now {settings.horizon_s or 0.0:g} s) may have it, "
                "and a weight of 0 leaves it out"
            )


def _averaged_steps(steps: int) -> int:
    return max(1, round(_AVERAGED_FRACTION * steps))


def _restarts(number: int, steps: int) -> bool:
    """Whether Adam is restarted before step `number` of `steps`, counted from 0."""
    return number % _RESTART_STEPS == 0 and number <= steps // 2


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
    found = estimate_gradient(evaluator, objective, nonsmooth, state.coordinates, keys)
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
