"""Inspection coverage of a batch of runs: which facets of the target were lit and seen, after the simulation."""

from collections.abc import Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any, Final

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from rpojax.core.pytree import concatenate, pytree
from rpojax.metrics import surface_coverage as metrics
from rpojax.runtime import programs_per_device
from rpojax.runtime.programs_per_device import DevicePrograms
from rpojax.scenario.dispersed_numbers import dispersed_values
from rpojax.scenario.dispersed_numbers.dispersed_values import Values
from rpojax.scenario.params import Params
from rpojax.scenario.schema import ScenarioFile
from rpojax.scenario.static_settings import Scenario
from rpojax.scenario.trained import coverage_surface
from rpojax.simulation.metrics.facet_inspection import Inspection, Instant, Surface, View
from rpojax.vision.surface import surface_cache
from rpojax.vision.surface.facets import Facets

_CHANNELS: Final = {
    **{name: name for name in ("r_TN_N", "r_ST_N", "q_TN", "q_BN", "running")},
    "accepted": "box_accepted",
}
"""Channel of each field of `Instant`."""
REQUIRED_CHANNELS: Final = tuple(_CHANNELS.values())
"""Channels from which coverage is evaluated."""
_SHAPES: Final = {"r_TN_N": (3,), "r_ST_N": (3,), "q_TN": (4,), "q_BN": (4,), "running": (), "accepted": ()}
_SAMPLES_AT_ONCE: Final = 64
"""Samples in a call; their number is fixed, so that missions of other lengths use the same program."""
_NEVER: Final = np.iinfo(np.int32).max
"""Number of the sample in which a facet was first seen, if it never was."""


@dataclass(frozen=True)
class CoverageResults:
    """Coverage of a batch of runs; empty without coverage.

    Attributes:
        metrics: name -> (runs,)
        maps: `lit_samples` and `seen_samples` (runs, facets): number of samples in which a facet was lit, and seen
        tally: what they are made of, None without coverage
    """

    metrics: Mapping[str, np.ndarray]
    maps: Mapping[str, np.ndarray]
    tally: "Tally | None" = None


@pytree
class Tally:
    """What has been lit and seen.

    Attributes:
        lit: (facets,) samples in which a facet was lit
        seen: (facets,) samples in which it was seen
        first_seen: (facets,) number of the first of these
    """

    lit: Array
    seen: Array
    first_seen: Array


