"""Compiled programs of a linearised loop: nominal run of one burn period, its Jacobians, and burn decisions."""

import time
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from rpojax.analysis.linear_covariance.linearisation.linearised_loop import LinearisationPoint, LinearisedLoop
from rpojax.analysis.linear_covariance.linearisation.target_outline_ensemble import TargetEnsemble
from rpojax.core.pytree import concatenate
from rpojax.runtime import compiler_options
from rpojax.runtime.device_mesh import DeviceMesh, padded_batches
from rpojax.simulation.state import State

_TICKS_PER_DEVICE = 10
"""Ticks whose Jacobians a device computes at once."""


class CompiledLoop:
    """A linearised loop, compiled for one burn period.

    Attributes:
        loop: the loop
        burns_for_commands: `LinearisedLoop.burns_for_commands`, compiled
        compile_s: compilation [s]
    """

    def __init__(self, loop: LinearisedLoop, state: State, ensemble: TargetEnsemble, samples: int) -> None:
        begin = time.perf_counter()
        self.loop = loop
        self._mesh = DeviceMesh(jax.devices())
        self._batch_size = _TICKS_PER_DEVICE * self._mesh.size
        box_allowed = jnp.ones(loop.scenario.formation_ticks, dtype=bool)
        _, _, points = jax.eval_shape(loop.simulate_nominal, state, ensemble, box_allowed)
        arguments = jax.tree.map(
            lambda leaf: jax.ShapeDtypeStruct(
                (self._batch_size, *leaf.shape[1:]), leaf.dtype, sharding=self._mesh.sharding
            ),
            (points.state, points.noise, points.relative_box),
        )
        lowered: list[Any] = [
            jax.jit(loop.simulate_nominal).lower(state, ensemble, box_allowed),
            jax.jit(self._mesh.by_rows(loop.jacobians)).lower(*arguments),
            jax.jit(loop.burns_for_commands).lower(
                jax.tree.map(lambda leaf: jax.ShapeDtypeStruct(leaf.shape[1:], leaf.dtype), points.memory),
                state.tick,
                jnp.zeros((samples, 3)),
            ),
        ]
        self._simulate, self._jacobians, self.burns_for_commands = compiler_options.compile_in_threads(lowered)
        self.compile_s = time.perf_counter() - begin

    def simulate_period(
        self, state: State, ensemble: TargetEnsemble, box_allowed: np.ndarray
    ) -> tuple[State, TargetEnsemble, LinearisationPoint]:
        """One burn period of the nominal run; `box_allowed` (ticks,) flags frames that may have a box."""
        return self._simulate(state, ensemble, jnp.asarray(box_allowed))

    def jacobians(self, points: LinearisationPoint, ticks: np.ndarray) -> np.ndarray:
        """Jacobians (ticks, size + 19, size + inputs) at some ticks of a period."""
        leaves = jax.tree.map(np.asarray, (points.state, points.noise, points.relative_box))
        parts = []
        for rows, _ in padded_batches(len(ticks), self._batch_size):
            batch = jax.tree.map(lambda leaf, rows=rows: leaf[ticks[rows]], leaves)
            parts.append(self._jacobians(*self._mesh.place(batch)))
        return concatenate(parts)[: len(ticks)]
