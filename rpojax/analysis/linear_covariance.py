"""Linear covariance of the whole closed loop: mean and spread at every second from one nominal run, without sampling.

The derivative of the loop's tick along the nominal run carries the covariance of truth, estimate and flight software
together (Geller, "Linear covariance techniques for orbital rendezvous analysis and autonomous onboard mission
planning", Journal of Guidance, Control and Dynamics 29, 2006). Three things that a derivative does not tell are put in
otherwise: burn decisions by their describing function, the target's attitude by an ensemble of outlines, and boxes that
are missed or given up for a burn by leaving them out of the nominal run at their rate.
"""

import math
import time
from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np

from rpojax.analysis import describing_function, linear_sources, outlines
from rpojax.analysis.linear_loop import OUTPUTS, Compiled, Loop, Moment
from rpojax.analysis.linear_recursion import Recursion, Tick
from rpojax.analysis.linear_state import PENDING, layout
from rpojax.campaign import dispersions
from rpojax.core.pytree import replace
from rpojax.errors import RpojaxError
from rpojax.flight.computer import Stages
from rpojax.simulation import closed_loop, params, scenario
from rpojax.simulation.schema import ScenarioFile

MEMBERS = 256
"""Targets in the ensemble of outlines."""
_SAMPLES_POWER = 10
"""Two to this power is the number of points of a describing function."""
_SPAN = 10
"""Shares of the sources are looked at once in so many ticks, or less."""


@dataclass(frozen=True)
class LinearCovariance:
    """What a linear covariance tells.

    Attributes:
        time_s: (ticks,)
        nominal: (ticks, 16) outputs of the nominal run, as `linear_loop.OUTPUTS`
        mean: (ticks, 16) of all runs
        covariance: (ticks, 16, 16)
        filter_sigma_H: (ticks, 3) of the relative position in the nominal filter [m]
        seen: (ticks,) whether the nominal filter used a box
        sources: names of what makes runs differ
        left_out: names of dispersions whose effect is not in it
        share_time_s: (spans,)
        shares: (spans, sources, 16) variance that comes of each source
        burn_probability: (decisions,) of a burn at each decision
        burn_size_m_s: (decisions,) mean size of its velocity change
        compile_s: compilation [s]
        run_s: everything after it [s]
        run_cpu_s: the same, in time of the processor [s]
    """

    time_s: np.ndarray
    nominal: np.ndarray
    mean: np.ndarray
    covariance: np.ndarray
    filter_sigma_H: np.ndarray
    seen: np.ndarray
    sources: list[str]
    left_out: list[str]
    share_time_s: np.ndarray
    shares: np.ndarray
    burn_probability: np.ndarray
    burn_size_m_s: np.ndarray
    compile_s: float
    run_s: float
    run_cpu_s: float

    def sigma(self, output: str) -> np.ndarray:
        """Standard deviations (ticks, ...) of an output."""
        return np.sqrt(np.diagonal(self.covariance, axis1=1, axis2=2)[:, OUTPUTS[output]])

    def output_mean(self, output: str) -> np.ndarray:
        """Means (ticks, ...) of an output."""
        return self.mean[:, OUTPUTS[output]]


def check(file: ScenarioFile) -> None:
    """Refuses what no derivative can stand for.

    Raises:
        RpojaxError: naming the key.
    """
    if file.camera.model != "geometric":
        raise RpojaxError(f"camera.model: found {file.camera.model!r}, expected 'geometric' for a linear covariance")
    if file.effects.faults:
        raise RpojaxError("effects.faults: found true, expected false for a linear covariance")
    if file.camera.edge_noise_px == 0.0:
        raise RpojaxError("camera.edge_noise_px: found 0.0, expected more for a linear covariance")
    linear_sources.disperse(file)


def analyse(file: ScenarioFile, members: int = MEMBERS, stages: Stages | None = None) -> LinearCovariance:
    """Linear covariance of a scenario with an ensemble of so many targets.

    Raises:
        RpojaxError: as `check` does.
    """
    check(file)
    analysis = _Analysis(file, members, stages or Stages())
    begin, begin_cpu = time.perf_counter(), time.process_time()
    analysis.run()
    return analysis.result(time.perf_counter() - begin, time.process_time() - begin_cpu)


