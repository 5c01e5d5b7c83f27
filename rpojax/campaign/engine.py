"""Many runs through two compiled programs: one prepares a block of runs, one carries it through a stretch of time."""

import dataclasses
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.sharding import Mesh, NamedSharding
from jax.sharding import PartitionSpec as P
from jaxtyping import Array

from rpojax.campaign import dispersions
from rpojax.campaign.dispersions import Values
from rpojax.core.pytree import replace
from rpojax.flight.computer import Stages
from rpojax.simulation import closed_loop, params, scenario, telemetry
from rpojax.simulation.closed_loop import State
from rpojax.simulation.params import Params
from rpojax.simulation.schema import ScenarioFile

SEGMENT_TICKS = 200
"""About so many ticks run on the device before the host looks at them."""


def block_size() -> int:
    """Runs per device and block for this kind of device: on a CPU as many as its cache holds."""
    return 256 if jax.default_backend() == "cpu" else 4096


@dataclass(frozen=True)
class Block:
    """Runs after preparation.

    Attributes:
        ids: (runs,) run numbers
        drawn: values drawn for every dispersed key, in the user's units
        used: values that the runs really hold, read back
        values: what goes into Params, on the device
        state: state at the start
    """

    ids: np.ndarray
    drawn: dict[str, np.ndarray]
    used: dict[str, np.ndarray]
    values: Values
    state: State


@dataclass(frozen=True)
class Segment:
    """Channels of a stretch of time.

    Attributes:
        first_tick: number of its first tick
        channels: name -> (ticks, runs, ...)
        failure: (runs,) failure code so far
        failed_at: (runs,) [s], infinite while all is well
    """

    first_tick: int
    channels: dict[str, np.ndarray]
    failure: np.ndarray
    failed_at: np.ndarray


class Engine:
    """A scenario compiled for blocks of a fixed size; one trace, however many blocks.

    A device always works on `size` runs, whatever the number of devices, so a run's numbers do not depend on it.
    """

    def __init__(
        self,
        file: ScenarioFile,
        size: int | None = None,
        devices: Sequence[Any] | None = None,
        stages: Stages | None = None,
    ) -> None:
        self.file = file
        self.scenario = scenario.static(file)
        self.size = size or block_size()
        self.devices = list(devices if devices is not None else jax.devices())
        self.stages = stages or Stages()
        self.keys = [dispersion.key for dispersion in file.dispersions]
        self.compile_s = 0.0
        count = -(-self.scenario.ticks // SEGMENT_TICKS)
        self.segment_ticks = -(-self.scenario.ticks // count)
        self.segments = count
        self._nominal = params.build(file.model_dump(), self.scenario.width_px, self.scenario.height_px)
        self._mesh = Mesh(np.array(self.devices), ("runs",))
        self._programs: tuple[Any, Any] | None = None

    @property
    def capacity(self) -> int:
        """Runs that all devices take at once."""
        return self.size * len(self.devices)

    def compile(self, seed: int) -> None:
        """Compiles both programs, once; `compile_s` then tells how long it took [s]."""
        if self._programs is not None:
            return
        begin = time.perf_counter()
        ids = self._on_devices(np.zeros(self.capacity, dtype=np.int32))
        key = jnp.asarray(closed_loop.random.master_key(seed))
        prepare = jax.jit(self._sharded_prepare()).lower(self._nominal, key, ids).compile()
        drawn, _, state = jax.eval_shape(self._sharded_prepare(), self._nominal, key, ids)
        advance = jax.jit(self._sharded_advance(), donate_argnums=(2,))
        shapes = jax.tree.map(self._shape, (drawn, state), self._specs(drawn, state))
        self._programs = (prepare, advance.lower(self._nominal, *shapes).compile())
        self.compile_s = time.perf_counter() - begin

    def prepare(self, seed: int, ids: np.ndarray) -> Block:
        """Dispersed values and initial states of `capacity` runs."""
        self.compile(seed)
        assert self._programs is not None
        key = jnp.asarray(closed_loop.random.master_key(seed))
        drawn, used, state = self._programs[0](self._nominal, key, self._on_devices(ids.astype(np.int32)))
        host = partial(jax.tree.map, np.asarray)
        return Block(ids=ids, drawn=host(drawn), used=host(used), values=drawn, state=state)

    def run(self, block: Block) -> Iterator[Segment]:
        """Carries a block to the end of the scenario, segment by segment; the last one is cut at the end."""
        assert self._programs is not None
        state = block.state
        for number in range(self.segments):
            state, channels = self._programs[1](self._nominal, block.values, state)
            first = number * self.segment_ticks
            keep = min(self.segment_ticks, self.scenario.ticks - first)
            yield Segment(
                first_tick=first,
                channels={name: np.asarray(value)[:keep] for name, value in channels.items()},
                failure=np.asarray(state.failure),
                failed_at=np.asarray(state.failed_at),
            )

    def _prepare(self, nominal: Params, key: Array, ids: Array) -> tuple[Values, Values, State]:
        def one(run_id: Array) -> tuple[Values, Values, State]:
            run_key = closed_loop.random.fold_in(key, run_id)
            drawn = dispersions.draw(self.file, run_key)
            dispersed = dispersions.apply(nominal, drawn)
            used = dispersions.read_back(dispersed, self.keys)
            return drawn, used, closed_loop.init(self.scenario, dispersed, run_key)

        return jax.vmap(one, out_axes=(0, 0, _run_axes()))(ids)

    def _advance(self, nominal: Params, values: Values, state: State) -> tuple[State, telemetry.Channels]:
        axes = _run_axes()

        def one(values: Values, state: State) -> tuple[State, telemetry.Channels]:
            dispersed = dispersions.apply(nominal, values)
            after, seen = closed_loop.tick(self.stages, self.scenario, dispersed, state)
            return after, telemetry.observe(self.scenario, dispersed, seen)

        every = jax.vmap(one, in_axes=(0, axes), out_axes=(axes, 0))
        return jax.lax.scan(lambda carry, _: every(values, carry), state, None, length=self.segment_ticks)

    def _sharded_prepare(self) -> Any:
        out = (P("runs"), P("runs"), _run_axes(P("runs"), P()))
        return jax.shard_map(
            self._prepare, mesh=self._mesh, in_specs=(P(), P(), P("runs")), out_specs=out, check_vma=False
        )

    def _sharded_advance(self) -> Any:
        state = _run_axes(P("runs"), P())
        return jax.shard_map(
            self._advance,
            mesh=self._mesh,
            in_specs=(P(), P("runs"), state),
            out_specs=(state, P(None, "runs")),
            check_vma=False,
        )

    def _specs(self, drawn: Any, state: Any) -> Any:
        runs = jax.tree.map(lambda _: P("runs"), (drawn, state))
        return runs[0], replace(runs[1], tick=P())

    def _shape(self, leaf: jax.ShapeDtypeStruct, spec: P) -> jax.ShapeDtypeStruct:
        return jax.ShapeDtypeStruct(leaf.shape, leaf.dtype, sharding=NamedSharding(self._mesh, spec))

    def _on_devices(self, ids: np.ndarray) -> Array:
        return jax.device_put(ids, NamedSharding(self._mesh, P("runs")))


def _run_axes(runs: Any = 0, shared: Any = None) -> State:
    """One entry per field of State: `runs` where runs differ, `shared` for the tick, which all runs have in common.

    That the tick is shared makes the burn decision a true branch, taken on one tick in two hundred.
    """
    names = [field.name for field in dataclasses.fields(State)]
    return State(**{name: shared if name == "tick" else runs for name in names})