class SurfaceCoverage:
    """Coverage of batches of a fixed size, by a program that is compiled once.

    Args:
        file: the scenario
        scenario: its static settings
        nominal: its nominal parameters
        runs_per_device: batch size of a device
        devices: that share a batch
        triangles: (n, 3, 3) of the surface in T [m], by default that of the scenario
    """

    def __init__(
        self,
        file: ScenarioFile,
        scenario: Scenario,
        nominal: Params,
        runs_per_device: int,
        devices: Sequence[Any],
        triangles: np.ndarray | None = None,
    ) -> None:
        self.section, self.scenario, self.nominal = file.coverage, scenario, nominal
        self.runs_per_device, self.devices = runs_per_device, devices
        self.ticks = np.arange(0, scenario.ticks, max(1, round(file.coverage.spacing_s / scenario.tick_s)))
        self._surface: Future[tuple[Facets, np.ndarray]] | None = None
        self._programs: DevicePrograms | None = None
        if file.coverage.enabled:
            self._triangles = coverage_surface.surface_triangles(file.model_dump()) if triangles is None else triangles

    def start(self) -> None:
        """Begins to make the facets and their table of visibility, in a thread."""
        if self.section.enabled and self._surface is None:
            pool = ThreadPoolExecutor(1)
            self._surface = pool.submit(self._make_surface)
            pool.shutdown(wait=False)

    @property
    def facets(self) -> Facets:
        """Facets of the nominal target."""
        return self._made_surface()[0]

    def compile(self, drawn: Mapping[str, Any]) -> None:
        """Compiles the program, once, for dispersed values (runs of a device, ...) or their shapes."""
        if self._programs is not None or not self.section.enabled:
            return
        values = {name: jax.ShapeDtypeStruct(each.shape, each.dtype, weak_type=False) for name, each in drawn.items()}
        samples = (self.runs_per_device, _SAMPLES_AT_ONCE)
        instants = Instant(
            time=_shape(samples, np.float64),
            **{name: _shape((*samples, *shape), np.float32 if shape else np.bool_) for name, shape in _SHAPES.items()},
        )
        numbers = _shape((_SAMPLES_AT_ONCE,), np.int32)
        arguments = (self.nominal, self._nominal_surface(), values, instants, numbers, self._nothing())
        self._programs = programs_per_device.trace_for_devices(self._tally_runs, arguments, self.devices).compile()

    def evaluate(
        self, drawn: Mapping[str, np.ndarray], records: Mapping[str, np.ndarray], nominal: Params | None = None
    ) -> CoverageResults:
        """Coverage from dispersed values (runs, ...) and recorded channels (ticks, ..., runs).

        `nominal` parameters are by default those of the batch.
        """
        if not self.section.enabled:
            return CoverageResults({}, {})
        self.compile(drawn)
        assert self._programs is not None
        first_runs = [place * self.runs_per_device for place in range(len(self.devices))]
        rows = [slice(first, first + self.runs_per_device) for first in first_runs]
        surface = self._nominal_surface()
        known = [
            (nominal or self.nominal, surface, {name: values[own] for name, values in drawn.items()}) for own in rows
        ]
        known = self._programs.place(known)
        tallies = [self._nothing() for _ in rows]
        for first in range(0, len(self.ticks), _SAMPLES_AT_ONCE):
            numbers = np.arange(first, first + _SAMPLES_AT_ONCE, dtype=np.int32)
            samples = [(self._instants(records, own, numbers), numbers) for own in rows]
            arguments = [(*a, *b, c) for a, b, c in zip(known, samples, tallies, strict=True)]
            tallies = self._programs.call(self._programs.place(arguments))
        return self._results(jax.tree.map(np.asarray, concatenate(tallies)))

    def union(self, servicers: Sequence[CoverageResults]) -> CoverageResults:
        """Coverage by a team: a facet is seen if anyone sees it, so often as by the servicer that sees it most."""
        tallies = [servicer.tally for servicer in servicers if servicer.tally is not None]
        if not tallies:
            return CoverageResults({}, {})
        lit, seen, first_seen = (
            [np.asarray(getattr(tally, name)) for tally in tallies] for name in ("lit", "seen", "first_seen")
        )
        # All have the same target in the same light, unless one stopped early.
        joint = Tally(lit=np.max(lit, axis=0), seen=np.max(seen, axis=0), first_seen=np.min(first_seen, axis=0))  # pyright: ignore[reportArgumentType]
        return self._results(joint)

    def _results(self, tally: "Tally") -> CoverageResults:
        maps: dict[str, Any] = {"lit_samples": tally.lit, "seen_samples": tally.seen}
        return CoverageResults(self._metrics(tally), maps, tally)

    def _make_surface(self) -> tuple[Facets, np.ndarray]:
        return surface_cache.facets_and_table(self._triangles, self.section.facet_size_m)

    def _made_surface(self) -> tuple[Facets, np.ndarray]:
        self.start()
        assert self._surface is not None
        return self._surface.result()

    def _nominal_surface(self) -> Surface:
        facets, visible = self._made_surface()
        fields: dict[str, Any] = {"centers": facets.centers, "normals": facets.normals}
        return Surface(
            visible=jnp.asarray(visible), **{name: values.astype(np.float32) for name, values in fields.items()}
        )

    def _instants(self, records: Mapping[str, np.ndarray], rows: slice, numbers: np.ndarray) -> Instant:
        """Samples with some numbers of some runs (runs, samples, ...); after the last one no run lasts."""
        ticks = self.ticks[np.minimum(numbers, len(self.ticks) - 1)]
        fields: dict[str, Any] = {
            name: np.moveaxis(records[channel][ticks][..., rows], -1, 0) for name, channel in _CHANNELS.items()
        }
        fields["running"] = fields["running"] & (numbers < len(self.ticks))
        fields["time"] = np.broadcast_to(ticks * self.scenario.tick_s, fields["running"].shape)
        return Instant(**fields)

    def _nothing(self) -> Tally:
        """Tallies of the runs of a device before the first sample."""
        shape = (self.runs_per_device, len(self.facets.areas))
        none: Any = np.zeros(shape, np.int32)
        return Tally(lit=none, seen=none, first_seen=none + np.int32(_NEVER))

    def _metrics(self, tally: Tally) -> dict[str, np.ndarray]:
        """Metrics (runs,): NaN if nothing was lit, and the time if too little was seen."""
        areas, rows = self.facets.areas, list(zip(np.asarray(tally.lit), np.asarray(tally.first_seen), strict=True))
        tick_s = self.scenario.tick_s
        sampled_s = np.append(self.ticks * tick_s, np.nan)
        found = {
            metrics.SEEN_FRACTION: [metrics.seen_fraction(areas, lit > 0, first < _NEVER) for lit, first in rows],
            metrics.TIME_TO_90_PERCENT: [
                metrics.time_to_see(areas, lit > 0, sampled_s[np.minimum(first, len(self.ticks))])
                for lit, first in rows
            ],
        }
        return {name: np.array(values) for name, values in found.items()}

    def _tally_runs(
        self, nominal: Params, surface: Surface, values: Values, instants: Instant, numbers: Array, before: Tally
    ) -> Tally:
        """Tallies of the runs of a device with some more samples, one run after the other.

        So they do not depend on the place of a run.
        """

        def tally_run(inputs: tuple[Values, Instant, Tally]) -> Tally:
            params = dispersed_values.apply_to_params(nominal, inputs[0])
            return self._tally(params, surface, inputs[1], numbers, inputs[2])

        return jax.lax.map(tally_run, (values, instants, before))

    def _tally(self, params: Params, surface: Surface, instants: Instant, numbers: Array, before: Tally) -> Tally:
        inspection = Inspection(self.scenario, self.section)

        def add(tally: Tally, inputs: tuple[Array, View]) -> tuple[Tally, None]:
            number, view = inputs
            lit, seen = inspection.lit_and_seen(params, surface, view)
            first_seen = jnp.minimum(tally.first_seen, jnp.where(seen, number, _NEVER))
            counts = tally.lit + lit.astype(jnp.int32), tally.seen + seen.astype(jnp.int32)
            return Tally(lit=counts[0], seen=counts[1], first_seen=first_seen), None

        # Before the scan, so that XLA does not compute the geometry again for every facet.
        views = jax.vmap(lambda instant: inspection.view(params, instant))(instants)
        return jax.lax.scan(add, before, (numbers, views))[0]


def _shape(shape: tuple[int, ...], dtype: Any) -> Any:
    return jax.ShapeDtypeStruct(shape, dtype)
