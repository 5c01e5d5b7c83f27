"""Tuning by gradient: Adam down the derivative of the closed loop, with fresh runs at every step.

Fresh runs keep the walk from learning the noise of a few; it ends with small steps, and the mean of its last quarter is
its result, so that what is left of the noise averages out (Polyak and Juditsky, 1992).
"""

import json
import math
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any, Final

import jax
import numpy as np
import optax

from rpojax.analysis.gradients import gradient_estimator, tunable_parameters
from rpojax.analysis.gradients.rollout_evaluator import RolloutEvaluator, run_keys
from rpojax.analysis.gradients.tuning_objective import Objective
from rpojax.campaign.storage import atomic_files
from rpojax.errors import ResultError, RpojaxError, ScenarioError
from rpojax.flight.computer import Stages
from rpojax.scenario import scenario_file
from rpojax.scenario.schema import ScenarioFile

_TAIL: Final = 0.25
"""Share of the steps whose mean is the result."""
_LAST_RATE: Final = 0.05
"""Size of the last step over that of the first."""
_MEMORY: Final = 0.95
"""Of the size of gradients from step to step."""
_FRESH_START: Final = 20
"""After so many steps, up to the middle of the walk, Adam starts afresh: far from the goal gradients are a thousand
times longer, and as long as it remembers that, what matters little does not move."""
_METHOD: Final = [_TAIL, _LAST_RATE, _MEMORY, _FRESH_START]
"""What must be the same for a walk to go on as it began."""
_LARGEST_FILE: Final = 50_000_000


@dataclass(frozen=True)
class TuningSettings:
    """How to tune.

    Attributes:
        parameters: names of groups and keys
        runs: per step
        steps: of the walk
        seed: of the runs; step n flies runs n * runs and on
        horizon_s: length of each run [s]
        rate: length of the first steps, in coordinates: 0.2 changes a number by about twenty per cent
    """

    parameters: tuple[str, ...]
    runs: int = 64
    steps: int = 80
    seed: int = 0
    horizon_s: float = 2000.0
    rate: float = 0.2


@dataclass(frozen=True)
class TuningStep:
    """What there was to see at one step.

    Attributes:
        objective: its value
        parts: of it, without their weights
        gradient_norm: of the mean over runs
        left_out: runs without a finite gradient
        shortened: runs whose gradient was clipped
        run_s: time it took [s]
    """

    objective: float
    parts: dict[str, float]
    gradient_norm: float
    left_out: int
    shortened: int
    run_s: float


@dataclass(frozen=True)
class DescentState:
    """Where a walk is.

    Attributes:
        x: (k,) coordinates
        optimizer: leaves of the state of Adam
        tail: (k,) sum of the coordinates of the last quarter so far
        steps: made so far
    """

    coordinates: np.ndarray
    optimizer_leaves: list[np.ndarray]
    iterate_sum: np.ndarray
    steps: tuple[TuningStep, ...]


@dataclass(frozen=True)
class TuningResult:
    """Result of a walk.

    Attributes:
        x: (k,) coordinates, mean of the last quarter
        values: by key, in the user's units
        steps: all
        mode: of differentiation, as `slopes.mode`
        compile_s: [s]
        memory_bytes: of the programs beside their arguments [B]
    """

    coordinates: np.ndarray
    values: dict[str, Any]
    steps: tuple[TuningStep, ...]
    mode: str
    compile_s: float
    memory_bytes: int


def scenario_at_horizon(file: ScenarioFile, settings: TuningSettings) -> ScenarioFile:
    """The scenario at the horizon of the tuning.

    Raises:
        RpojaxError: a setting makes no sense, or the scenario cannot be tuned by gradient.
    """
    for option, found, good in (
        ("--runs", settings.runs, settings.runs >= 1),
        ("--steps", settings.steps, settings.steps >= 1),
        ("--rate", settings.rate, 0.0 < settings.rate <= 1.0),
        ("--seed", settings.seed, 0 <= settings.seed < 2**63),
        ("--horizon", settings.horizon_s, math.isfinite(settings.horizon_s) and settings.horizon_s > 0.0),
    ):
        if not good:
            raise RpojaxError(f"{option}: found {found}, expected {_EXPECTED[option]}")
    if file.camera.model == "rendered":
        raise ScenarioError("camera.model", "rendered", "'geometric' or 'statistical': pictures have no useful slope")
    if file.design.kind != "independent":
        raise ScenarioError("design.kind", file.design.kind, "'independent', since every step draws fresh runs")
    horizon = min(settings.horizon_s, file.duration_s)
    return scenario_file.validate({**file.model_dump(), "duration_s": horizon})


_EXPECTED: Final = {
    "--runs": "at least 1",
    "--steps": "at least 1",
    "--rate": "a number above 0 and up to 1",
    "--seed": "a number from 0",
    "--horizon": "a time above 0 s",
}


