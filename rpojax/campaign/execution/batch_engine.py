"""Batched simulation of runs by two compiled programs: one prepares runs, one advances them by a segment of time."""

import contextlib
import dataclasses
import functools
import itertools
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.stages import Traced
from jaxtyping import Array

from rpojax.batching.batching_mode import BatchingMode
from rpojax.campaign.execution import run_programs, team_passive_safety, teams
from rpojax.campaign.execution.passive_safety import PassiveSafety
from rpojax.campaign.execution.run_programs import batch_transform, tick_batching_mode
from rpojax.campaign.execution.surface_coverage import SurfaceCoverage
from rpojax.campaign.experiment_design import Design, has_independent_runs
from rpojax.core import random_streams
from rpojax.core.numerics.counted_scan import scan_to_count
from rpojax.core.pytree import concatenate
from rpojax.errors import RpojaxError
from rpojax.flight.stages import Stages
from rpojax.runtime import compiler_options, garbage_collection, programs_per_device
from rpojax.runtime.programs_per_device import DevicePrograms, DeviceTraces
from rpojax.runtime.thread_pools import thread_pool
from rpojax.scenario.dispersed_numbers import dispersion_keys
from rpojax.scenario.dispersed_numbers.dispersed_values import Values
from rpojax.scenario.params import Params
from rpojax.scenario.plugins import plugin_registry
from rpojax.scenario.schema import ScenarioFile
from rpojax.scenario.static_settings import static_settings
from rpojax.scenario.team import members
from rpojax.simulation import single_precision
from rpojax.simulation.channels import Channels

SEGMENT_TICKS = 200
"""Length of a segment: ticks that run on the device before the host gets their channels; the last may have fewer."""

_VECTOR_RUNS = 16
"""Numbers of single precision in the widest vector of a CPU."""


