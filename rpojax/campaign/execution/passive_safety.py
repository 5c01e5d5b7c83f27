"""Passive safety of a batch of runs: their free drifts, by one more compiled program after the simulation."""

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from rpojax.batching import batching_mode
from rpojax.core.numerics import gradient_safe
from rpojax.core.orbits import keplerian_elements
from rpojax.core.pytree import pytree, replace
from rpojax.metrics import passive_safety as metrics
from rpojax.physics import free_drift
from rpojax.physics.free_drift import STEP_S, Drift, DriftRange, Environment, Propagation
from rpojax.runtime import compiler_options, programs_per_device
from rpojax.runtime.programs_per_device import DevicePrograms
from rpojax.scenario.dispersed_numbers import dispersed_values
from rpojax.scenario.dispersed_numbers.dispersed_values import Values
from rpojax.scenario.params import Params
from rpojax.scenario.schema import ScenarioFile
from rpojax.scenario.static_settings import Scenario
from rpojax.simulation.metrics import drift_starts, recorded_metrics
from rpojax.simulation.metrics.drift_starts import DriftStarts

_DRIFTS_AT_ONCE = 48
"""Drifts of a run in a column of a call; their number is fixed, so that reruns and other missions use one program."""
_LEAST_MISSION_STEPS = 64
"""Steps of the propagation in the longest mission of those that share a program; twice as many in the next longer."""
_SHARED_FIELDS = ("is_stuck", "r_ST_N", "v_ST_N", "mass", "last_delta_v")
_FIELDS = {
    **dict.fromkeys(("start", "last", "burn", "mass", "last_delta_v"), ((), np.float64)),
    "is_stuck": ((), np.bool_),
    **dict.fromkeys(("r_ST_N", "v_ST_N"), ((2, 3), np.float64)),
}
"""Shape of one drift and type of each field of `StartBatch`."""
_MOST_RUNS_ON_CORE = 64
"""Runs that a core of a CPU takes at once: their intermediate values stay in its cache."""


@pytree
class StartBatch:
    """Starts of drifts of many runs: fields (..., drifts, runs) as in `DriftStarts`, times in s.

    Attributes:
        start: at which each begins
        last: of its last instant; negative infinity if there is no drift
        burn: last time before the burn
        is_stuck: whether the thruster stays open
        r_ST_N: (2, 3) before the burn and at the start
        v_ST_N: (2, 3) before the burn and at the start
        mass: of the servicer
        last_delta_v: in the tick before the start
    """

    start: Array
    last: Array
    burn: Array
    is_stuck: Array
    r_ST_N: Array
    v_ST_N: Array
    mass: Array
    last_delta_v: Array


@pytree
class Spans:
    """Times of free drift.

    Attributes:
        stuck_on: () that a thruster stays open [s]
        orbits: (horizons,) lengths of horizons in orbits, 0 of those that are given in seconds
        seconds: (horizons,) lengths of the others [s]
    """

    stuck_on: Array
    orbits: Array
    seconds: Array


