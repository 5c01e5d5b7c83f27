"""Runs of the closed loop as a function of a few numbers: figures of merit, and their derivatives in both modes.

What the numbers mean is the caller's: gains to be tuned, or the coordinates from which dispersions are made. Runs are
independent, so a derivative is one per run, and those of runs that were lost can be told apart.
"""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, Literal

import jax
import jax.numpy as jnp
import numpy as np
from jax.sharding import Mesh, PartitionSpec
from jaxtyping import Array

from rpojax.campaign import single_run
from rpojax.campaign.execution.batch_engine import batching, run_axes
from rpojax.dispersions import dispersed_values
from rpojax.dispersions.dispersed_values import Values
from rpojax.flight.computer import Stages
from rpojax.scenario.params import Params
from rpojax.scenario.schema import ScenarioFile
from rpojax.simulation import closed_loop, running_metrics
from rpojax.simulation.closed_loop import State
from rpojax.simulation.running_metrics import Sums

Inputs = Callable[[Array, Array], Values]
"""Values in the user's units by scenario key, from the numbers (k,) and the random key of a run."""
Seen = tuple[Array, Array]
"""Of runs: failed or not, and the fingerprint of their events."""
Slope = Callable[[Array, Array, Array], Array]
"""Weights (runs, figures) from the figures of all runs of a batch, the weights given, and (runs,) 1 for runs that count
and 0 for those that fill up the batch."""
Program = Literal["values", "forward", "reverse"]

BATCH = 64
"""Runs at a time on each device: more are no faster."""
MEMORY_BYTES = 2_000_000_000
"""What the states kept for the reverse mode may take on each device before they are worked out twice instead [B]."""
_RUNS = "runs"
FORWARD_UP_TO = 4
"""Numbers up to which the forward mode is the faster one (measured; see experiments/tuning)."""


@dataclass(frozen=True)
class Found:
    """Figures of runs and what they depend on.

    Attributes:
        figures: (runs, figures)
        jacobian: (runs, figures, k) from the forward mode, else None
        gradient: (runs, k) of the weighted sum of figures, from the reverse mode, else None
        failed: (runs,) bool, the run ended before its time
        events: (runs,) the same number for the same boxes taken and refused and the same modes, at all ticks
    """

    figures: np.ndarray
    jacobian: np.ndarray | None
    gradient: np.ndarray | None
    failed: np.ndarray
    events: np.ndarray


def given_weights(figures: Array, weights: Array, there: Array) -> Array:
    """The slope of a sum of figures with the weights that are given."""
    del figures
    return weights * there[:, None]


