"""Batched rollouts of the closed loop as a function of a few inputs: metrics, and their derivatives in both modes.

The caller chooses the inputs: gains to be tuned, or the standard normal variables of the dispersions. Runs are
independent, so there is one derivative per run, and those of failed runs can be left out.
"""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Literal

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from rpojax.analysis.gradients import trained_tensors
from rpojax.campaign import single_run
from rpojax.campaign.execution.run_programs import batch_transform
from rpojax.core.pytree import concatenate
from rpojax.flight.stages import Stages
from rpojax.runtime import compiler_options
from rpojax.runtime.device_mesh import DeviceMesh, gather_rows, own_rows, padded_batches
from rpojax.runtime.programs_per_device import share_runs
from rpojax.scenario.dispersed_numbers.dispersed_values import Values
from rpojax.scenario.params import Params
from rpojax.scenario.plugins import plugin_registry
from rpojax.scenario.schema import ScenarioFile
from rpojax.scenario.team.members import refuse_team
from rpojax.simulation import initial_state
from rpojax.simulation.metrics import running_metrics
from rpojax.simulation.metrics.running_metrics import RunningSums
from rpojax.simulation.state import State, state_axes
from rpojax.simulation.step import step

InputFunction = Callable[[Array, Array], Values]
"""Map from the inputs (k,) and the random key of a run to values by scenario key, in the user's units."""
RunStatus = tuple[Array, Array]
"""Of runs (runs,): failed or not, and the hash of their events."""
CotangentFunction = Callable[[Array, Array], Array]
"""Derivative (runs, metrics) of a number to the metrics of runs, from these metrics and a mask (runs,): 1 for runs that
count, 0 for padding."""
ProgramKind = Literal["values", "forward", "reverse", "reverse of all"]
"""`reverse` is that of a weighted sum of metrics, `reverse of all` that of a function of all runs in one batch."""
_COMPILING: dict[ProgramKind, str] = {
    "values": "compiling runs",
    "forward": "compiling runs and derivatives, a minute or more",
    "reverse": "compiling runs and derivatives, some minutes",
    "reverse of all": "compiling runs and derivatives, some minutes",
}
"""What is said while a program is compiled."""
RUNS_PER_DEVICE = 64
"""Runs at a time on each device; more are no faster."""
_LEAST_RUNS_PER_DEVICE = 4
"""XLA does not compile the derivative of a close approach for batches of one: it aborts or takes for ever."""
CHECKPOINT_MEMORY_BYTES = 2_000_000_000
"""Memory for the kept states of the reverse mode on each device; beyond it states are computed twice [B]."""
FORWARD_MODE_MAX_INPUTS = 4
"""Inputs up to which the forward mode is the faster one (measured; see experiments/tuning)."""


def checkpoint_interval(ticks: int, state_bytes: int, runs: int, memory_bytes: int) -> int:
    """Ticks between kept states in reverse mode: 1 if all states fit, else the interval of least memory."""
    if ticks * state_bytes * runs <= memory_bytes:
        return 1
    return max(2, round(ticks**0.5))