def default_block_size(file: ScenarioFile) -> int:
    """Runs per device and block for this kind of device and camera: on a CPU as many as its cache holds.

    A rendered image occupies a CPU core by itself, and a small block wastes little when few runs are wanted. Else
    blocks of a team are rounded up to whole vectors of the CPU: the rest of a vector costs as much as a whole one.
    """
    rendered = file.camera.model == "rendered"
    if jax.default_backend() == "cpu":
        runs = 10 if rendered else 256 if file.precision == "single" else 128
    else:
        runs = 256 if rendered else 4096
    servicers = max(1, len(file.servicers))
    return max(1, runs // servicers) if rendered else -(-runs // (servicers * _VECTOR_RUNS)) * _VECTOR_RUNS


def fitted_block_size(file: ScenarioFile, runs: int, devices: int) -> int:
    """Runs per device and block of a campaign of `runs` runs: on a CPU, those that keep all devices busy to its end.

    The size is the default one or a part of it, so that campaigns share few programs. A pass of all devices through the
    loop takes about as long as its runs and the widest vector of the CPU together; the last, incomplete pass takes as
    long as any other.
    """
    largest = default_block_size(file)
    if jax.default_backend() != "cpu":
        return largest
    unit = 1 if file.camera.model == "rendered" else _VECTOR_RUNS
    parts = sorted({-(-largest // (part * unit)) * unit for part in (1, 2, 4, 8)}, reverse=True)
    return min(parts, key=lambda size: -(-runs // (size * devices)) * (size + unit))


@dataclass(frozen=True)
class RedrawnNoise:
    """Random keys of streams in segments of time, where they are not those of the run.

    Attributes:
        keys: (segments, streams, 2, runs)
        chosen: (segments, streams, runs) bool, where they replace the run's own
    """

    keys: np.ndarray
    chosen: np.ndarray

    def split(self, parts: int) -> "list[RedrawnNoise]":
        """Those of equal parts of the runs."""
        pairs = zip(np.split(self.keys, parts, axis=-1), np.split(self.chosen, parts, axis=-1), strict=True)
        return [RedrawnNoise(keys, chosen) for keys, chosen in pairs]

    def keys_in_segment(self, number: int, own: np.ndarray) -> np.ndarray:
        """Keys (streams, 2, runs) in a segment, from the runs' own keys."""
        return np.where(self.chosen[number][:, None], self.keys[number], own)


@dataclass(frozen=True)
class PreparedRuns:
    """Dispersed runs at their initial states, on the devices.

    Attributes:
        run_ids: (runs,) run numbers
        drawn: values drawn for every dispersed key, in the user's units
        used: values read back from the runs' Params, in the user's units
        device_inputs: for each device the nominal Params, the dispersed values and the initial states
    """

    run_ids: np.ndarray
    drawn: dict[str, np.ndarray]
    used: dict[str, np.ndarray]
    device_inputs: list[tuple[Params, Values, Any]]


@dataclass(frozen=True)
class Segment:
    """Channels of all runs over one segment of time.

    Attributes:
        first_tick: number of its first tick
        device_channels: for each device, name -> (ticks, ..., runs of the device), in the layout of the loop
        failure: (runs,) failure code at the end of the segment; (servicers, runs) of a team
        failed_at: of the same shape [s], infinite where nothing has failed
    """

    first_tick: int
    device_channels: list[dict[str, np.ndarray]]
    failure: np.ndarray
    failed_at: np.ndarray

    @functools.cached_property
    def channels(self) -> dict[str, np.ndarray]:
        """Name -> (ticks, runs, ...), all devices together."""
        channels = concatenate(self.device_channels, axis=-1)
        return {name: np.moveaxis(values, -1, 1) for name, values in channels.items()}


class BatchEngine:
    """A scenario compiled for batches of a fixed size, with one trace for any number of batches.

    Every device runs the same single-device program on `runs_per_device` runs, so the results of a run are the same to
    the last bit for any number of devices. (One program sharded over the devices is compiled differently for each
    number of them, and its last bits differ.) The cores of a CPU count as devices, and run one program in threads.

    Args:
        file: the scenario
        runs_per_device: batch size of a device, by default `default_block_size`
        devices: all of the process by default
        stages: stages of the flight software
        design: values assigned to the runs; needed unless they are independent draws
        batching: how a tick is batched over the runs, by default as the environment says

    Raises:
        RpojaxError: the runs depend on a design, and there is none.
    """

    def __init__(
        self,
        file: ScenarioFile,
        runs_per_device: int | None = None,
        devices: Sequence[Any] | None = None,
        stages: Stages | None = None,
        design: Design | None = None,
        batching: BatchingMode | None = None,
    ) -> None:
        if design is None and not has_independent_runs(file):
            raise RpojaxError(f"design: found none, expected that of the campaign for {file.design.kind!r}")
        self.design = design
        self.file = file
        self.scenario = static_settings(file, allow_single=True, allow_team=True)
        self.batching: BatchingMode = tick_batching_mode(self.scenario, batching)
        self.is_single_precision = file.precision == "single"
        self.runs_per_device = runs_per_device or default_block_size(file)
        self.devices = programs_per_device.choose_devices(devices)
        self.stages = plugin_registry.stages_of(file, stages)
        self.dispersed_keys = dispersion_keys.varied_keys(file)
        self.compile_s = self.loop_compile_s = 0.0
        self.segment_count = -(-self.scenario.ticks // SEGMENT_TICKS)
        # Programs depend on the length of a segment, not of the mission, so that missions of other lengths share them.
        self._segment_file = file.model_copy(update={"duration_s": SEGMENT_TICKS * self.scenario.tick_s})
        self._segment_scenario = dataclasses.replace(self.scenario, ticks=SEGMENT_TICKS)
        self._run = run_programs.run_program(self._segment_file, self._segment_scenario, self.stages, self.batching)
        self._nominal = jax.tree.map(np.asarray, self._run.nominal)
        self._programs: tuple[Any, DevicePrograms] | None = None
        self.members = members.member_files(file)
        self.member_params = [jax.tree.map(np.asarray, own) for own in members.member_params(file)]
        batch = (self.members[0], self.scenario, self.member_params[0], self.runs_per_device, self.devices)
        self.passive_safety, self.coverage = PassiveSafety(*batch), SurfaceCoverage(*batch)

    @property
    def capacity(self) -> int:
        """Runs that all devices take at once."""
        return self.runs_per_device * len(self.devices)

    def compile(self) -> None:
        """Compiles both programs, once.

        Sets `compile_s`, the time that it took with tracing [s], and `loop_compile_s`, XLA's part of it for the loop.
        """
        if self._programs is not None:
            return
        begin = time.perf_counter()
        self.coverage.start()
        with thread_pool(2) as pool:
            # The preparation is compiled while the loop, which needs its output shapes, is traced.
            preparation = pool.submit(_compile_preparation, self._preparation_trace)
            traces = self._loop_traces
            drawn = jax.eval_shape(
                lambda values: teams.of_member(self.file, values, 0), self._preparation_trace.out_info[0]
            )
            with self._tracing_precision():
                safety = pool.submit(self.passive_safety.compile, {**self._of_pairs(drawn), **drawn})
                loops = traces.compile(compiler_options.LOOP_OPTIONS)
            safety.result()
            self.coverage.compile(drawn)
            self.loop_compile_s = loops.compile_s
            self._programs = (preparation.result(), loops)
        self.compile_s = time.perf_counter() - begin

    def _of_pairs(self, drawn: Mapping[str, Any]) -> dict[str, Any]:
        """Shapes of the values by which a servicer of a team stands for the target of another one."""
        keys = team_passive_safety.keys_of_target(self.scenario.effects, drawn) if self.file.servicers else {}
        return {key: drawn[own] for own, key in keys.items()}

    @property
    def loop_program(self) -> Any:
        """Compiled loop of the first device, for its HLO text and cost analysis."""
        self.compile()
        assert self._programs is not None
        return self._programs[1].programs[0]

    @functools.cached_property
    def _compiled_preparation(self) -> Any:
        return _compile_preparation(self._preparation_trace)

    @functools.cached_property
    def _preparation_trace(self) -> Traced:
        with garbage_collection.suspended():
            return jax.jit(self._prepare).trace(*self._example_inputs())

    @functools.cached_property
    def _loop_traces(self) -> DeviceTraces:
        arguments = self._loop_arguments()
        with self._tracing_precision():
            return programs_per_device.trace_for_devices(self._advance, arguments, self.devices, donate=(2,))

    def _tracing_precision(self) -> contextlib.AbstractContextManager[None]:
        return single_precision.tracing_in_single() if self.is_single_precision else contextlib.nullcontext()

    def _loop_arguments(self) -> tuple[Any, Any, Any, Any]:
        """Nominal Params, shapes of the dispersed values and states that the preparation returns, and of a number."""
        drawn, _, state = self._preparation_trace.out_info
        ticks = jax.ShapeDtypeStruct((), np.int32)
        if not self.is_single_precision:
            return self._nominal, drawn, state, ticks
        return (
            single_precision.round_to_single(self._nominal),
            jax.eval_shape(single_precision.round_to_single, drawn),
            state,
            ticks,
        )

    def _example_inputs(self) -> tuple[Params, Any, Array, np.ndarray, Mapping[str, np.ndarray]]:
        """Arguments of the preparation of which only the shapes matter."""
        return self._preparation_inputs(0, np.zeros(self.runs_per_device, dtype=np.int64))

    def _preparation_inputs(
        self, seed: int, run_ids: np.ndarray, assigned: Mapping[str, np.ndarray] | None = None
    ) -> tuple[Params, Any, Array, np.ndarray, Mapping[str, np.ndarray]]:
        if assigned is None:
            assigned = self.design.for_runs(run_ids) if self.design else {}
        key = jnp.asarray(random_streams.master_key(seed))
        return self._nominal, self._run.draw_numbers, key, run_ids.astype(np.int32), assigned

    def draw_values(self, seed: int, run_ids: np.ndarray) -> dict[str, np.ndarray]:
        """Dispersed values of `runs_per_device` runs, equal to those of `prepare`, without compiling the loop."""
        drawn, _, _ = self._compiled_preparation(*self._preparation_inputs(seed, run_ids))
        return {name: np.asarray(values) for name, values in drawn.items()}

    def channel_names(self) -> list[str]:
        """Names of the telemetry channels, without compiling anything."""
        _, channels = self._loop_traces.outputs
        return sorted(channels)

    def channel_shapes(self) -> dict[str, jax.ShapeDtypeStruct]:
        """Shape and type of every telemetry channel at a tick of a run, floats in double precision."""
        _, channels = self._loop_traces.outputs
        last = -2 if self.file.servicers else -1
        return {
            name: jax.ShapeDtypeStruct(
                values.shape[1:last], np.float64 if np.issubdtype(values.dtype, np.floating) else values.dtype
            )
            for name, values in channels.items()
        }

    def prepare(self, seed: int, run_ids: np.ndarray, assigned: Mapping[str, np.ndarray] | None = None) -> PreparedRuns:
        """Dispersed values and initial states of `capacity` runs.

        `assigned` rows (capacity, ...) stand in place of what the design assigns to the runs' numbers.
        """
        self.compile()
        assert self._programs is not None
        prepare, loops = self._programs
        parts = []
        for rows in np.split(np.arange(len(run_ids)), len(self.devices)):
            own = None if assigned is None else {name: values[rows] for name, values in assigned.items()}
            parts.append(prepare(*self._preparation_inputs(seed, run_ids[rows], own)))
        return PreparedRuns(
            run_ids=run_ids,
            drawn=concatenate([drawn for drawn, _, _ in parts]),
            used=concatenate([used for _, used, _ in parts]),
            device_inputs=loops.place([(*self._loop_inputs(drawn), state) for drawn, _, state in parts]),
        )

    def _loop_inputs(self, drawn: Values) -> tuple[Params, Values]:
        """Nominal Params and dispersed values in the precision of the loop."""
        inputs = (self._nominal, drawn)
        return single_precision.round_to_single(inputs) if self.is_single_precision else inputs

    def simulate(self, prepared: PreparedRuns, redrawn: RedrawnNoise | None = None) -> Iterator[Segment]:
        """Simulates prepared runs to the end of the scenario, segment by segment; the last one is cut at the end.

        The devices work on the next segments while the caller handles this one. Prepared runs can be simulated once:
        their states are donated to the loop. `redrawn` noise replaces that of the runs' own keys.
        """
        assert self._programs is not None
        parts = [None] * len(self.devices) if redrawn is None else redrawn.split(len(self.devices))
        batches = [
            _DeviceBatch(program, self.scenario.ticks, *inputs, redrawn=part)
            for program, inputs, part in zip(self._programs[1].programs, prepared.device_inputs, parts, strict=True)
        ]
        segments = programs_per_device.call_in_threads([batch.advance for batch in batches], self.segment_count)
        with contextlib.closing(segments):
            # A map, not a loop: no local variable keeps a device's records alive while the caller works.
            yield from map(self._segment, itertools.count(), segments)

    def _segment(self, number: int, parts: Sequence["_DeviceSegment"]) -> Segment:
        first = number * SEGMENT_TICKS
        kept_ticks = min(SEGMENT_TICKS, self.scenario.ticks - first)
        return Segment(
            first_tick=first,
            device_channels=[
                {name: np.asarray(value)[:kept_ticks] for name, value in part.channels.items()} for part in parts
            ],
            failure=np.concatenate([part.failure for part in parts], axis=-1),
            failed_at=np.concatenate([part.failed_at for part in parts], axis=-1),
        )

    def _prepare(
        self, nominal: Params, numbers: Any, key: Array, run_ids: Array, assigned: Values
    ) -> tuple[Values, Values, Any]:
        def prepare_run(run_id: Array, assigned: Values) -> tuple[Values, Values, Any]:
            run_key = random_streams.fold_in(key, run_id)
            return self._run.prepare(nominal, numbers, run_key, assigned, single=self.is_single_precision)

        return jax.vmap(prepare_run, out_axes=(0, 0, self._run.state_axes))(run_ids, assigned)

    def _advance(self, nominal: Params, values: Values, state: Any, ticks: Array) -> tuple[Any, Channels]:
        """State after some ticks, at most `SEGMENT_TICKS`, and their channels in the first rows.

        Some more ticks may follow, with which the host does nothing.
        """

        def tick(values: Values, state: Any) -> tuple[Any, Channels]:
            return self._run.tick(nominal, values, state)

        axes = self._run.state_axes
        batched_tick = batch_transform(self._segment_scenario, self.batching)(
            tick, in_axes=(-1, axes), out_axes=(axes, -1)
        )
        runs_last = {name: jnp.moveaxis(value, 0, -1) for name, value in values.items()}
        return scan_to_count(lambda carry: batched_tick(runs_last, carry), state, ticks, SEGMENT_TICKS)


@dataclass(frozen=True)
class _DeviceSegment:
    """Channels of one device's runs over a segment, and their failures so far."""

    channels: Channels
    failure: np.ndarray
    failed_at: np.ndarray


@dataclass
class _DeviceBatch:
    """Runs of one device while they are simulated."""

    program: Any
    ticks: int
    nominal: Params
    values: Values
    state: Any
    redrawn: RedrawnNoise | None = None
    number: int = 0
    own_keys: Any = None

    def advance(self) -> _DeviceSegment:
        """Advances the runs by one segment."""
        if self.redrawn is not None:
            self.own_keys = np.array(self.state.keys) if self.own_keys is None else self.own_keys
            keys = self.redrawn.keys_in_segment(self.number, self.own_keys)
            self.state = dataclasses.replace(self.state, keys=jax.device_put(keys, self.state.keys.sharding))
        count = np.int32(min(SEGMENT_TICKS, self.ticks - self.number * SEGMENT_TICKS))
        self.number += 1
        self.state, channels = self.program(self.nominal, self.values, self.state, count)
        channels = jax.block_until_ready(programs_per_device.copied_to_host(channels))
        # Copies: the state itself is donated to the next segment.
        return _DeviceSegment(channels, np.array(self.state.failure), np.array(self.state.failed_at))


def _compile_preparation(trace: Traced) -> Any:
    return compiler_options.compile_with_options(trace.lower(), compiler_options.PREPARATION_OPTIONS)
