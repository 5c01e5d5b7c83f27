"""What the rules about causes of failure read of the runs of one servicer."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from rpojax.flight.mission.mission_state import AbortReason, Transition
from rpojax.scenario.dispersed_numbers.values_by_run import values_of_runs
from rpojax.scenario.parameter_keys import nominal_of_key
from rpojax.scenario.schema import ScenarioFile
from rpojax.scenario.warnings.dispersed_reach import DispersedReach
from rpojax.scenario.warnings.target_size import hull_sides
from rpojax.simulation.metrics import failure_signs
from rpojax.simulation.outcomes import outcome_kinds

Arrays = Mapping[str, np.ndarray]
Numbers = NDArray[np.floating]
Flags = NDArray[np.bool_]
WINDOW_S: Final = 600.0
"""Length of the windows in which shares of ticks are taken [s]. A choice: `limits.lost_after_s` of `inspection`."""
_LEAST_TICKS: Final = 30
"""Fewest ticks of a window of which a share means something."""
_TINY: Final = 1e-12


@dataclass(frozen=True)
class RunEvidence:
    """Results of runs, one row each, as a campaign stores them; what it lacks is empty.

    Attributes:
        file: the scenario
        outcomes: (runs,) of str
        failed_at_s: (runs,) since when a run has been in its final state [s], NaN for those that did not fail
        metrics: name -> (runs,)
        drawn: key -> (runs, ...)
        time_s: (samples,) of the traces [s]
        traces: name -> (runs, samples), NaN after a run was frozen
        signs: arrays of `failure_signs.evaluate`
        phases: arrays of `phase_records.evaluate`
    """

    file: ScenarioFile
    outcomes: np.ndarray
    failed_at_s: Numbers
    metrics: Arrays = field(default_factory=dict)
    drawn: Arrays = field(default_factory=dict)
    time_s: Numbers = field(default_factory=lambda: np.zeros(0))
    traces: Arrays = field(default_factory=dict)
    signs: Arrays = field(default_factory=dict)
    phases: Arrays = field(default_factory=dict)

    @property
    def count(self) -> int:
        """Number of runs."""
        return len(self.outcomes)

    @cached_property
    def failed(self) -> Flags:
        """(runs,) whether the run failed."""
        return outcome_kinds.is_failed(self.outcomes)

    @cached_property
    def completed(self) -> Flags:
        """(runs,) whether the run was completed."""
        return np.asarray(self.outcomes == outcome_kinds.Outcome.COMPLETED)

    @cached_property
    def reach(self) -> DispersedReach:
        """Ends of the dispersed numbers."""
        return DispersedReach(self.file)

    def value(self, key: str) -> np.ndarray:
        """Value of a key in each run (runs, ...)."""
        values = values_of_runs(self.drawn, key, nominal_of_key(self.file, key))
        return np.broadcast_to(values, (self.count, *values.shape[1:]))

    def metric(self, name: str) -> Numbers:
        """A metric (runs,), NaN where there is none and in runs that go on after `until_s`, of which it is, too."""
        values = np.asarray(self.metrics.get(name, np.full(self.count, np.nan)), dtype=np.float64)
        return np.where(self.goes_on, np.nan, values)

    @cached_property
    def abort_reason(self) -> np.ndarray:
        """(runs,) an `AbortReason`, none without phases."""
        return np.asarray(self.phases.get("abort_reason", np.zeros(self.count, np.int8)))

    @cached_property
    def aborted_at_s(self) -> Numbers:
        """(runs,) when a run aborted [s], infinite if it did not."""
        if not self.phases:
            return np.full(self.count, np.inf)
        is_abort = self.phases["transition_by"] == Transition.ABORT
        return np.min(np.where(is_abort, self.phases["transition_at_s"], np.inf), axis=1, initial=np.inf)

    @cached_property
    def until_s(self) -> Numbers:
        """(runs,) until when a run is looked at for causes [s]: an abort that was not commanded, or its end."""
        own = np.where(self.abort_reason == AbortReason.COMMAND, np.inf, self.aborted_at_s)
        frozen = np.where(outcome_kinds.is_frozen(self.outcomes), self.failed_at_s, np.inf)
        return np.minimum(np.minimum(own, frozen), self.file.duration_s)

    @cached_property
    def goes_on(self) -> Flags:
        """(runs,) whether a run goes on after `until_s`: it aborted then."""
        return np.asarray((self.abort_reason != AbortReason.COMMAND) & (self.aborted_at_s <= self.until_s))

    def trace(self, name: str) -> Numbers:
        """A trace (runs, samples), NaN from an abort on, else after `until_s`, and where there is none.

        The sample at an abort has the reference of the phase after it.
        """
        values = self.traces.get(name)
        if values is None:
            return np.full((self.count, max(1, len(self.time_s))), np.nan)
        half_tick_s = 0.5 / self.file.rates.camera_hz
        ends_s = self.until_s + np.where(self.goes_on, -half_tick_s, half_tick_s)
        return np.where(self.time_s < ends_s[:, None], values, np.nan).astype(float)

    def first_s(self, flags: Flags) -> Numbers:
        """When flags (runs, samples) of a trace are first raised [s], NaN if never."""
        times = self.time_s if len(self.time_s) else np.full(1, np.nan)
        return np.where(flags.any(axis=1), times[np.argmax(flags, axis=1)], np.nan)

    @cached_property
    def interval_s(self) -> float:
        """Length of the intervals of the signs [s]."""
        hz = self.file.rates.camera_hz
        return failure_signs.interval_ticks(max(1, round(self.file.duration_s * hz)), 1.0 / hz) / hz

    @property
    def has_signs(self) -> bool:
        """Whether signs were recorded."""
        return "ticks" in self.signs

    @cached_property
    def before(self) -> Flags:
        """(runs, intervals) whether an interval of the signs began by `until_s`."""
        starts = self.interval_s * np.arange(self.signs["ticks"].shape[1])
        return starts <= self.until_s[:, None]

    def sign(self, name: str) -> np.ndarray:
        """A sign (runs, intervals), zero after `until_s` and for runs of an older version, which recorded none."""
        return np.where(self.before, np.maximum(self.signs[name], 0), 0)

    @cached_property
    def ranges_m(self) -> Numbers:
        """(runs, intervals) mean range in the intervals of the signs [m], NaN where unknown."""
        return self.in_intervals("range_m")

    def in_intervals(self, name: str) -> Numbers:
        """Mean of a trace until `until_s` in the intervals of the signs (runs, intervals), NaN where unknown."""
        intervals = self.signs["ticks"].shape[1]
        place = np.minimum((self.time_s / self.interval_s).astype(int), intervals - 1)
        found = np.full((self.count, intervals), np.nan)
        if name not in self.traces:
            return found
        values = self.trace(name)
        for each in np.unique(place):
            part = values[:, place == each]
            known = np.isfinite(part)
            total = np.sum(part, axis=1, where=known, dtype=float)
            found[:, each] = np.where(known.any(axis=1), total / np.maximum(known.sum(axis=1), 1), np.nan)
        return found

    def first_interval_s(self, flags: Flags) -> Numbers:
        """When the first interval of the signs with a raised flag (runs, intervals) begins [s], NaN without one."""
        return np.where(flags.any(axis=1), self.interval_s * np.argmax(flags, axis=1), np.nan)

    def worst_share(self, part: np.ndarray, whole: np.ndarray, least: int = _LEAST_TICKS) -> tuple[Numbers, Numbers]:
        """Greatest share of ticks over windows (runs,), and when the first window with half of it began [s].

        `part` and `whole` are numbers of ticks (runs, intervals); of less than `least` ticks the share is 0, and where
        it is 0 the time is NaN.
        """
        width = min(max(1, round(WINDOW_S / self.interval_s)), part.shape[1])
        sums = [_moving_sum(each, width) for each in (part, whole)]
        known = sums[1] >= least * min(1.0, self.file.rates.camera_hz)
        shares = np.where(known, sums[0] / np.maximum(sums[1], _TINY), 0.0)
        greatest = shares.max(axis=1)
        first = np.argmax((shares >= 0.5 * greatest[:, None]) & known, axis=1)
        return greatest, np.where(greatest > 0.0, self.interval_s * first, np.nan)

    @cached_property
    def planned_ranges_m(self) -> tuple[float, float]:
        """Least and greatest distance of the start and of what the mission holds or follows [m]."""
        found = [*self.reach.norms("initial.relative_position_m"), *_references_m(self.file)]
        return min(found), max(found)

    @cached_property
    def target_m(self) -> tuple[float, float]:
        """Longer side of the target's picture over all attitudes [m]: median, and the one that 95 % stay below."""
        sides = hull_sides(self.file.target.hull_m).max(axis=1)
        return float(np.median(sides)), float(np.percentile(sides, 95.0))

    @cached_property
    def focal_px(self) -> float:
        """Focal length of the camera [px]."""
        return float(0.5 * self.file.camera.width_px / np.tan(np.radians(0.5 * self.file.camera.field_of_view_deg)))