def descend(
    file: ScenarioFile,
    settings: TuningSettings,
    progress_file: Path | None = None,
    resume: bool = False,
    on_step: Callable[[int, TuningStep], None] = lambda number, step: None,
    stages: Stages | None = None,
) -> TuningResult:
    """Tunes numbers of a scenario; each step is kept in `progress_file`, from which `resume` goes on.

    Raises:
        RpojaxError: a setting makes no sense, the scenario cannot be tuned, or its start gives no finite objective.
    """
    short = scenario_at_horizon(file, settings)
    objective = Objective(short)
    chosen = tunable_parameters.select_parameters(short, settings.parameters)
    inputs = partial(tunable_parameters.run_values, short, chosen)
    flights = RolloutEvaluator(
        short, inputs, chosen.count, objective.metric_names, settings.runs, stages, objective.gradient
    )
    optimizer = optax.scale_by_adam(b2=_MEMORY)
    of_file = {"scenario_hash": scenario_file.digest(file), "tuning": file.tuning.model_dump()}
    identity = {**asdict(settings), "method": _METHOD, **of_file}
    walk = _new(optimizer, chosen.initial)
    if resume and progress_file is not None:
        walk = _under_way(progress_file, walk, json.loads(json.dumps(identity)))
    while len(walk.steps) < settings.steps:
        walk = _step(flights, objective, chosen.nonsmooth, optimizer, settings, walk)
        on_step(len(walk.steps), walk.steps[-1])
        if progress_file is not None:
            _save(progress_file, identity, walk)
    x = walk.iterate_sum / _tail_length(settings.steps)
    values = {key: np.asarray(value).tolist() for key, value in chosen.values(jax.numpy.asarray(x)).items()}
    return TuningResult(
        x,
        values,
        walk.steps,
        gradient_estimator.differentiation_mode(chosen.nonsmooth),
        flights.compile_s,
        flights.program_memory_bytes,
    )


def _restarts(number: int, steps: int) -> bool:
    """Whether Adam forgets before step `number`, counted from 0, of a walk of so many."""
    return number % _FRESH_START == 0 and number <= steps // 2


def _tail_length(steps: int) -> int:
    return max(1, round(_TAIL * steps))


def _new(optimizer: Any, x: np.ndarray) -> DescentState:
    return DescentState(x, [np.asarray(leaf) for leaf in jax.tree.leaves(optimizer.init(x))], np.zeros_like(x), ())


def _under_way(progress_file: Path, new: DescentState, identity: dict[str, Any]) -> DescentState:
    """The walk that a file holds, of the same form as a new one."""
    content = atomic_files.read_json(progress_file, "the progress of a tuning", _LARGEST_FILE)
    another = f"{progress_file}: found the progress of another tuning, expected that of this one"
    try:
        if content["of"] != identity:
            raise ResultError(another)
        leaves = [
            np.asarray(leaf, dtype=kind.dtype).reshape(kind.shape)
            for leaf, kind in zip(content["optimizer"], new.optimizer_leaves, strict=True)
        ]
        steps = tuple(TuningStep(**step) for step in content["steps"])
        walk = DescentState(
            np.asarray(content["x"], dtype=float), leaves, np.asarray(content["tail"], dtype=float), steps
        )
    except (KeyError, TypeError, ValueError) as error:
        raise ResultError(f"{progress_file}: found {error!r}, expected the progress of a tuning") from None
    if walk.coordinates.shape != new.coordinates.shape:
        raise ResultError(another)
    return walk


def _save(progress_file: Path, identity: dict[str, Any], walk: DescentState) -> None:
    content = {
        "of": identity,
        "x": walk.coordinates.tolist(),
        "optimizer": [leaf.tolist() for leaf in walk.optimizer_leaves],
        "tail": walk.iterate_sum.tolist(),
        "steps": [asdict(step) for step in walk.steps],
    }
    atomic_files.write_json(progress_file, content)


def _step(
    flights: RolloutEvaluator,
    objective: Objective,
    decides: np.ndarray,
    optimizer: Any,
    settings: TuningSettings,
    walk: DescentState,
) -> DescentState:
    number = len(walk.steps)
    keys = run_keys(settings.seed, number * settings.runs + np.arange(settings.runs))
    compiled = flights.compile_s
    begin = time.perf_counter()
    found = gradient_estimator.estimate_gradient(flights, objective, decides, walk.coordinates, keys)
    value, parts = objective(found.metrics)
    if not math.isfinite(value):
        raise RpojaxError(
            f"step {number + 1}: found an objective of {value}, expected a finite one; try a lower --rate"
        )
    if not np.isfinite(found.gradient).all():
        raise RpojaxError(f"step {number + 1}: found no run with a finite gradient, expected some; try a lower --rate")
    state = optimizer.init(walk.coordinates)
    if not _restarts(number, settings.steps):
        state = jax.tree.unflatten(jax.tree.structure(state), walk.optimizer_leaves)
    rate = optax.cosine_decay_schedule(settings.rate, settings.steps, _LAST_RATE)
    with jax.numpy_dtype_promotion("standard"):  # optax mixes types
        updates, state = optimizer.update(found.gradient, state)
        x = walk.coordinates - np.asarray(rate(number)) * np.asarray(updates)
    run_s = time.perf_counter() - begin - (flights.compile_s - compiled)
    step = TuningStep(
        value, parts, float(np.linalg.norm(found.gradient)), found.excluded_runs, found.clipped_runs, run_s
    )
    counts = number >= settings.steps - _tail_length(settings.steps)
    leaves = [np.asarray(leaf) for leaf in jax.tree.leaves(state)]
    return DescentState(x, leaves, walk.iterate_sum + (x if counts else 0.0), (*walk.steps, step))


def tuned_scenario(file: ScenarioFile, values: dict[str, Any]) -> ScenarioFile:
    """The scenario with other values for some of its keys."""
    tables = file.model_dump(mode="json")
    for key, value in values.items():
        section, _, name = key.partition(".")
        tables[section][name] = value
    return scenario_file.validate(tables)


def split_names(words: Sequence[str]) -> tuple[str, ...]:
    """Names of groups and keys, from words with commas between names."""
    return tuple(name for word in words for name in word.split(",") if name)
