"""Many runs through two compiled programs: one prepares a block of runs, one carries it through a stretch of time."""

import contextlib
import dataclasses
import functools
import itertools
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from rpojax.batching import vmap_last_axis
from rpojax.core import random_streams
from rpojax.dispersions import dispersed_values
from rpojax.dispersions.designs import Design, has_independent_runs
from rpojax.dispersions.dispersed_values import Values
from rpojax.errors import RpojaxError
from rpojax.flight.computer import Stages
from rpojax.runtime import compiler_options, device_programs, trace_cache
from rpojax.runtime.trace_cache import Trace
from rpojax.scenario import dispersion_keys, params, scenario_file
from rpojax.scenario.params import Params
from rpojax.scenario.scenario_file import Scenario
from rpojax.scenario.schema import ScenarioFile
from rpojax.simulation import closed_loop, single_precision, telemetry
from rpojax.simulation.closed_loop import State

SEGMENT_TICKS = 200
"""About so many ticks run on the device before the host looks at them."""


def default_block_size(file: ScenarioFile) -> int:
    """Runs per device and block for this kind of device and camera: on a CPU as many as its cache holds.

    A picture fills a CPU by itself, and a small block wastes little where few runs are asked for.
    """
    rendered = file.camera.model == "rendered"
    if jax.default_backend() == "cpu":
        return 10 if rendered else 256 if file.precision == "single" else 128
    return 256 if rendered else 4096


@dataclass(frozen=True)
class PreparedRuns:
    """Runs after preparation.

    Attributes:
        ids: (runs,) run numbers
        drawn: values drawn for every dispersed key, in the user's units
        used: values that the runs really hold, read back
        shares: for each device the nominal Params, the dispersed values and the states at the start
    """

    run_ids: np.ndarray
    drawn: dict[str, np.ndarray]
    used: dict[str, np.ndarray]
    device_inputs: list[tuple[Params, Values, State]]


@dataclass(frozen=True)
class Segment:
    """Channels of a stretch of time.

    Attributes:
        first_tick: number of its first tick
        shares: of each device, name -> (ticks, ..., runs of the device), as the loop lays them out
        failure: (runs,) failure code so far
        failed_at: (runs,) [s], infinite while all is well
    """

    first_tick: int
    device_channels: list[dict[str, np.ndarray]]
    failure: np.ndarray
    failed_at: np.ndarray

    @functools.cached_property
    def channels(self) -> dict[str, np.ndarray]:
        """Name -> (ticks, runs, ...), all devices together."""
        return {name: np.moveaxis(values, -1, 1) for name, values in _concatenated(self.device_channels).items()}


