"""Runs of the closed loop as a function of a few numbers: figures of merit, and their derivatives in both modes.

What the numbers mean is the caller's: gains to be tuned, or the coordinates from which dispersions are made. Runs are
independent, so a derivative is one per run, and those of runs that were lost can be told apart.
"""

import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from typing import Any, Literal

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from rpojax.campaign import dispersions, single
from rpojax.campaign.dispersions import Values
from rpojax.campaign.engine import run_axes
from rpojax.core import random
from rpojax.flight.computer import Stages
from rpojax.simulation import closed_loop, running_metrics
from rpojax.simulation.closed_loop import State
from rpojax.simulation.params import Params
from rpojax.simulation.running_metrics import Sums
from rpojax.simulation.schema import ScenarioFile

Inputs = Callable[[Array, Array], Values]
"""Values in the user's units by scenario key, from the numbers (k,) and the random key of a run."""
Program = Literal["values", "forward", "reverse"]

BATCH = 64
"""Runs at a time on each device: more are no faster."""
MEMORY_BYTES = 2_000_000_000
"""What the states kept for the reverse mode may take on each device before they are worked out twice instead [B]."""
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
    """

    figures: np.ndarray
    jacobian: np.ndarray | None
    gradient: np.ndarray | None
    failed: np.ndarray


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
        memory_bytes: int = MEMORY_BYTES,
    ) -> None:
        self.file, self.names, self.count = file, tuple(names), count
        self.scenario, self._nominal = single.nominal(file)
        self._inputs, self._stages = inputs, stages or Stages()
        self._devices = jax.devices()[:runs]
        self.size = min(BATCH, -(-runs // len(self._devices)))
        self.chunk_ticks = chunk_ticks(self.scenario.ticks, self._state_bytes(), self.size, memory_bytes)
        self._programs: dict[Program, list[Any]] = {}
        self._backward: list[Any] = []
        self.compile_s = 0.0
        self.memory_bytes = 0

    @property
    def capacity(self) -> int:
        """Runs that all devices take at once."""
        return self.size * len(self._devices)

    def values(self, numbers: np.ndarray, keys: np.ndarray) -> Found:
        """Figures alone, for numbers (runs, k) and random keys (runs, 2) of runs."""
        return self._fly("values", numbers, keys)

    def forward(self, numbers: np.ndarray, keys: np.ndarray) -> Found:
        """Figures and their Jacobian in forward mode: takes about 0.75 of a flight for each number."""
        return self._fly("forward", numbers, keys)

    def reverse(self, numbers: np.ndarray, keys: np.ndarray, weigh: Callable[[np.ndarray], np.ndarray]) -> Found:
        """Figures, and the gradient of their weighted sum in reverse mode: about seven flights.

        `weigh` gives the weights (runs, figures) from the figures of all runs, as the gradient of any function of them
        does. More runs than the devices take at once are flown once more beforehand.
        """
        if len(numbers) <= self.capacity:
            return self._reverse_batch(numbers, keys, weigh)
        weights = weigh(self.values(numbers, keys).figures)
        return _joined(
            [
                self._reverse_batch(numbers[rows], keys[rows], lambda _, rows=rows: weights[rows])
                for rows in self._batches(len(numbers))
            ]
        )

    def _batches(self, runs: int) -> list[slice]:
        return [slice(first, min(first + self.capacity, runs)) for first in range(0, runs, self.capacity)]

    def _fly(self, kind: Program, numbers: np.ndarray, keys: np.ndarray) -> Found:
        """Runs in batches, each spread over all devices; the last one is filled up with its last run."""
        programs = self._compiled(kind)
        found = []
        for rows in self._batches(len(numbers)):
            results = self._start(programs, numbers[rows], keys[rows])
            figures, failed, *jacobian = _gathered(results, rows.stop - rows.start)
            found.append(Found(figures, jacobian[0] if jacobian else None, None, failed))
        return _joined(found)

    def _start(self, programs: list[Any], numbers: np.ndarray, keys: np.ndarray) -> list[Any]:
        """Results of one batch, under way on all devices at the same time; calls return at once."""
        shares = np.split(np.minimum(np.arange(self.capacity), len(numbers) - 1), len(programs))
        return [
            program(*jax.device_put((self._nominal, numbers[share], keys[share]), device))
            for program, share, device in zip(programs, shares, self._devices, strict=True)
        ]

    def _reverse_batch(self, numbers: np.ndarray, keys: np.ndarray, weigh: Callable[[np.ndarray], np.ndarray]) -> Found:
        runs = len(numbers)
        results = self._start(self._compiled("reverse"), numbers, keys)
        figures, failed = _gathered([result[:2] for result in results], runs)
        weights = np.zeros((self.capacity, len(self.names)))
        weights[:runs] = weigh(figures)
        back = [
            pull_back(result[2], jax.device_put(share, device))
            for pull_back, result, share, device in zip(
                self._pull_backs(results), results, np.split(weights, len(results)), self._devices, strict=True
            )
        ]
        return Found(figures, None, _gathered([(part,) for part in back], runs)[0], failed)

    def _pull_backs(self, results: list[Any]) -> list[Any]:
        """Programs that carry weights of figures back through the flights of `results`."""
        if not self._backward:
            begin = time.perf_counter()
            weights = np.zeros((self.size, len(self.names)))
            lowered = [
                jax.jit(lambda back, weights: back(weights)[0]).lower(result[2], jax.device_put(weights, device))
                for result, device in zip(results, self._devices, strict=True)
            ]
            self._backward = self._finish_compiling(lowered, begin)
        return self._backward

    def _compiled(self, kind: Program) -> list[Any]:
        if kind not in self._programs:
            begin = time.perf_counter()
            function = {"values": self._figures, "forward": self._jacobian, "reverse": self._linearised}[kind]
            arguments = self._nominal, np.zeros((self.size, self.count)), np.zeros((self.size, 2), dtype=np.uint32)
            lowered = [jax.jit(function).lower(*jax.device_put(arguments, device)) for device in self._devices]
            self._programs[kind] = self._finish_compiling(lowered, begin)
        return self._programs[kind]

    def _finish_compiling(self, lowered: list[Any], begin: float) -> list[Any]:
        """Programs for all devices, with account of the time since `begin` and of their memory."""
        with ThreadPoolExecutor(len(lowered)) as pool:
            programs = list(pool.map(lambda program: program.compile(), lowered))
        self.compile_s += time.perf_counter() - begin
        sizes = [program.memory_analysis() for program in programs]
        needed = sum(size.temp_size_in_bytes + size.output_size_in_bytes for size in sizes)
        self.memory_bytes = max(self.memory_bytes, needed)
        return programs

    def _figures(self, nominal: Params, numbers: Array, keys: Array, chunk: int = 0) -> tuple[Array, Array]:
        """Figures (runs, figures) and which runs failed; `chunk` 0 keeps nothing for a reverse mode."""
        axes = run_axes()
        values = jax.vmap(self._inputs)(numbers, keys)

        def begin(values: Values, key: Array) -> State:
            return closed_loop.init(self.scenario, dispersions.apply(nominal, values), key)

        def one(values: Values, state: State, sums: Sums) -> tuple[State, Sums]:
            params = dispersions.apply(nominal, values)
            after, seen = closed_loop.tick(self._stages, self.scenario, params, state)
            return after, running_metrics.add(self.names, self.scenario, params, seen, sums)

        every = jax.vmap(one, in_axes=(0, axes, 0), out_axes=(axes, 0))
        state = jax.vmap(begin, out_axes=axes)(values, keys)
        sums = jax.vmap(lambda _: running_metrics.start(self.names))(keys)
        state, sums = _scan(lambda carry: every(values, *carry), (state, sums), self.scenario.ticks, chunk)
        return jax.vmap(partial(running_metrics.finish, self.names))(sums), state.failure > 0

    def _jacobian(self, nominal: Params, numbers: Array, keys: Array) -> tuple[Array, Array, Array]:
        def along(direction: Array) -> tuple[Array, Array, Array]:
            tangent = jnp.broadcast_to(direction, numbers.shape)
            figures, change, failed = jax.jvp(
                lambda x: self._figures(nominal, x, keys), (numbers,), (tangent,), has_aux=True
            )
            return figures, failed, change

        directions = jnp.eye(self.count, dtype=numbers.dtype)
        return jax.vmap(along, out_axes=(None, None, 2))(directions)

    def _linearised(self, nominal: Params, numbers: Array, keys: Array) -> tuple[Array, Array, Any]:
        figures, pull_back, failed = jax.vjp(
            lambda x: self._figures(nominal, x, keys, chunk=self.chunk_ticks), numbers, has_aux=True
        )
        return figures, failed, pull_back

    def _state_bytes(self) -> int:
        """Size of what a run carries from tick to tick [B]."""
        key = jax.ShapeDtypeStruct((2,), np.uint32)
        state = jax.eval_shape(lambda key: closed_loop.init(self.scenario, self._nominal, key), key)
        sums = jax.eval_shape(lambda: running_metrics.start(self.names))
        return sum(leaf.size * leaf.dtype.itemsize for leaf in jax.tree.leaves((state, sums)))


def _gathered(results: Sequence[Sequence[Array]], runs: int) -> list[np.ndarray]:
    """Each array of the devices' results, one device after the other, without the runs that fill up."""
    return [np.concatenate([np.asarray(part) for part in parts])[:runs] for parts in zip(*results, strict=True)]


def _joined(found: Sequence[Found]) -> Found:
    def all_of(parts: Sequence[np.ndarray | None]) -> np.ndarray | None:
        there = [part for part in parts if part is not None]
        return np.concatenate(there) if there else None

    return Found(
        figures=np.concatenate([one.figures for one in found]),
        jacobian=all_of([one.jacobian for one in found]),
        gradient=all_of([one.gradient for one in found]),
        failed=np.concatenate([one.failed for one in found]),
    )


def run_keys(seed: int, ids: np.ndarray) -> np.ndarray:
    """Random keys (runs, 2) of the runs of a campaign with a given seed."""
    return np.asarray(jax.vmap(lambda run_id: random.fold_in(random.master_key(seed), run_id))(jnp.asarray(ids)))


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