def _moving_sum(values: np.ndarray, width: int) -> Numbers:
    total = np.cumsum(values, axis=1, dtype=float)
    return total[:, width - 1 :] - np.pad(total, ((0, 0), (1, 0)))[:, : total.shape[1] - width + 1]


def _references_m(file: ScenarioFile) -> Iterator[float]:
    """Distances [m] of the station, or of the references of phases."""
    if not file.phases:
        yield float(np.linalg.norm(file.formation.desired_position_m))
    for phase in file.phases:
        yield from _distances_m(phase.reference.model_dump())


def _distances_m(reference: Mapping[str, Any]) -> Iterator[float]:
    for name in ("position_m", "end_position_m"):
        if reference.get(name) is not None:
            yield float(np.linalg.norm(reference[name]))
    if reference.get("radius_m") is not None:
        yield float(reference["radius_m"])
    if reference.get("kind") == "relative_orbit":
        radial, cross, along = (float(reference.get(name) or 0.0) for name in _ORBIT)
        if along == 0.0:
            yield from (each for each in (radial, cross, 2.0 * radial) if each > 0.0)
        else:
            yield max(abs(along) - 2.0 * radial, radial, cross)
            yield abs(along) + 2.0 * radial


_ORBIT: Final = ("radial_m", "cross_track_m", "along_track_m")