class _Analysis:
    """The recursion, burn period by burn period."""

    def __init__(self, file: ScenarioFile, members: int, stages: Stages) -> None:
        self.file = file
        found = linear_sources.disperse(file)
        self.left_out = found.left_out
        static = scenario.static(file)
        base = params.build(file.model_dump(), static.width_px, static.height_px)
        centre = dispersions.apply(base, {key: jnp.asarray(value) for key, value in found.mean.items()})
        self.edge_noise_px = float(base.camera.edge_noise)
        centre = replace(centre, camera=replace(centre.camera, edge_noise=jnp.ones((), dtype=jnp.float64)))
        key = closed_loop.run_key(0, 0)
        self.state = closed_loop.init(static, centre, key)
        shape = layout(self.state, centre, found.constants())
        self.loop = Loop(static, centre, shape, stages)
        self.state, starts, mean = linear_sources.start_columns(static, centre, shape, key, found)
        self.tumble = outlines.start(file, base, members)
        self.points = describing_function.normal_points(3, _SAMPLES_POWER)
        self.compiled = Compiled(self.loop, self.state, self.tumble, len(self.points))
        self.sources = linear_sources.names(starts)
        self._number = {name: number for number, name in enumerate(self.sources)}
        size, count = shape.size, len(self.tumble.q_TN)
        self.recursion = Recursion(
            columns=np.concatenate([*starts.values(), np.zeros((size, count))], axis=1),
            noise=np.zeros((len(self.sources), size, size)),
            noise_of=self._noise_of(),
        )
        widths = [each.shape[1] for each in starts.values()]
        self.column_of = np.concatenate(
            [np.repeat([self._number[name] for name in starts], widths), np.full(count, self._number["target outline"])]
        )
        self.mean = mean - np.asarray(shape.pack(self.state, self.loop.params))
        self.missed, self.owed = 0.0, 0.0
        self.last: _Decision | None = None
        self.records: dict[str, list] = {name: [] for name in ("nominal", "mean", "covariance", "sigma", "seen")}
        self.shares: list[np.ndarray] = []
        self.decisions: list[tuple[float, float]] = []
        self.span = max(span for span in range(1, _SPAN + 1) if static.formation_ticks % span == 0)

    def _noise_of(self) -> np.ndarray:
        inputs = self.loop.inputs
        numbers = np.zeros(inputs.size, dtype=int)
        for name, part in inputs.parts.items():
            numbers[part] = self._number[name]
        return numbers

    def run(self) -> None:
        """All burn periods; the last one is cut at the end of the scenario."""
        static = self.loop.scenario
        self.sigma = self.loop.inputs.sigma(self.edge_noise_px)
        for first in range(0, static.ticks, static.formation_ticks):
            seen = self._seen()
            self.state, self.tumble, moments, derivatives = self.compiled.period(self.state, self.tumble, seen)
            decision = self._decide(moments, derivatives[0])
            kept = min(static.formation_ticks, static.ticks - first)
            self._carry(moments, derivatives[:kept], decision)
            self.last = decision

    def _forcing(self, edges: np.ndarray) -> np.ndarray:
        """(inputs, columns) of the outlines (members, 4) [px], as multiples of the inputs' sigmas."""
        forcing = np.zeros((len(self.sigma), self.recursion.columns.shape[1]))
        count = len(edges)
        part = self.loop.inputs.parts[linear_sources.BOX]
        forcing[part, -count:] = edges.T / (math.sqrt(count) * self.edge_noise_px)
        return forcing

    def _decide(self, moments: Moment, derivative: np.ndarray) -> "_Decision":
        """The decision on the first of the moments, where the derivative is `derivative`."""
        size = self.loop.layout.size
        gradient = derivative[size:][OUTPUTS["law_H"]]
        U, V = gradient[:, :size], gradient[:, size:]
        forcing = self._forcing(np.asarray(moments.edges[0]))
        covariance = self.recursion.look(U, V * self.sigma, forcing)
        mean = np.asarray(moments.outputs[0])[OUTPUTS["law_H"]] + U @ self.mean
        memory = jax.tree.map(lambda leaf: leaf[0], moments.memory)
        tick = moments.state.tick[0]
        nominal = np.asarray(memory.plan.delta_v_N)
        away: list[np.ndarray] = []

        def burn(laws: np.ndarray) -> np.ndarray:
            burns, times = self.compiled.decide(memory, tick, jnp.asarray(laws))
            away.append(np.asarray(times))
            sizes = np.linalg.norm(burns, axis=1) - np.linalg.norm(nominal)
            return np.concatenate([np.asarray(burns) - nominal, sizes[:, None]], axis=1)

        found = describing_function.linearise(burn, mean, covariance, self.points)
        sizes = found.outputs[:, 3] + np.linalg.norm(nominal)
        made = sizes > 0.0
        self.decisions.append((float(made.mean()), float(sizes.mean())))
        return _Decision(
            law=gradient,
            found=found,
            nominal_burns=bool(np.linalg.norm(nominal) > 0.0),
            probability=float(made.mean()),
            away=away[0][made].mean(axis=0) - float(tick) * self.loop.scenario.tick_s if np.any(made) else np.zeros(2),
        )

    def _seen(self) -> np.ndarray:
        """Which frames of the next period may have a box: missed ones, and look-aways for burns, come at their rate.

        A run may burn where the nominal one does not; how likely that is, the decision before tells.
        """
        static, camera = self.loop.scenario, self.file.camera
        seen = np.ones(static.formation_ticks, dtype=bool)
        rate = 1.0 - (1.0 - camera.miss_probability) * (1.0 - camera.outlier_probability)
        for tick in range(len(seen)):
            self.missed += rate
            seen[tick] = self.missed < 1.0
            self.missed -= 0.0 if seen[tick] else 1.0
        if self.last is not None and not self.last.nominal_burns:
            self.owed += self.last.probability
            if self.owed >= 1.0:
                self.owed -= 1.0
                times = np.arange(len(seen)) * static.tick_s
                seen &= (times < self.last.away[0]) | (times >= self.last.away[1])
        return seen

    def _carry(self, moments: Moment, derivatives: np.ndarray, decision: "_Decision") -> None:
        size, sigma = self.loop.layout.size, self.sigma
        middle = round(float(self.loop.params.flight.formation.lead) / self.loop.scenario.tick_s)
        edges = np.asarray(moments.edges)
        nominal = np.asarray(moments.outputs)
        for index, derivative in enumerate(derivatives):
            A, B = derivative[:size, :size].copy(), derivative[:size, size:] * sigma
            C, D = derivative[size:, :size].copy(), derivative[size:, size:] * sigma
            forcing = self._forcing(edges[index])
            pending = self.loop.layout.slices[PENDING]
            A[pending, pending] = np.eye(4)
            added = before = (np.zeros((size, 0)), np.zeros(0, dtype=int))
            if index == middle:
                jump = self.loop.layout.burn_jump()
                before = self._execution(decision)
                A, C = A @ jump, C @ jump
            if index % self.span == 0:
                self._share(C, D, forcing)
            mean_y = nominal[index] + C @ self.mean
            self.mean = A @ self.mean
            if index == 0:
                A[pending] = decision.found.gain @ decision.law[:, :size]
                B = B.copy()
                B[pending] = decision.found.gain @ (decision.law[:, size:] * sigma)
                self.mean[pending] = decision.found.mean
                added = self._decided(decision)
            covariance = self.recursion.step(Tick(A, B, C, D, forcing, *added, *before))
            self.records["mean"].append(mean_y)
            self.records["covariance"].append(covariance)
            if (index + 1) % self.span == 0 or index + 1 == len(derivatives):
                self.recursion.close()
        kept = len(derivatives)
        self.records["nominal"].append(nominal[:kept])
        self.records["sigma"].append(np.asarray(moments.sigma_H)[:kept])
        self.records["seen"].append(np.asarray(moments.seen)[:kept])

    def _share(self, C: np.ndarray, D: np.ndarray, forcing: np.ndarray) -> None:
        columns, noise = self.recursion.shares(C, D, forcing)
        np.add.at(noise, self.column_of, columns.T)
        self.shares.append(noise)

    def _decided(self, decision: "_Decision") -> tuple[np.ndarray, np.ndarray]:
        """What the decision leaves of its input, and the new burn's own execution error."""
        size, slices = self.loop.layout.size, self.loop.layout.slices
        values, vectors = np.linalg.eigh(decision.found.residual)
        columns = np.zeros((size, 8))
        columns[slices[PENDING], :4] = vectors * np.sqrt(np.maximum(values, 0.0))
        thruster = self.loop.params.plant.thruster
        columns[slices["burn_error.magnitude"], 4] = float(thruster.magnitude_noise)
        columns[slices["burn_error.direction"], 5:] = float(thruster.direction_noise) * np.eye(3)
        decided, burn = (self._number[name] for name in (linear_sources.DECISION, linear_sources.BURN))
        return columns, np.array([decided] * 4 + [burn] * 4)

    def _execution(self, decision: "_Decision") -> tuple[np.ndarray, np.ndarray]:
        """Execution error of what burns differ from the nominal one; that one's own is in the derivative."""
        burns = decision.found.outputs[:, :3]
        moment = burns.T @ burns / len(burns)
        along = self._variance("plant.thruster.force_scale", 1.0) + self._variance(
            "truth.mass", float(self.loop.params.plant.servicer.mass)
        )
        across = self._variance("plant.thruster.misalignment", 1.0) + self._variance("star_tracker.misalignment", 1.0)
        thruster = self.loop.params.plant.thruster
        along += float(thruster.magnitude_noise) ** 2
        across += float(thruster.direction_noise) ** 2
        covariance = along * moment + across * (np.trace(moment) * np.eye(3) - moment)
        values, vectors = np.linalg.eigh(covariance)
        columns = np.zeros((self.loop.layout.size, 3))
        columns[self.loop.layout.slices["truth.v_ST_N"]] = vectors * np.sqrt(np.maximum(values, 0.0))
        return columns, np.full(3, self._number[linear_sources.BURN])

    def _variance(self, name: str, scale: float) -> float:
        """Mean variance of the components of a number over a scale, from what it started with."""
        part = self.loop.layout.slices.get(name)
        if part is None:
            return 0.0
        return float(np.mean(np.sum(self.recursion.columns[part] ** 2, axis=1))) / scale**2

    def result(self, run_s: float, run_cpu_s: float) -> LinearCovariance:
        """What was found."""
        static = self.loop.scenario
        probability, sizes = np.array(self.decisions).T
        time_s = np.arange(static.ticks) * static.tick_s
        return LinearCovariance(
            time_s=time_s,
            nominal=np.concatenate(self.records["nominal"]),
            mean=np.array(self.records["mean"]),
            covariance=np.array(self.records["covariance"]),
            filter_sigma_H=np.concatenate(self.records["sigma"]),
            seen=np.concatenate(self.records["seen"]),
            sources=self.sources,
            left_out=self.left_out,
            share_time_s=time_s[:: self.span],
            shares=np.array(self.shares),
            burn_probability=probability,
            burn_size_m_s=sizes,
            compile_s=self.compiled.compile_s,
            run_s=run_s,
            run_cpu_s=run_cpu_s,
        )


@dataclass(frozen=True)
class _Decision:
    """A burn decision, linearised.

    Attributes:
        law: (3, size + inputs) derivative of the control law's output
        found: the decision from that output to velocity change and its size, less the nominal ones
        nominal_burns: the nominal run makes a burn
        probability: of a burn
        away: (2,) from when to when a run that burns looks away, from the decision on [s]
    """

    law: np.ndarray
    found: describing_function.Linearised
    nominal_burns: bool
    probability: float
    away: np.ndarray