def checkpointed_scan(function: Callable[[Any], Any], start: Any, length: int, interval: int) -> Any:
    """`function` applied `length` times; the reverse mode keeps one state in every `interval`, none at all with 0.

    Within a tick nothing is kept: computing it again is cheaper than the traffic to memory.
    """
    if interval == 0:
        return jax.lax.scan(lambda carry, _: (function(carry), None), start, None, length=length)[0]
    body = jax.checkpoint(function)

    def scan_ticks(carry: Any, count: int) -> Any:
        return jax.lax.scan(lambda inner, _: (body(inner), None), carry, None, length=count)[0]

    if interval == 1:
        return scan_ticks(start, length)
    scan_interval = jax.checkpoint(lambda carry: scan_ticks(carry, interval))
    carry = jax.lax.scan(lambda inner, _: (scan_interval(inner), None), start, None, length=length // interval)[0]
    return scan_ticks(carry, length % interval)


@dataclass(frozen=True)
class RolloutResult:
    """Metrics of runs and their derivatives.

    Attributes:
        metrics: (runs, metrics), NaN where undefined, and for runs that ended early
        jacobian: (runs, metrics, k) from the forward mode, else None; NaN where the metric is undefined
        gradient: (runs, k) from the reverse mode, else None: of the weighted sum of metrics, NaN where one of them with
            a weight is undefined, or of a function of all metrics, to which undefined ones contribute nothing
        failed: (runs,) bool, the run ended early
        events: (runs,) hash of the accepted and rejected boxes and of the guidance modes at all ticks
    """

    metrics: np.ndarray
    jacobian: np.ndarray | None
    gradient: np.ndarray | None
    failed: np.ndarray
    events: np.ndarray


class RolloutEvaluator:
    """Metrics of runs of a scenario as a function of inputs, compiled once for each kind of derivative.

    Attributes:
        file: the scenario
        metric_names: of the scenario, without those that need whole records
        input_count: number of inputs, k
        runs_per_device: runs that a device simulates at once
        checkpoint_ticks: ticks from one kept state to the next in reverse mode
        compile_s: compilation so far [s]
        program_memory_bytes: temporary memory of the largest program, on all devices together [B]
    """

    def __init__(
        self,
        file: ScenarioFile,
        input_function: InputFunction,
        input_count: int,
        metric_names: Sequence[str],
        runs: int,
        stages: Stages | None = None,
        cotangent: CotangentFunction | None = None,
        checkpoint_memory_bytes: int = CHECKPOINT_MEMORY_BYTES,
        on_stage: Callable[[str], None] = lambda words: None,
    ) -> None:
        """Compiles nothing yet; `on_stage` gets a description when a compilation or a simulation begins."""
        self.file, self.metric_names, self.input_count = file, tuple(metric_names), input_count
        refuse_team(file, "derivatives of runs")
        self.scenario, self._nominal = single_run.nominal_parameters(file)
        self._stages = plugin_registry.stages_of(file, stages)
        known = plugin_registry.catalogue_of(file)
        self._metrics = [known[name] for name in self.metric_names]
        self._input_function, self._cotangent, self._on_stage = input_function, cotangent, on_stage
        devices, shared = share_runs(runs, RUNS_PER_DEVICE)
        self.runs_per_device = max(shared, _LEAST_RUNS_PER_DEVICE)
        self._mesh = DeviceMesh(devices)
        self.checkpoint_ticks = checkpoint_interval(
            self.scenario.ticks, self._state_bytes(), self.runs_per_device, checkpoint_memory_bytes
        )
        self._programs: dict[ProgramKind, Any] = {}
        self.compile_s = 0.0
        self.program_memory_bytes = 0

    @property
    def batch_size(self) -> int:
        """Runs that all devices take at once."""
        return self.runs_per_device * self._mesh.size

    def take_gates_as_steps(self) -> None:
        """Derivatives see gates and dead band as the steps that they are, without slopes; before the first of them."""
        self._nominal = self._nominal.with_steps()

    def soften_detector(self, temperature: float) -> None:
        """The detector of a rendered camera is soft (`static_settings.Scenario`); before the first evaluation."""
        self.scenario = replace(self.scenario, temperature=temperature)

    def evaluate(self, inputs: np.ndarray, keys: np.ndarray) -> RolloutResult:
        """Metrics alone, for inputs (runs, k) and random keys (runs, 2)."""
        return self._run_batches("values", inputs, keys)

    def jacobian(self, inputs: np.ndarray, keys: np.ndarray) -> RolloutResult:
        """Metrics and their Jacobian in forward mode: costs about 0.75 of a run for each input."""
        return self._run_batches("forward", inputs, keys)

    def gradient(self, inputs: np.ndarray, keys: np.ndarray, weights: np.ndarray | None = None) -> RolloutResult:
        """Metrics, and the gradient of their weighted sum in reverse mode: costs about seven runs.

        Without `weights` (runs, metrics) it is the gradient of the number of which the evaluator's cotangent function
        is the derivative. Where the runs make several batches, that costs a run more: the derivative depends on the
        metrics of all of them.
        """
        if weights is None:
            assert self._cotangent is not None
            if len(inputs) <= self.batch_size:
                return self._run_batches("reverse of all", inputs, keys)
            metrics = self.evaluate(inputs, keys).metrics
            cotangents = np.asarray(self._cotangent(jnp.asarray(metrics), jnp.ones(len(metrics))))
            return self._run_batches("reverse", inputs, keys, cotangents)
        found = self._run_batches("reverse", inputs, keys, weights)
        assert found.gradient is not None
        undefined = (np.isnan(found.metrics) & (weights != 0.0)).any(axis=1, keepdims=True)
        return replace(found, gradient=np.where(undefined, np.nan, found.gradient))

    def _run_batches(self, kind: ProgramKind, *arrays: np.ndarray) -> RolloutResult:
        """Runs in batches that the devices share."""
        program = self._compiled(kind)
        runs = len(arrays[0])
        parts = []
        for rows, counted in padded_batches(runs, self.batch_size):
            inputs = (counted.astype(np.float64), *(array[rows] for array in arrays))
            # One batch at a time: two programs on the same devices may deadlock.
            parts.append(jax.tree.map(np.asarray, program(self._nominal, *inputs)))
        metrics, failed, events, *derivative = (column[:runs] for column in concatenate(parts))
        return RolloutResult(
            metrics=metrics,
            jacobian=np.where(np.isnan(metrics)[..., None], np.nan, derivative[0]) if kind == "forward" else None,
            gradient=derivative[0] if kind.startswith("reverse") else None,
            failed=failed,
            events=events,
        )

    def _compiled(self, kind: ProgramKind) -> Any:
        if kind not in self._programs:
            self._on_stage(_COMPILING[kind])
            begin = time.perf_counter()
            function = {
                "values": self._traced_metrics,
                "forward": self._traced_jacobian,
                "reverse": self._traced_gradient,
                "reverse of all": self._traced_gradient_of_all,
            }[kind]
            shapes = [(), (self.input_count,), (2,), (len(self.metric_names),)][: 4 if kind == "reverse" else 3]
            types = [np.float64, np.float64, np.uint32, np.float64]
            arguments = [
                jax.ShapeDtypeStruct((self.batch_size, *shape), dtype)
                for shape, dtype in zip(shapes, types, strict=False)
            ]
            lowered = jax.jit(self._mesh.by_rows(function, whole=1)).lower(self._nominal, *arguments)
            (program,) = compiler_options.compile_in_threads([lowered])
            self.compile_s += time.perf_counter() - begin
            if needed := program.memory_analysis():
                self.program_memory_bytes = max(self.program_memory_bytes, needed.temp_size_in_bytes * self._mesh.size)
            self._programs[kind] = program
            self._on_stage("simulating")
        return self._programs[kind]

    def _traced_metrics(self, nominal: Params, _: Array, inputs: Array, keys: Array) -> tuple[Array, ...]:
        metrics, status = self._defined_metrics(nominal, inputs, keys)
        return metrics, *status

    def _defined_metrics(
        self, nominal: Params, inputs: Array, keys: Array, checkpoint_ticks: int = 0
    ) -> tuple[Array, RunStatus]:
        """What `_simulate_metrics` gives, NaN for runs that ended early: as in campaigns, they have no metrics."""
        metrics, status = self._simulate_metrics(nominal, inputs, keys, checkpoint_ticks)
        return jnp.where(status[0][:, None], jnp.nan, metrics), status

    def _simulate_metrics(
        self, nominal: Params, inputs: Array, keys: Array, checkpoint_ticks: int = 0
    ) -> tuple[Array, RunStatus]:
        """Metrics (runs, metrics), failures and events of runs; without `checkpoint_ticks` there is no reverse mode."""
        axes = state_axes(-1)
        values = jax.vmap(self._input_function)(inputs, keys)

        def begin(values: Values, key: Array) -> State:
            params = trained_tensors.apply_to_params(nominal, values)
            return initial_state.init(self.scenario, params, key, stages=self._stages)

        def tick(values: Values, state: State, sums: RunningSums) -> tuple[State, RunningSums]:
            params = trained_tensors.apply_to_params(nominal, values)
            after, telemetry = step(self.scenario, params, state, self._stages)
            return after, running_metrics.add_tick(self._metrics, self.scenario, params, telemetry, sums)

        batched_tick = batch_transform(self.scenario)(tick, in_axes=(-1, axes, -1), out_axes=(axes, -1))
        state = jax.vmap(begin, out_axes=axes)(values, keys)
        sums = jax.vmap(lambda _: running_metrics.initial_sums(self._metrics), out_axes=-1)(keys)
        batched_values = {name: jnp.moveaxis(value, 0, -1) for name, value in values.items()}
        state, sums = checkpointed_scan(
            lambda carry: batched_tick(batched_values, *carry), (state, sums), self.scenario.ticks, checkpoint_ticks
        )
        metrics = jax.vmap(partial(running_metrics.final_values, self._metrics), in_axes=-1)(sums)
        return metrics, (state.failure > 0, sums.event_hash)

    def _traced_jacobian(self, nominal: Params, _: Array, inputs: Array, keys: Array) -> tuple[Array, ...]:
        def along(direction: Array) -> tuple[Array, ...]:
            tangent = jnp.broadcast_to(direction, inputs.shape)
            metrics, change, status = jax.jvp(
                lambda x: self._defined_metrics(nominal, x, keys), (inputs,), (tangent,), has_aux=True
            )
            return metrics, *status, change

        directions = jnp.eye(self.input_count, dtype=inputs.dtype)
        return jax.vmap(along, out_axes=(None, None, None, 2))(directions)

    def _traced_gradient(
        self, nominal: Params, _: Array, inputs: Array, keys: Array, weights: Array
    ) -> tuple[Array, ...]:
        metrics, pull_back, status = self._reversible_metrics(nominal, inputs, keys)
        return metrics, *status, pull_back(weights)[0]

    def _traced_gradient_of_all(self, nominal: Params, mask: Array, inputs: Array, keys: Array) -> tuple[Array, ...]:
        assert self._cotangent is not None
        metrics, pull_back, status = self._reversible_metrics(nominal, inputs, keys)
        cotangents = self._cotangent(*map(gather_rows, (metrics, mask)))
        return metrics, *status, pull_back(own_rows(cotangents))[0]

    def _reversible_metrics(self, nominal: Params, inputs: Array, keys: Array) -> tuple[Array, Any, RunStatus]:
        """Metrics of runs, the function from their cotangents to that of the inputs, and the status of the runs."""
        return jax.vjp(
            lambda x: self._defined_metrics(nominal, x, keys, checkpoint_ticks=self.checkpoint_ticks),
            inputs,
            has_aux=True,
        )

    def _state_bytes(self) -> int:
        """Size of the carry of a run from tick to tick [B]."""
        key = jax.ShapeDtypeStruct((2,), np.uint32)
        state = jax.eval_shape(
            lambda key: initial_state.init(self.scenario, self._nominal, key, stages=self._stages), key
        )
        sums = jax.eval_shape(lambda: running_metrics.initial_sums(self._metrics))
        return sum(leaf.size * leaf.dtype.itemsize for leaf in jax.tree.leaves((state, sums)))