class BatchEngine:
    """A scenario compiled for blocks of a fixed size; one trace, however many blocks.

    Every device runs the same single-device program on `size` runs, so a run's numbers are the same to the last bit
    however many devices there are. (One program sharded over the devices is compiled differently for each number of
    them, and its last bits differ.) The cores of a CPU count as devices, and run one program in threads.
    """

    def __init__(
        self,
        file: ScenarioFile,
        runs_per_device: int | None = None,
        devices: Sequence[Any] | None = None,
        stages: Stages | None = None,
        design: Design | None = None,
    ) -> None:
        if design is None and not has_independent_runs(file):
            raise RpojaxError(f"design: found none, expected that of the campaign for {file.design.kind!r}")
        self.design = design
        self.file = file
        self.scenario = scenario_file.static_settings(file, allow_single=True)
        self.is_single_precision = file.precision == "single"
        self.runs_per_device = runs_per_device or default_block_size(file)
        self.devices = list(devices if devices is not None else jax.devices())
        self.stages = stages or Stages()
        self.dispersed_keys = dispersion_keys.varied_keys(file)
        self.compile_s = self.loop_compile_s = 0.0
        count = -(-self.scenario.ticks // SEGMENT_TICKS)
        self.segment_ticks = -(-self.scenario.ticks // count)
        self.segment_count = count
        # What is compiled knows of one segment alone: missions whose segments are as long share it.
        self._segment_file = file.model_copy(update={"duration_s": self.segment_ticks * self.scenario.tick_s})
        self._segment_scenario = dataclasses.replace(self.scenario, ticks=self.segment_ticks)
        nominal = params.build_params(file.model_dump(), self.scenario.width_px, self.scenario.height_px)
        self._nominal = jax.tree.map(np.asarray, nominal)
        self._programs: tuple[Any, list[Any]] | None = None

    @property
    def capacity(self) -> int:
        """Runs that all devices take at once."""
        return self.runs_per_device * len(self.devices)

    def compile(self) -> None:
        """Compiles both programs, once.

        `compile_s` then tells the time it took [s], tracing included, `loop_compile_s` what of it XLA took for the loop
        once that was traced.
        """
        if self._programs is not None:
            return
        begin = time.perf_counter()
        with ThreadPoolExecutor(len(self.devices) + 1) as pool:
            # The preparation is compiled while the loop, which needs its shapes, is traced.
            arguments = self._loop_arguments()
            preparing = pool.submit(lambda: self._compiled_preparation)
            loop = self._loop_trace
            with self._precision():
                wanted = device_programs.lower_for_devices(loop, arguments, self.devices, donate=(2,))
            traced = time.perf_counter()
            compiled = pool.map(
                lambda each: compiler_options.compile_with_options(each, compiler_options.LOOP_OPTIONS), wanted.values()
            )
            loops = dict(zip(wanted, compiled, strict=True))
            self.loop_compile_s = time.perf_counter() - traced
            self._programs = (
                preparing.result(),
                [loops[home] for home in device_programs.compilation_devices(self.devices)],
            )
        self.compile_s = time.perf_counter() - begin

    @functools.cached_property
    def _compiled_preparation(self) -> Any:
        return compiler_options.compile_with_options(
            jax.jit(self._preparation_trace.call).lower(*self._example_inputs()), compiler_options.PREPARATION_OPTIONS
        )

    @functools.cached_property
    def _preparation_trace(self) -> Trace:
        return trace_cache.load_or_trace(
            self._prepare, self._example_inputs(), f"prepare {scenario_file.digest(self._segment_file)}"
        )

    @functools.cached_property
    def _loop_trace(self) -> Trace:
        # What is kept is for the kind of device that JAX takes by default, and for the packaged stages.
        usual = self.stages == Stages() and all(each.platform == jax.default_backend() for each in self.devices)
        meaning = f"advance {self._segment_scenario!r}" if usual else None
        arguments = self._loop_arguments()
        with self._precision():
            return trace_cache.load_or_trace(self._advance, arguments, meaning)

    def _precision(self) -> contextlib.AbstractContextManager[None]:
        return single_precision.tracing_in_single() if self.is_single_precision else contextlib.nullcontext()

    def _loop_arguments(self) -> tuple[Any, Any, Any]:
        """Numbers of the nominal run, and shapes of what the preparation hands to the loop."""
        drawn, _, state = self._preparation_trace.outputs
        if not self.is_single_precision:
            return self._nominal, drawn, state
        return (
            single_precision.round_to_single(self._nominal),
            jax.eval_shape(single_precision.round_to_single, drawn),
            state,
        )

    def _example_inputs(self) -> tuple[Params, Array, np.ndarray, dict[str, np.ndarray]]:
        """Arguments of the preparation, of which only the shapes count."""
        return self._preparation_inputs(0, np.zeros(self.runs_per_device, dtype=np.int64))

    def _preparation_inputs(
        self, seed: int, ids: np.ndarray
    ) -> tuple[Params, Array, np.ndarray, dict[str, np.ndarray]]:
        given = self.design.for_runs(ids) if self.design else {}
        return self._nominal, _master_key(seed), ids.astype(np.int32), given

    def draw_values(self, seed: int, run_ids: np.ndarray) -> dict[str, np.ndarray]:
        """Values drawn for `size` runs: those of `prepare`, from the same program, without compiling the loop."""
        drawn, _, _ = self._compiled_preparation(*self._preparation_inputs(seed, run_ids))
        return {name: np.asarray(values) for name, values in drawn.items()}

    def channel_names(self) -> list[str]:
        """Names of the channels that the engine gives, without compiling anything."""
        return sorted(self._loop_trace.outputs[1])

    def prepare(self, seed: int, run_ids: np.ndarray) -> PreparedRuns:
        """Dispersed values and initial states of `capacity` runs."""
        self.compile()
        assert self._programs is not None
        parts = [
            self._programs[0](*self._preparation_inputs(seed, share)) for share in np.split(run_ids, len(self.devices))
        ]
        placed = [
            jax.device_put((*self._loop_inputs(drawn), state), device)
            for (drawn, _, state), device in zip(parts, device_programs.compilation_devices(self.devices), strict=True)
        ]
        return PreparedRuns(
            run_ids=run_ids,
            drawn=_concatenated([drawn for drawn, _, _ in parts], axis=0),
            used=_concatenated([used for _, used, _ in parts], axis=0),
            device_inputs=[(nominal, values, state) for nominal, values, state in placed],
        )

    def _loop_inputs(self, drawn: Values) -> tuple[Params, Values]:
        """Nominal and dispersed numbers as the loop takes them."""
        numbers = (self._nominal, drawn)
        return single_precision.round_to_single(numbers) if self.is_single_precision else numbers

    def simulate(self, prepared: PreparedRuns) -> Iterator[Segment]:
        """Carries a block to the end of the scenario, segment by segment; the last one is cut at the end.

        The devices work on the next segments while the caller looks at this one. A block can be flown once: its states
        are given up to the loop.
        """
        assert self._programs is not None
        flights = [
            _DeviceBatch(program, *share)
            for program, share in zip(self._programs[1], prepared.device_inputs, strict=True)
        ]
        stretches = device_programs.call_in_threads([each.advance for each in flights], self.segment_count)
        with contextlib.closing(stretches):
            # Nothing here holds a device's records while the caller looks at what was made of them.
            yield from map(self._segment, itertools.count(), stretches)

    def _segment(self, number: int, parts: Sequence["_DeviceSegment"]) -> Segment:
        first = number * self.segment_ticks
        keep = min(self.segment_ticks, self.scenario.ticks - first)
        return Segment(
            first_tick=first,
            device_channels=[
                {name: np.asarray(value)[:keep] for name, value in part.channels.items()} for part in parts
            ],
            failure=np.concatenate([part.failure for part in parts]),
            failed_at=np.concatenate([part.failed_at for part in parts]),
        )

    def _prepare(self, nominal: Params, key: Array, ids: Array, given: Values) -> tuple[Values, Values, State]:
        def one(run_id: Array, given: Values) -> tuple[Values, Values, State]:
            run_key = random_streams.fold_in(key, run_id)
            drawn = dispersed_values.draw(self._segment_file, run_key, given)
            dispersed = dispersed_values.apply_to_params(nominal, drawn)
            used = dispersed_values.read_back(dispersed, self.dispersed_keys)
            state = closed_loop.init(self._segment_scenario, dispersed, run_key)
            return drawn, used, single_precision.round_state_to_single(state) if self.is_single_precision else state

        return jax.vmap(one, out_axes=(0, 0, state_axes(-1)))(ids, given)

    def _advance(self, nominal: Params, values: Values, state: State) -> tuple[State, telemetry.Channels]:
        def one(values: Values, state: State) -> tuple[State, telemetry.Channels]:
            dispersed = dispersed_values.apply_to_params(nominal, values)
            after, seen = closed_loop.tick(self.stages, self._segment_scenario, dispersed, state)
            return after, telemetry.compute_channels(self._segment_scenario, dispersed, seen)

        axes = state_axes(-1)
        every = batch_transform(self._segment_scenario)(one, in_axes=(-1, axes), out_axes=(axes, -1))
        own = {name: jnp.moveaxis(value, 0, -1) for name, value in values.items()}
        after, seen = jax.lax.scan(lambda carry, _: every(own, carry), state, None, length=self.segment_ticks)
        return after, seen


@dataclass(frozen=True)
class _DeviceSegment:
    """What a device made of a stretch of time, and how its runs fared."""

    channels: telemetry.Channels
    failure: np.ndarray
    failed_at: np.ndarray


@dataclass
class _DeviceBatch:
    """A device's share of a block under way."""

    program: Any
    nominal: Params
    values: Values
    state: State

    def advance(self) -> _DeviceSegment:
        """Carries the runs through one more segment."""
        self.state, seen = jax.block_until_ready(self.program(self.nominal, self.values, self.state))
        # Copies: what they are made of is given up to the next segment.
        return _DeviceSegment(seen, np.array(self.state.failure), np.array(self.state.failed_at))


def _master_key(seed: int) -> Array:
    return jnp.asarray(random_streams.master_key(seed))


def _concatenated(parts: Sequence[Mapping[str, Array | np.ndarray]], axis: int = -1) -> dict[str, np.ndarray]:
    """The devices' shares of each array, one after the other along the axis of the runs."""
    return {name: np.concatenate([np.asarray(part[name]) for part in parts], axis=axis) for name in parts[0]}


def batch_transform(scenario: Scenario) -> Callable[..., Callable[..., Any]]:
    """What makes many runs' tick of one run's: `jax.vmap`, or its like that keeps runs in the last axis."""
    # Pictures are made by convolutions and lookups, which JAX batches best itself.
    return jax.vmap if scenario.camera_model == "rendered" else vmap_last_axis.vmap


def state_axes(axis: int) -> State:
    """Batch axis of each field of State: `axis`, but none for the tick, which all runs have in common.

    That makes the burn decision a true branch, taken on one tick in two hundred.
    """
    axes: dict[str, Any] = {field.name: axis for field in dataclasses.fields(State)}
    return State(**{**axes, "tick": None})