class Flights:
    """Runs of a scenario as a function of numbers, compiled once for each kind of derivative that is asked for.

    Attributes:
        file: the scenario
        names: of the figures, from `running_metrics.FIGURES`
        count: of the numbers
        compile_s: time that compilation has taken so far [s]
        memory_bytes: that the largest program takes beside its arguments, on all devices together
    """

    def __init__(
        self,
        file: ScenarioFile,
        inputs: Inputs,
        count: int,
        names: Sequence[str],
        runs: int,
        stages: Stages | None = None,
        slope: Slope = given_weights,
        memory_bytes: int = MEMORY_BYTES,
    ) -> None:
        self.file, self.names, self.count = file, tuple(names), count
        self.scenario, self._nominal = single_run.nominal(file)
        self._inputs, self._stages, self._slope = inputs, stages or Stages(), slope
        devices = jax.devices()[:runs]
        self._mesh = Mesh(np.array(devices), (_RUNS,))
        self.size = min(BATCH, -(-runs // len(devices)))
        self.chunk_ticks = chunk_ticks(self.scenario.ticks, self._state_bytes(), self.size, memory_bytes)
        self._programs: dict[Program, Any] = {}
        self.compile_s = 0.0
        self.memory_bytes = 0

    @property
    def capacity(self) -> int:
        """Runs that all devices take at once."""
        return self.size * self._mesh.size

    def values(self, numbers: np.ndarray, keys: np.ndarray) -> Found:
        """Figures alone, for numbers (runs, k) and random keys (runs, 2) of runs."""
        return self._fly("values", numbers, keys)

    def forward(self, numbers: np.ndarray, keys: np.ndarray) -> Found:
        """Figures and their Jacobian in forward mode: takes about 0.75 of a flight for each number."""
        return self._fly("forward", numbers, keys)

    def reverse(self, numbers: np.ndarray, keys: np.ndarray, weights: np.ndarray | None = None) -> Found:
        """Figures, and the gradient of their weighted sum in reverse mode: about seven flights.

        `weights` (runs, figures) are needed unless the flights have a slope of their own, which then is that of each
        batch of runs.
        """
        chosen = np.zeros((len(numbers), len(self.names))) if weights is None else weights
        return self._fly("reverse", numbers, keys, chosen)

    def _fly(self, kind: Program, *arrays: np.ndarray) -> Found:
        """Runs in batches, each spread over all devices; the last one is filled up with its last run."""
        program = self._compiled(kind)
        runs = len(arrays[0])
        parts = []
        for first in range(0, runs, self.capacity):
            rows = np.minimum(np.arange(first, first + self.capacity), runs - 1)
            there = (rows == np.arange(first, first + self.capacity)).astype(np.float64)
            # One batch at a time: two programs that span the same devices may wait for each other for ever.
            parts.append(jax.tree.map(np.asarray, program(self._nominal, there, *(array[rows] for array in arrays))))
        figures, failed, events, *derivative = (np.concatenate(column)[:runs] for column in zip(*parts, strict=True))
        return Found(
            figures=figures,
            jacobian=derivative[0] if kind == "forward" else None,
            gradient=derivative[0] if kind == "reverse" else None,
            failed=failed,
            events=events,
        )

    def _compiled(self, kind: Program) -> Any:
        if kind not in self._programs:
            begin = time.perf_counter()
            function = {"values": self._values, "forward": self._jacobian, "reverse": self._gradient}[kind]
            shapes = [(), (self.count,), (2,), (len(self.names),)][: 4 if kind == "reverse" else 3]
            types = [np.float64, np.float64, np.uint32, np.float64]
            forms = zip(shapes, types, strict=False)
            arguments = [jax.ShapeDtypeStruct((self.capacity, *shape), dtype) for shape, dtype in forms]
            spread = jax.shard_map(
                function,
                mesh=self._mesh,
                in_specs=(PartitionSpec(), *[PartitionSpec(_RUNS)] * len(arguments)),
                out_specs=PartitionSpec(_RUNS),
                check_vma=False,
            )
            program = jax.jit(spread).lower(self._nominal, *arguments).compile()
            self.compile_s += time.perf_counter() - begin
            if needed := program.memory_analysis():
                self.memory_bytes = max(self.memory_bytes, needed.temp_size_in_bytes * self._mesh.size)
            self._programs[kind] = program
        return self._programs[kind]

    def _values(self, nominal: Params, _: Array, numbers: Array, keys: Array) -> tuple[Array, ...]:
        figures, seen = self._figures(nominal, numbers, keys)
        return figures, *seen

    def _figures(self, nominal: Params, numbers: Array, keys: Array, chunk: int = 0) -> tuple[Array, Seen]:
        """Figures (runs, figures), failures and events of runs; `chunk` 0 keeps nothing for a reverse mode."""
        axes = run_axes(-1)
        values = jax.vmap(self._inputs)(numbers, keys)

        def begin(values: Values, key: Array) -> State:
            return closed_loop.init(self.scenario, dispersed_values.apply(nominal, values), key)

        def one(values: Values, state: State, sums: Sums) -> tuple[State, Sums]:
            params = dispersed_values.apply(nominal, values)
            after, seen = closed_loop.tick(self._stages, self.scenario, params, state)
            return after, running_metrics.add(self.names, self.scenario, params, seen, sums)

        every = batching(self.scenario)(one, in_axes=(-1, axes, -1), out_axes=(axes, -1))
        state = jax.vmap(begin, out_axes=axes)(values, keys)
        sums = jax.vmap(lambda _: running_metrics.start(self.names), out_axes=-1)(keys)
        own = {name: jnp.moveaxis(value, 0, -1) for name, value in values.items()}
        state, sums = _scan(lambda carry: every(own, *carry), (state, sums), self.scenario.ticks, chunk)
        figures = jax.vmap(partial(running_metrics.finish, self.names), in_axes=-1)(sums)
        return figures, (state.failure > 0, sums.events)

    def _jacobian(self, nominal: Params, _: Array, numbers: Array, keys: Array) -> tuple[Array, ...]:
        def along(direction: Array) -> tuple[Array, ...]:
            tangent = jnp.broadcast_to(direction, numbers.shape)
            figures, change, seen = jax.jvp(
                lambda x: self._figures(nominal, x, keys), (numbers,), (tangent,), has_aux=True
            )
            return figures, *seen, change

        directions = jnp.eye(self.count, dtype=numbers.dtype)
        return jax.vmap(along, out_axes=(None, None, None, 2))(directions)

    def _gradient(
        self, nominal: Params, there: Array, numbers: Array, keys: Array, weights: Array
    ) -> tuple[Array, ...]:
        figures, pull_back, seen = jax.vjp(
            lambda x: self._figures(nominal, x, keys, chunk=self.chunk_ticks), numbers, has_aux=True
        )
        every = (jax.lax.all_gather(array, _RUNS, tiled=True) for array in (figures, weights, there))
        own = jax.lax.axis_index(_RUNS) * self.size
        slopes = jax.lax.dynamic_slice_in_dim(self._slope(*every), own, self.size)
        return figures, *seen, pull_back(slopes)[0]

    def _state_bytes(self) -> int:
        """Size of what a run carries from tick to tick [B]."""
        key = jax.ShapeDtypeStruct((2,), np.uint32)
        state = jax.eval_shape(lambda key: closed_loop.init(self.scenario, self._nominal, key), key)
        sums = jax.eval_shape(lambda: running_metrics.start(self.names))
        return sum(leaf.size * leaf.dtype.itemsize for leaf in jax.tree.leaves((state, sums)))


def run_keys(seed: int, ids: np.ndarray) -> np.ndarray:
    """Random keys (runs, 2) of the runs of a campaign with a given seed."""
    return np.asarray(jax.vmap(partial(closed_loop.run_key, seed))(jnp.asarray(ids)))


def chunk_ticks(ticks: int, state_bytes: int, runs: int, memory_bytes: int) -> int:
    """Ticks from one kept state to the next in reverse mode: 1 if all fit, else as many as make the least memory."""
    if ticks * state_bytes * runs <= memory_bytes:
        return 1
    return max(2, round(ticks**0.5))


def _scan(step: Callable[[Any], Any], start: Any, length: int, chunk: int) -> Any:
    """`step` applied `length` times; for the reverse mode one state in every `chunk` is kept, the rest worked out anew.

    Within a tick nothing is kept at all: working it out once more is cheaper than the traffic to memory.
    """
    if chunk == 0:
        return jax.lax.scan(lambda carry, _: (step(carry), None), start, None, length=length)[0]
    body = jax.checkpoint(step)

    def stretch(carry: Any, count: int) -> Any:
        return jax.lax.scan(lambda inner, _: (body(inner), None), carry, None, length=count)[0]

    if chunk == 1:
        return stretch(start, length)
    whole = jax.checkpoint(lambda carry: stretch(carry, chunk))
    carry = jax.lax.scan(lambda inner, _: (whole(inner), None), start, None, length=length // chunk)[0]
    return stretch(carry, length % chunk)