class PassiveSafety:
    """Metrics of the free drifts of runs, by a program for batches of a fixed size that is compiled once.

    Args:
        file: the scenario
        scenario: its static settings
        nominal: its nominal parameters
        runs_per_device: batch size of a device
        devices: that share a batch
    """

    def __init__(
        self, file: ScenarioFile, scenario: Scenario, nominal: Params, runs_per_device: int, devices: Sequence[Any]
    ) -> None:
        self.file, self.scenario, self.nominal = file, scenario, nominal
        self.runs_per_device, self.devices = runs_per_device, devices
        self._programs: DevicePrograms | None = None
        self.spacing_ticks = max(1, round(file.safety.spacing_s / scenario.tick_s))
        self.mission_steps = _LEAST_MISSION_STEPS
        while self.mission_steps * STEP_S < scenario.ticks * scenario.tick_s + STEP_S:
            self.mission_steps *= 2
        self._spans = _spans(file)
        calls = -(-runs_per_device // _MOST_RUNS_ON_CORE) if devices[0].platform == "cpu" else 1
        self.runs_at_once = -(-runs_per_device // calls)
        self.drifts_at_once = _DRIFTS_AT_ONCE

    def evaluate(
        self, drawn: Mapping[str, np.ndarray], records: Mapping[str, np.ndarray], nominal: Params | None = None
    ) -> dict[str, np.ndarray]:
        """Metrics (runs,) from dispersed values (runs, ...) and recorded channels (ticks, ..., runs).

        `nominal` parameters are by default those of the batch; those of another servicer of a team have equal shapes.
        Those in windows of requirements are NaN for a run that never was there or was frozen there.
        """
        runs = self.runs_per_device * len(self.devices)
        windows = self._windows(records)
        starts = [
            drift_starts.drift_starts(
                {name: records[name][..., run] for name in drift_starts.REQUIRED_CHANNELS},
                self.spacing_ticks,
                [tick for flags in windows.values() for tick in (np.flatnonzero(np.diff(flags[run])) + 1).tolist()],
            )
            for run in range(runs)
        ]
        most = max(len(start.ticks) for start in starts)
        # Most runs have few drifts: a run takes more columns of the batch only where it has more of them.
        columns = [
            (run, first)
            for first in range(0, most, self.drifts_at_once)
            for run in range(runs)
            if first < len(starts[run].ticks)
        ]
        least = np.full((len(self.file.safety.horizons) + 1, most + self.drifts_at_once, runs), np.inf)
        entry = np.full(least.shape[1:], np.inf)
        for (run, first), found in zip(
            columns, self._propagate(nominal or self.nominal, drawn, starts, columns), strict=True
        ):
            drifts = slice(first, first + self.drifts_at_once)
            least[:, drifts, run], entry[drifts, run] = np.sqrt(found.least_square), found.entry
        running = records["running"].T
        found = self._metrics(starts, least, entry, np.ones_like(running))
        in_windows: dict[str, np.ndarray] = {}
        for window, flags in windows.items():
            frozen = (flags & ~running).any(axis=1)
            values = self._metrics(starts, least, entry, flags)
            in_windows |= {name + window: np.where(frozen, np.nan, value) for name, value in values.items()}
        required = {requirement.metric_name for requirement in self.file.requirements}
        return found | {name: values for name, values in in_windows.items() if name in required}

    def _windows(self, records: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
        """Flags (runs, ticks) of the windows of requirements on drifts, by suffix."""
        by_run = {name: records[name].T for name in ("running", "phase") if name in records}
        return {
            requirement.window.suffix: recorded_metrics.window_ticks(self.file, requirement.window, by_run)
            for requirement in self.file.requirements
            if requirement.window.suffix and metrics.is_of_drifts(requirement.metric)
        }

    def _metrics(
        self, starts: Sequence[DriftStarts], least: np.ndarray, entry: np.ndarray, window: np.ndarray
    ) -> dict[str, np.ndarray]:
        """Metrics of drifts from the ticks of a window, NaN for runs without a drift in it.

        Args:
            starts: drifts of each run
            least: least ranges (horizons + 1, drifts, runs) [m]
            entry: times of entry (drifts, runs) less the longest horizon [s]
            window: flags (runs, ticks)
        """
        found: dict[str, list[float]] = {}
        for run, (each, flags) in enumerate(zip(starts, window, strict=True)):
            count, there = len(each.ticks), flags[each.ticks]
            own, stuck, among = there & ~each.is_stuck, there & each.is_stuck, flags[each.instants]
            ranges = least[:, :count, run]
            unsafe = entry[each.instant_drifts, run] <= each.instants * self.scenario.tick_s
            values = {
                metrics.horizon_metric_name(horizon): _least(ranges[place, own])
                for place, horizon in enumerate(self.file.safety.horizons)
            }
            values[metrics.UNSAFE_FRACTION] = each.unsafe_fraction(unsafe, among) if among.any() else math.nan
            values[metrics.STUCK_ON_RANGE] = _least(ranges[-1, stuck])
            # Drifts are in order of time.
            values[metrics.FINAL_DRIFT_RANGE] = _least(ranges[-1, own][-1:])
            for name, value in values.items():
                found.setdefault(name, []).append(value)
        arrays = {name: np.array(values) for name, values in found.items()}
        one_orbit = arrays.get(metrics.horizon_metric_name("1_orbit"))
        return arrays if one_orbit is None else {**arrays, metrics.ONE_ORBIT_RANGE: one_orbit}

    def compile(self, drawn: Mapping[str, Any]) -> None:
        """Compiles the program, once, for dispersed values (runs of a device, ...) or their shapes."""
        if self._programs is not None:
            return
        size, count = self.runs_at_once, self.drifts_at_once
        values = {
            name: jax.ShapeDtypeStruct((*each.shape[1:], size), each.dtype, weak_type=False)
            for name, each in drawn.items()
        }
        numbers: dict[str, Any] = {
            name: jax.ShapeDtypeStruct((*shape, count, size), dtype) for name, (shape, dtype) in _FIELDS.items()
        }
        traces = programs_per_device.trace_for_devices(
            self._drift, (self.nominal, values, StartBatch(**numbers), self._spans), self.devices
        )
        self._programs = traces.compile(compiler_options.LOOP_OPTIONS)

    def _propagate(
        self,
        nominal: Params,
        drawn: Mapping[str, np.ndarray],
        starts: Sequence[DriftStarts],
        columns: Sequence[tuple[int, int]],
    ) -> Iterator[DriftRange]:
        """Ranges of the drifts of each column, from a number on of a run, `entry` less the longest horizon."""
        self.compile(drawn)
        assert self._programs is not None
        size = self.runs_at_once
        groups = [columns[begin : begin + size] for begin in range(0, len(columns), size)]
        for begin in range(0, len(groups), len(self.devices)):
            batch = groups[begin : begin + len(self.devices)]
            programs = self._programs.first(len(batch))
            results = programs.call(
                programs.place([(nominal, *self._arguments(drawn, starts, group), self._spans) for group in batch])
            )
            for group, result in zip(batch, results, strict=True):
                arrays = jax.tree.map(np.asarray, result)
                for place in range(len(group)):
                    yield jax.tree.map(lambda each, place=place: each[..., place], arrays)

    def _arguments(
        self, drawn: Mapping[str, np.ndarray], starts: Sequence[DriftStarts], group: Sequence[tuple[int, int]]
    ) -> tuple[Mapping[str, np.ndarray], StartBatch]:
        """Arguments of the program for some columns; the last is repeated until they fill a call."""
        filled = [*group, *[group[-1]] * (self.runs_at_once - len(group))]
        runs = [run for run, _ in filled]
        values = {name: np.moveaxis(each[runs], 0, -1) for name, each in drawn.items()}
        return values, self._batch([starts[run] for run in runs], [first for _, first in filled])

    def _batch(self, starts: Sequence[DriftStarts], firsts: Sequence[int]) -> StartBatch:
        count, tick_s = self.drifts_at_once, self.scenario.tick_s
        numbers = [np.arange(first, first + count) for first in firsts]
        rows = [np.minimum(own, len(start.ticks) - 1) for own, start in zip(numbers, starts, strict=True)]
        exists = np.stack([own < len(each.ticks) for own, each in zip(numbers, starts, strict=True)], axis=-1)

        def gathered(name: str) -> np.ndarray:
            return np.stack([getattr(start, name)[..., row] for start, row in zip(starts, rows, strict=True)], axis=-1)

        fields: dict[str, Any] = {name: gathered(name) for name in _SHARED_FIELDS}
        fields |= {
            "start": gathered("ticks") * tick_s,
            "last": np.where(exists, gathered("last_ticks") * tick_s, -np.inf),
            "burn": gathered("burn_ticks") * tick_s,
        }
        return StartBatch(**fields)

    def _drift(self, nominal: Params, values: Values, batch: StartBatch, spans: Spans) -> DriftRange:
        """Ranges of the drifts of the runs of a device; `entry` is less the longest horizon."""

        def environment(values: Values) -> Environment:
            params = dispersed_values.apply_to_params(nominal, values)
            return Environment(self.scenario.effects, params.plant, params.epoch)

        def begin(values: Values, batch: StartBatch) -> tuple[Drift, Propagation, Array]:
            params = dispersed_values.apply_to_params(nominal, values)
            orbit = free_drift.target_orbit(
                environment(values), *keplerian_elements.state_from_elements(params.orbit), self.mission_steps
            )
            lengths = _horizons(params, spans)
            drifts = batching_mode.transform()(
                lambda start: self._start(environment(values), orbit, lengths, spans.stuck_on, start),
                in_axes=-1,
                out_axes=-1,
            )(batch)
            begun = free_drift.begin_drifts(environment(values), orbit, drifts, params.limits.keep_out, first)
            return drifts, begun, jnp.max(lengths[:-1], axis=0)

        def advance(number: Array, propagation: Propagation) -> Propagation:
            def step(values: Values, drifts: Drift, before: Propagation) -> Propagation:
                keep_out = dispersed_values.apply_to_params(nominal, values).limits.keep_out
                return free_drift.advance_drifts(environment(values), drifts, keep_out, number, before)

            return batching_mode.transform()(step, in_axes=-1, out_axes=-1)(values, drifts, propagation)

        first = jnp.floor(jnp.min(batch.start) / STEP_S).astype(jnp.int32)
        drifts, begun, longest = batching_mode.transform()(begin, in_axes=-1, out_axes=-1)(values, batch)
        last = jnp.ceil(jnp.max(drifts.ends) / STEP_S).astype(jnp.int32)
        found = jax.lax.fori_loop(first, last, advance, begun).found
        return replace(found, entry=found.entry - longest[None, :])

    def _start(
        self, environment: Environment, orbit: Array, lengths: Array, stuck_on: Array, start: StartBatch
    ) -> Drift:
        """Start of a drift; a thruster that stays open pushes in the direction of the burn's velocity change."""
        thruster, zero = environment.params.thruster, jnp.zeros(3)
        acceleration = thruster.force * thruster.force_scale / start.mass
        before = free_drift.motion_at(environment, orbit, start.burn, start.r_ST_N[0], start.v_ST_N[0])
        coasted = environment.advance(before, start.mass, start.burn, start.start - start.burn, zero)
        direction = gradient_safe.normalize(start.v_ST_N[1] - coasted.v_ST_N)
        push = jnp.where(start.is_stuck, acceleration * direction, zero)
        tick_s = self.scenario.tick_s
        shut_for = tick_s - jnp.clip(start.last_delta_v / acceleration, 0.0, tick_s)
        thrust_s = jnp.where(start.is_stuck, jnp.maximum(stuck_on - shut_for, 0.0), 0.0)
        return Drift(
            start=start.start,
            r_ST_N=start.r_ST_N[1] + 0.5 * shut_for * shut_for * push,
            v_ST_N=start.v_ST_N[1] + shut_for * push,
            mass=start.mass,
            thrust_s=thrust_s,
            acceleration_N=push,
            ends=start.last + thrust_s + lengths,
        )


class NoDrifts(PassiveSafety):
    """Free drifts of runs where nothing needs them."""

    def compile(self, drawn: Any) -> None:
        """Compiles nothing."""
        del drawn


def _spans(file: ScenarioFile) -> Spans:
    """Times of free drift of a scenario."""
    lengths = [metrics.horizon_length(horizon) for horizon in file.safety.horizons]
    numbers = {
        "stuck_on": file.safety.stuck_on_s,
        "orbits": [count if in_orbits else 0 for count, in_orbits in lengths],
        "seconds": [0 if in_orbits else 3600 * count for count, in_orbits in lengths],
    }
    arrays: dict[str, Any] = {name: np.array(value, dtype=np.float64) for name, value in numbers.items()}
    return Spans(**arrays)


def _horizons(params: Params, spans: Spans) -> Array:
    """Lengths of the horizons, and of the one after a thruster that stayed open [s]."""
    period = 2.0 * jnp.pi / keplerian_elements.mean_motion(params.orbit.semi_major_axis)
    lengths = spans.orbits * period[None] + spans.seconds
    return jnp.concatenate([lengths, jnp.full_like(lengths[:1], 86400.0)])


def _least(ranges: np.ndarray) -> float:
    """Least of some ranges, NaN if there are none."""
    return float(ranges.min()) if len(ranges) else math.nan
