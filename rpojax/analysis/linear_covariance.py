"""Linear covariance of the whole closed loop: mean and spread at every second from one nominal run, without sampling.

The derivative of the loop's tick along the nominal run carries the covariance of truth, estimate and flight software
together (Geller, "Linear covariance techniques for orbital rendezvous analysis and autonomous onboard mission
planning", Journal of Guidance, Control and Dynamics 29, 2006). Three things that a derivative does not tell are put in
otherwise: burn decisions by their describing function, the target's attitude by an ensemble of outlines, and boxes that
are missed or given up for a burn by leaving them out of the nominal run at their rate.
"""

import dataclasses
import math
import time
from concurrent.futures import Future, ThreadPoolExecutor
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
HOLD = 5
"""Ticks that one derivative stands for once the transfer is over."""
_SAMPLES_POWER = 10
"""Two to this power is the number of points of a describing function."""
_SPAN = 10
"""Shares of the sources are looked at once in so many ticks, or less."""


@dataclass(frozen=True)
class LinearCovariance:
    """What a linear covariance tells.

    Attributes:
        time_s: (ticks,)
        nominal: (ticks, 19) outputs of the nominal runs, as `linear_loop.OUTPUTS`
        mean: (ticks, 19) of all runs
        covariance: (ticks, 19, 19)
        filter_sigma_H: (ticks, 3) of the relative position in the nominal filter [m]
        seen: (ticks,) share of the nominal runs whose filter used a box
        sources: names of what makes runs differ
        left_out: names of dispersions whose effect is not in it
        share_time_s: (spans,)
        shares: (spans, sources, 19) variance that comes of each source
        burn_probability: (decisions,) of a burn at each decision
        burn_size_m_s: (decisions,) mean size of its velocity change
        compile_s: compilation, and what is worked out at the start [s]
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


def analyse(
    file: ScenarioFile, members: int = MEMBERS, hold: int = HOLD, stages: Stages | None = None
) -> LinearCovariance:
    """Linear covariance of a scenario with an ensemble of so many targets.

    After the transfer, one derivative stands for up to `hold` ticks.

    Raises:
        RpojaxError: as `check` does.
    """
    check(file)
    begin = time.perf_counter()
    setup = _Setup(file, members, stages or Stages())
    compiled = time.perf_counter()
    begin_cpu = time.process_time()
    records = _fly(setup, hold)
    run_s, run_cpu_s = time.perf_counter() - compiled, time.process_time() - begin_cpu
    return _result(setup, records, compiled - begin, run_s, run_cpu_s)


def _fly(setup: "_Setup", hold: int) -> "list[_Record]":
    """All burn periods, on both sides of the mean run until their burns are over, then on one."""
    static = setup.loop.scenario
    records: list[_Record] = []
    # The recursion along one period goes on beside the nominal run of the next.
    with ThreadPoolExecutor(2) as pool:
        sides = [_Side(setup, start, hold, pool) for start in setup.starts]
        waiting: list[list[Future[_Record]]] = []
        for first in range(0, static.ticks, static.formation_ticks):
            kept = min(static.formation_ticks, static.ticks - first)
            waiting.append([side.period(kept) for side in sides])
            if len(sides) == 2 and all(side.arrived for side in sides):
                sides = [_merge(sides)]
        for futures in waiting:
            records.append(_average([future.result() for future in futures]))
    return records


class _Setup:
    """What the nominal runs have in common."""

    def __init__(self, file: ScenarioFile, members: int, stages: Stages) -> None:
        self.file = file
        found = linear_sources.disperse(file)
        self.left_out = found.left_out
        static = scenario.static(file)
        base = params.build(file.model_dump(), static.width_px, static.height_px)
        self.edge_noise_px = float(base.camera.edge_noise)
        centre = dispersions.apply(base, {key: jnp.asarray(value) for key, value in found.mean.items()})
        centre = replace(centre, camera=replace(centre.camera, edge_noise=jnp.ones((), dtype=jnp.float64)))
        key = closed_loop.run_key(0, 0)
        state = jax.eval_shape(lambda: closed_loop.init(static, centre, key))
        self.loop = Loop(static, centre, layout(state, centre, found.constants()), stages)
        self.starts = linear_sources.starts(static, centre, self.loop.layout, key, found)
        self.tumble = outlines.start(file, base, members)
        self.points = describing_function.normal_points(3, _SAMPLES_POWER)
        self.compiled = Compiled(self.loop, self.starts[0].state, self.tumble, len(self.points))
        self.sources = linear_sources.names(self.starts[0].columns)
        self.number = {name: number for number, name in enumerate(self.sources)}
        self.sigma = self.loop.inputs.sigma(self.edge_noise_px)
        self.span = max(span for span in range(1, _SPAN + 1) if static.formation_ticks % span == 0)


class _Side:
    """The recursion along one nominal run, burn period by burn period."""

    def __init__(self, setup: _Setup, start: linear_sources.Start, hold: int, pool: ThreadPoolExecutor) -> None:
        self.setup, self.hold, self.pool = setup, hold, pool
        self.file, self.loop, self.compiled, self.sigma = setup.file, setup.loop, setup.compiled, setup.sigma
        self.state, self.tumble, self.mean = start.state, setup.tumble, start.mean
        size, count = setup.loop.layout.size, len(setup.tumble.q_TN)
        columns = [*start.columns.values(), np.zeros((size, count))]
        self.recursion = Recursion(
            columns=np.concatenate(columns, axis=1),
            noise=np.zeros((len(setup.sources), size, size)),
            noise_of=self._noise_of(),
        )
        owners = [setup.number[name] for name in (*start.columns, linear_sources.OUTLINE)]
        self.column_of = np.repeat(owners, [each.shape[1] for each in columns])
        # Factors of the outlines' deviations in the columns.
        self.driven = np.concatenate([np.zeros((count, self.column_of.size - count)), np.eye(count)], axis=1)
        self.missed, self.owed = 0.0, 0.0
        self.last: _Decision | None = None
        # Whether the nominal run burns in this period, has burned at all, and has then stopped.
        self.burned, self.moved, self.arrived = True, False, False
        self.carried: Future[_Record] | None = None

    def _noise_of(self) -> np.ndarray:
        inputs = self.loop.inputs
        numbers = np.zeros(inputs.size, dtype=int)
        for name, part in inputs.parts.items():
            numbers[part] = self.setup.number[name]
        return numbers

    def period(self, count: int) -> "Future[_Record]":
        """The next burn period, of which the first `count` ticks count; what it gives is still being worked out."""
        seen = self._seen()
        self.state, self.tumble, moments = self.compiled.period(self.state, self.tumble, seen)
        keys = self._keys(moments, count)
        ticks = np.unique(keys)
        derivatives = self.compiled.derivatives(moments, ticks)
        self.wait()
        self.last = self._decide(moments, derivatives[0])
        burned, self.burned = self.burned, bool(np.any(self.last.nominal))
        self.arrived = self.arrived or (burned and not self.burned and self.moved)
        self.moved = self.moved or self.burned
        self.carried = self.pool.submit(self._carry, moments, derivatives, np.searchsorted(ticks, keys), self.last)
        return self.carried

    def wait(self) -> None:
        """Until the recursion has come to the end of the period before."""
        if self.carried is not None:
            self.carried.result()

    def _keys(self, moments: Moment, count: int) -> np.ndarray:
        """For each of the period's first `count` ticks the one whose derivative stands for it.

        Once the transfer is over little changes from tick to tick while the camera looks on and boxes come: then one
        derivative in a few is enough.
        """
        keys = np.arange(count)
        burns = np.any(np.asarray(moments.memory.plan.delta_v_N[0]))
        if self.hold == 1 or not self.arrived or burns:
            return keys
        seen, quiet = np.asarray(moments.seen), np.asarray(moments.quiet)
        for tick in range(2, count):
            key = keys[tick - 1]
            alike = quiet[tick] and quiet[key] and seen[tick] == seen[key]
            if key > 0 and alike and tick - key < self.hold:
                keys[tick] = key
        return keys

    def _forcing(self, edges: np.ndarray) -> np.ndarray:
        """(inputs, columns) of the outlines (members, 4) [px], as multiples of the inputs' sigmas."""
        forcing = np.zeros((len(self.sigma), self.driven.shape[1]))
        scale = self.setup.edge_noise_px * math.sqrt(len(edges))
        forcing[self.loop.inputs.parts[linear_sources.BOX]] = edges.T @ self.driven / scale
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

        found = describing_function.linearise(burn, mean, covariance, self.setup.points)
        sizes = found.outputs[:, 3] + np.linalg.norm(nominal)
        made = sizes > 0.0
        return _Decision(
            law=gradient,
            found=found,
            burns=found.outputs[:, :3] + nominal,
            nominal=nominal,
            probability=float(made.mean()),
            size=float(sizes.mean()),
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
        if self.last is not None and not np.any(self.last.nominal):
            self.owed += self.last.probability
            if self.owed >= 1.0:
                self.owed -= 1.0
                times = np.arange(len(seen)) * static.tick_s
                seen &= (times < self.last.away[0]) | (times >= self.last.away[1])
        return seen

    def _carry(self, moments: Moment, derivatives: np.ndarray, rows: np.ndarray, decision: "_Decision") -> "_Record":
        """The recursion along one period."""
        size, sigma = self.loop.layout.size, self.sigma
        middle = round(float(self.loop.params.flight.formation.lead) / self.loop.scenario.tick_s)
        edges = np.asarray(moments.edges)
        nominal = np.asarray(moments.outputs)
        means, covariances, shares = [], [], []
        for index, row in enumerate(rows):
            derivative = derivatives[row]
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
            mean_y = nominal[index] + C @ self.mean
            self.mean = A @ self.mean
            if index == 0:
                A[pending] = decision.found.gain @ decision.law[:, :size]
                B = B.copy()
                B[pending] = decision.found.gain @ (decision.law[:, size:] * sigma)
                self.mean[pending] = decision.found.mean
                added = self._decided(decision)
            tick = Tick(A, B, C, D, forcing, *added, *before)
            if index % self.setup.span == 0:
                shares.append(self._share(tick))
            covariance = self.recursion.step(tick)
            means.append(mean_y)
            covariances.append(covariance)
            if (index + 1) % self.setup.span == 0 or index + 1 == len(rows):
                self.recursion.close()
        kept = len(rows)
        return _Record(
            nominal=nominal[:kept],
            mean=np.array(means),
            covariance=np.array(covariances),
            filter_variance_H=np.asarray(moments.sigma_H)[:kept].astype(np.float64) ** 2,
            seen=np.asarray(moments.seen)[:kept].astype(np.float64),
            shares=np.array(shares),
            decision=np.array([decision.probability, decision.size]),
        )

    def _share(self, tick: Tick) -> np.ndarray:
        columns, noise = self.recursion.shares(tick)
        np.add.at(noise, self.column_of, columns.T)
        return noise

    def _decided(self, decision: "_Decision") -> tuple[np.ndarray, np.ndarray]:
        """What the decision leaves of its input."""
        columns = np.zeros((self.loop.layout.size, 4))
        columns[self.loop.layout.slices[PENDING]] = _root(decision.found.residual)
        return columns, np.full(4, self.setup.number[linear_sources.DECISION])

    def _execution(self, decision: "_Decision") -> tuple[np.ndarray, np.ndarray]:
        """Execution error of the nominal burn, or where there is none, of the burns that runs make.

        A run whose burn is a percent too strong in some direction also moves in that direction, and takes a percent
        more of range for it; along a nominal run that moves otherwise the same error would do more. So the error is
        that of the nominal burn, and what lasts from burn to burn is then in the derivative. Without a nominal burn the
        burns go in all directions, and what lasts counts like noise.
        """
        nominal = np.any(decision.nominal)
        burns = decision.nominal[None, :] if nominal else decision.burns
        moment = burns.T @ burns / len(burns)
        beyond = np.zeros((3, 3)) if nominal else moment
        thruster = self.loop.params.plant.thruster
        mass = float(self.loop.params.plant.servicer.mass)
        along = self._variance("plant.thruster.force_scale") + self._variance("truth.mass") / mass**2
        across = self._variance("plant.thruster.misalignment") + self._variance("star_tracker.misalignment")
        covariance = _spread(moment, float(thruster.magnitude_noise) ** 2, float(thruster.direction_noise) ** 2)
        covariance = covariance + _spread(beyond, along, across)
        columns = np.zeros((self.loop.layout.size, 3))
        columns[self.loop.layout.slices["truth.v_ST_N"]] = _root(covariance)
        return columns, np.full(3, self.setup.number[linear_sources.BURN])

    def _variance(self, name: str) -> float:
        """Mean variance of the components of a number, from what it started with."""
        part = self.loop.layout.slices.get(name)
        if part is None:
            return 0.0
        return float(np.mean(np.sum(self.recursion.columns[part] ** 2, axis=1)))


@dataclass(frozen=True)
class _Record:
    """What a period gives; fields as those of `LinearCovariance`, and the decision's probability and size of a burn."""

    nominal: np.ndarray
    mean: np.ndarray
    covariance: np.ndarray
    filter_variance_H: np.ndarray
    seen: np.ndarray
    shares: np.ndarray
    decision: np.ndarray


def _average(records: list[_Record]) -> _Record:
    names = [each.name for each in dataclasses.fields(_Record)]
    return _Record(**{name: np.mean([getattr(record, name) for record in records], axis=0) for name in names})


def _merge(sides: list[_Side]) -> _Side:
    """One side that goes on with the mean covariance of two, along the first one's nominal run."""
    for side in sides:
        side.wait()
    one, other = sides
    layout, params = one.loop.layout, one.loop.params
    places = [np.asarray(layout.pack(side.state, params)) for side in sides]
    sign = layout.signs(*places)
    one.mean = 0.5 * (one.mean + sign * (places[1] + other.mean) - places[0])
    half = math.sqrt(0.5)
    columns = np.concatenate([one.recursion.columns, sign[:, None] * other.recursion.columns], axis=1)
    noise = 0.5 * (one.recursion.noise + np.outer(sign, sign) * other.recursion.noise)
    one.recursion = Recursion(columns=half * columns, noise=noise, noise_of=one.recursion.noise_of)
    one.column_of = np.concatenate([one.column_of, other.column_of])
    one.driven = half * np.concatenate([one.driven, other.driven], axis=1)
    return one


def _result(
    setup: _Setup, records: list[_Record], compile_s: float, run_s: float, run_cpu_s: float
) -> LinearCovariance:
    static = setup.loop.scenario
    time_s = np.arange(static.ticks) * static.tick_s

    def joined(name: str) -> np.ndarray:
        return np.concatenate([getattr(record, name) for record in records])

    decisions = np.array([record.decision for record in records])
    return LinearCovariance(
        time_s=time_s,
        nominal=joined("nominal"),
        mean=joined("mean"),
        covariance=joined("covariance"),
        filter_sigma_H=np.sqrt(joined("filter_variance_H")),
        seen=joined("seen"),
        sources=setup.sources,
        left_out=setup.left_out,
        share_time_s=time_s[:: setup.span],
        shares=joined("shares"),
        burn_probability=decisions[:, 0],
        burn_size_m_s=decisions[:, 1],
        compile_s=compile_s,
        run_s=run_s,
        run_cpu_s=run_cpu_s,
    )


@dataclass(frozen=True)
class _Decision:
    """A burn decision, linearised.

    Attributes:
        law: (3, size + inputs) derivative of the control law's output
        found: the decision from that output to velocity change and its size, less the nominal ones
        burns: (samples, 3) velocity changes that runs make [m/s]
        nominal: (3,) that of the nominal run
        probability: of a burn
        size: mean size of its velocity change [m/s]
        away: (2,) from when to when a run that burns looks away, from the decision on [s]
    """

    law: np.ndarray
    found: describing_function.Linearised
    burns: np.ndarray
    nominal: np.ndarray
    probability: float
    size: float
    away: np.ndarray


def _root(covariance: np.ndarray) -> np.ndarray:
    """Columns (n, n) of unit variance that make up a covariance."""
    values, vectors = np.linalg.eigh(covariance)
    return vectors * np.sqrt(np.maximum(values, 0.0))


def _spread(moment: np.ndarray, along: float, across: float) -> np.ndarray:
    """Covariance (3, 3) of errors of burns with the given second moment: shares along them, and across per axis."""
    return along * moment + across * (np.trace(moment) * np.eye(3) - moment)
