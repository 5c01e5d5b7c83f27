"""Compiled programs of a linearised loop: nominal run of one burn period, its Jacobians, and burn decisions."""

import time
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from rpojax.analysis.linear_covariance.linearisation.linearised_loop import LinearisationPoint, LinearisedLoop
from rpojax.analysis.linear_covariance.linearisation.target_outline_ensemble import TargetEnsemble
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
        count = jax.device_count()
        self._batch_size = _TICKS_PER_DEVICE * count
        mesh = jax.make_mesh((count,), ("ticks",))
        by_tick = jax.sharding.PartitionSpec("ticks")
        jacobians = jax.shard_map(
            loop.jacobians, mesh=mesh, in_specs=(by_tick, by_tick, by_tick), out_specs=by_tick, check_vma=False
        )
        self._sharding = jax.sharding.NamedSharding(mesh, by_tick)
        box_allowed = jnp.ones(loop.scenario.formation_ticks, dtype=bool)
        _, _, points = jax.eval_shape(loop.simulate_nominal, state, ensemble, box_allowed)
        arguments = jax.tree.map(
            lambda leaf: jax.ShapeDtypeStruct((self._batch_size, *leaf.shape[1:]), leaf.dtype, sharding=self._sharding),
            (points.state, points.noise, points.relative_box),
        )
        lowered: list[Any] = [
            jax.jit(loop.simulate_nominal).lower(state, ensemble, box_allowed),
            jax.jit(jacobians).lower(*arguments),
            jax.jit(loop.burns_for_commands).lower(
                jax.tree.map(lambda leaf: jax.ShapeDtypeStruct(leaf.shape[1:], leaf.dtype), points.memory),
                state.tick,
                jnp.zeros((samples, 3)),
            ),
        ]
        with ThreadPoolExecutor(len(lowered)) as pool:
            self._simulate, self._jacobians, self.burns_for_commands = pool.map(lambda each: each.compile(), lowered)
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
        for first in range(0, len(ticks), self._batch_size):
            # The last batch is padded with the last tick.
            rows = ticks[np.minimum(first + np.arange(self._batch_size), len(ticks) - 1)]
            batch = jax.tree.map(lambda leaf, rows=rows: leaf[rows], leaves)
            parts.append(self._jacobians(*jax.device_put(batch, self._sharding)))
        return np.concatenate([np.asarray(part) for part in parts])[: len(ticks)]
