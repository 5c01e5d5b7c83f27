"""Covariance recursion along one nominal run, burn period by burn period.

Covariance recursion of a linear time-varying system, source by source: `x' = A x + B w`, `y = C x + D w`.

Initial deviations and the ensemble of outlines are columns, `x = X z`, with one `z` for the whole run; white noise has
a covariance per source. Both are propagated from the start of one span of ticks to that of the next. In between, the
transition matrix and the responses to the noise since the start of the span give the covariance.
"""

import dataclasses
import math
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field

import numpy as np

from rpojax.analysis.linear_covariance.analysis_setup import AnalysisSetup
from rpojax.analysis.linear_covariance.burn_decision import (
    BoxSchedule,
    BurnDecision,
    covariance_root,
    execution_error_columns,
    linearise_decision,
)
from rpojax.analysis.linear_covariance.linearisation import deviation_vector
from rpojax.analysis.linear_covariance.linearisation.deviation_vector import PENDING_BURN
from rpojax.analysis.linear_covariance.linearisation.dispersion_linearisation import InitialCondition
from rpojax.analysis.linear_covariance.linearisation.linearised_loop import OUTPUTS, LinearisationPoint

_MAX_TRANSFER_HOLD_TICKS = 3
"""Most ticks that share one Jacobian during the transfer."""


@dataclass(frozen=True)
class TickSystem:
    """Matrices of one tick of the system.

    Attributes:
        A: (n, n)
        B: (n, w) response to the tick's random numbers, scaled to unit variance
        C: (y, n)
        D: (y, w) scaled likewise
        forcing: (w, columns) the tick's random numbers in terms of the ensemble's columns
        added: (n, k) further noise columns of unit variance that enter with the tick
        added_source: (k,) indices of their sources
        before: (n, j) noise columns of unit variance that entered just before the tick; A and C act on them
        before_source: (j,) indices of their sources
    """

    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    D: np.ndarray
    forcing: np.ndarray
    added: np.ndarray
    added_source: np.ndarray
    before: np.ndarray
    before_source: np.ndarray


@dataclass
class CovarianceRecursion:
    """Covariance up to the present tick.

    Attributes:
        columns: (n, c) at the start of the span
        noise: (sources, n, n) covariance at the start of the span
        noise_source: (w,) index of the source of each of a tick's random numbers
    """

    columns: np.ndarray
    noise: np.ndarray
    noise_source: np.ndarray
    _transition: np.ndarray = field(init=False)
    _responses: np.ndarray = field(init=False)
    _responses_source: np.ndarray = field(init=False)
    _forced: np.ndarray = field(init=False)
    _forcing: np.ndarray = field(init=False)
    _total: np.ndarray = field(init=False)

    def __post_init__(self) -> None:
        self._begin()

    def _begin(self) -> None:
        size = len(self.columns)
        self._transition = np.eye(size)
        self._responses, self._responses_source = np.zeros((size, 0)), np.zeros(0, dtype=int)
        self._forced, self._forcing = np.zeros((size, 0)), np.zeros((0, self.columns.shape[1]))
        self._total = self.noise.sum(axis=0)

    def output_covariance(self, C: np.ndarray, D: np.ndarray, forcing: np.ndarray) -> np.ndarray:
        """Covariance (y, y) of `C x + D w` at the present tick."""
        columns, noise, responses = self._output_factors(C)
        columns = columns + D @ forcing
        return columns @ columns.T + noise @ (C @ self._transition).T + responses @ responses.T + D @ D.T

    def _output_factors(self, C: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        output_transition = C @ self._transition
        columns = output_transition @ self.columns + (C @ self._forced) @ self._forcing
        return columns, output_transition @ self._total, C @ self._responses

    def variance_shares(self, tick: TickSystem) -> tuple[np.ndarray, np.ndarray]:
        """Variances of a tick's outputs at the start of a span: (y, c) of each column, (sources, y) of the noise."""
        columns = (tick.C @ self.columns + tick.D @ tick.forcing) ** 2
        noise = np.sum((tick.C @ self.noise) * tick.C, axis=2)
        np.add.at(noise, self.noise_source, (tick.D**2).T)
        np.add.at(noise, tick.before_source, ((tick.C @ tick.before) ** 2).T)
        return columns, noise

    def step(self, tick: TickSystem) -> np.ndarray:
        """Covariance (y, y) of the tick's outputs; advances to the next tick."""
        if tick.before.shape[1]:
            self._responses = np.concatenate([self._responses, tick.before], axis=1)
            self._responses_source = np.concatenate([self._responses_source, tick.before_source])
        found = self.output_covariance(tick.C, tick.D, tick.forcing)
        self._transition = tick.A @ self._transition
        self._responses = np.concatenate([tick.A @ self._responses, tick.B, tick.added], axis=1)
        self._responses_source = np.concatenate([self._responses_source, self.noise_source, tick.added_source])
        driven = np.any(tick.forcing != 0.0, axis=1)
        self._forced = np.concatenate([tick.A @ self._forced, tick.B[:, driven]], axis=1)
        self._forcing = np.concatenate([self._forcing, tick.forcing[driven]])
        return found

    def end_span(self) -> None:
        """Ends the span."""
        self.columns = self._transition @ self.columns + self._forced @ self._forcing
        self.noise = self._transition @ self.noise @ self._transition.T
        for source in np.unique(self._responses_source):
            own = self._responses[:, self._responses_source == source]
            self.noise[source] += own @ own.T
        self._begin()


@dataclass(frozen=True)
class PeriodRecord:
    """Results of one burn period; fields as in `LinearCovariance`, and the decision's probability and burn size."""

    nominal: np.ndarray
    mean: np.ndarray
    covariance: np.ndarray
    filter_variance_H: np.ndarray
    box_fraction: np.ndarray
    shares: np.ndarray
    decision: np.ndarray


class NominalRecursion:
    """Covariance recursion along one nominal run.

    Attributes:
        arrived: the nominal run's transfer is over: it has burned, and then stopped
    """

    def __init__(
        self, setup: AnalysisSetup, initial: InitialCondition, max_hold_ticks: int, pool: ThreadPoolExecutor
    ) -> None:
        self.setup, self.max_hold_ticks, self.pool = setup, max_hold_ticks, pool
        self.loop, self.compiled, self.sigma = setup.loop, setup.compiled, setup.noise_sigma
        self.state, self.ensemble, self.mean = initial.state, setup.ensemble, initial.mean_offset
        self.box_schedule = BoxSchedule(setup.loop.scenario, setup.file.camera)
        size, members = setup.loop.layout.size, len(setup.ensemble.q_TN)
        columns = [*initial.columns.values(), np.zeros((size, members))]
        self.recursion = CovarianceRecursion(
            columns=np.concatenate(columns, axis=1),
            noise=np.zeros((len(setup.noise_sources), size, size)),
            noise_source=self._noise_source(),
        )
        sources = [setup.source_index[name] for name in (*initial.columns, deviation_vector.OUTLINE)]
        self.column_source = np.repeat(sources, [column.shape[1] for column in columns])
        # Factors (members, columns) of the outlines' deviations in the columns.
        other_columns = self.column_source.size - members
        self.outline_columns = np.concatenate([np.zeros((members, other_columns)), np.eye(members)], axis=1)
        self.last_decision: BurnDecision | None = None
        self.burned, self.moved, self.arrived = True, False, False
        self.pending: Future[PeriodRecord] | None = None

    def _noise_source(self) -> np.ndarray:
        vector = self.loop.noise_vector
        sources = np.zeros(vector.size, dtype=int)
        for name, part in vector.slices.items():
            sources[part] = self.setup.noise_sources.index(name)
        return sources

    def advance_period(self, count: int) -> Future[PeriodRecord]:
        """Simulates the next burn period and propagates its first `count` ticks in the background."""
        box_allowed = self.box_schedule.next_period(self.last_decision)
        self.state, self.ensemble, points = self.compiled.simulate_period(self.state, self.ensemble, box_allowed)
        jacobian_of = self._jacobian_ticks(points, count)
        ticks = np.unique(jacobian_of)
        jacobians = self.compiled.jacobians(points, ticks)
        self.wait()
        self.last_decision = self._decide(points, jacobians[0])
        burned, self.burned = self.burned, bool(np.any(self.last_decision.nominal_burn))
        self.arrived = self.arrived or (burned and not self.burned and self.moved)
        self.moved = self.moved or self.burned
        rows = np.searchsorted(ticks, jacobian_of)
        self.pending = self.pool.submit(self._propagate, points, jacobians, rows, self.last_decision)
        return self.pending

    def wait(self) -> None:
        """Blocks until the recursion has reached the end of the period before."""
        if self.pending is not None:
            self.pending.result()

    def _jacobian_ticks(self, points: LinearisationPoint, count: int) -> np.ndarray:
        """For each of the period's first `count` ticks the one whose Jacobian is used.

        From the second decision on little changes from tick to tick while the camera is on the target and boxes come:
        then some ticks share one Jacobian, and more of them when the transfer is over.
        """
        ticks = np.arange(count)
        burns = np.any(np.asarray(points.memory.plan.delta_v_N[0]))
        transfer_hold = min(self.max_hold_ticks, _MAX_TRANSFER_HOLD_TICKS)
        hold = self.max_hold_ticks if self.arrived and not burns else transfer_hold
        if self.last_decision is None:
            return ticks
        box_used, on_target = np.asarray(points.box_used), np.asarray(points.on_target)
        for tick in range(2, count):
            shared = ticks[tick - 1]
            alike = on_target[tick] and on_target[shared] and box_used[tick] == box_used[shared]
            if shared > 0 and alike and tick - shared < hold:
                ticks[tick] = shared
        return ticks

    def _forcing(self, edges: np.ndarray) -> np.ndarray:
        """(inputs, columns) of the outlines' deviations (members, 4) [px], as multiples of the inputs' sigmas."""
        forcing = np.zeros((len(self.sigma), self.outline_columns.shape[1]))
        scale = self.setup.edge_noise_px * math.sqrt(len(edges))
        forcing[self.loop.noise_vector.slices[deviation_vector.BOX]] = edges.T @ self.outline_columns / scale
        return forcing

    def _decide(self, points: LinearisationPoint, jacobian: np.ndarray) -> BurnDecision:
        """The burn decision at the first of the linearisation points, with that Jacobian."""
        size = self.loop.layout.size
        gradient = jacobian[size:][OUTPUTS["command_H"]]
        U, V = gradient[:, :size], gradient[:, size:]
        forcing = self._forcing(np.asarray(points.edge_deviations[0]))
        covariance = self.recursion.output_covariance(U, V * self.sigma, forcing)
        mean = np.asarray(points.outputs[0])[OUTPUTS["command_H"]] + U @ self.mean
        return linearise_decision(self.compiled, points, gradient, mean, covariance, self.setup.normal_points)

    def _propagate(
        self, points: LinearisationPoint, jacobians: np.ndarray, rows: np.ndarray, decision: BurnDecision
    ) -> PeriodRecord:
        """Advances the recursion by one period; `rows` (ticks,) select the Jacobians."""
        middle = round(float(self.loop.params.flight.formation.lead) / self.loop.scenario.tick_s)
        edges = np.asarray(points.edge_deviations)
        nominal = np.asarray(points.outputs)
        means, covariances, shares = [], [], []
        for index, row in enumerate(rows):
            jump = decision if index == middle else None
            made = decision if index == 0 else None
            tick, deviation = self._advance_mean(jacobians[row], self._forcing(edges[index]), jump, made)
            if index % self.setup.span_ticks == 0:
                shares.append(self._variance_shares(tick))
            covariance = self.recursion.step(tick)
            means.append(nominal[index] + deviation)
            covariances.append(covariance)
            if (index + 1) % self.setup.span_ticks == 0 or index + 1 == len(rows):
                self.recursion.end_span()
        kept = len(rows)
        return PeriodRecord(
            nominal=nominal[:kept],
            mean=np.array(means),
            covariance=np.array(covariances),
            filter_variance_H=np.asarray(points.sigma_H)[:kept].astype(np.float64) ** 2,
            box_fraction=np.asarray(points.box_used)[:kept].astype(np.float64),
            shares=np.array(shares),
            decision=np.array([decision.probability, decision.mean_size]),
        )

    def _advance_mean(
        self, jacobian: np.ndarray, forcing: np.ndarray, jump: BurnDecision | None, made: BurnDecision | None
    ) -> tuple[TickSystem, np.ndarray]:
        """Linear system of one tick, and the mean deviation (19,) of its outputs; advances the mean state.

        `jump` is the decision whose burn has its middle at this tick, `made` the decision made at it.
        """
        size, sigma = self.loop.layout.size, self.sigma
        A, B = jacobian[:size, :size].copy(), jacobian[:size, size:] * sigma
        C, D = jacobian[size:, :size].copy(), jacobian[size:, size:] * sigma
        pending = self.loop.layout.slices[PENDING_BURN]
        A[pending, pending] = np.eye(4)
        added = before = (np.zeros((size, 0)), np.zeros(0, dtype=int))
        if jump is not None:
            burn_jump = self.loop.layout.burn_jump()
            before = self._execution_errors(jump)
            A, C = A @ burn_jump, C @ burn_jump
        deviation = C @ self.mean
        self.mean = A @ self.mean
        if made is not None:
            gain = made.linearisation.gain
            A[pending] = gain @ made.command_jacobian[:, :size]
            B[pending] = gain @ (made.command_jacobian[:, size:] * sigma)
            self.mean[pending] = made.linearisation.mean
            added = self._decision_residual(made)
        return TickSystem(A, B, C, D, forcing, *added, *before), deviation

    def _variance_shares(self, tick: TickSystem) -> np.ndarray:
        columns, noise = self.recursion.variance_shares(tick)
        shares = np.zeros((len(self.setup.sources), noise.shape[1]))
        np.add.at(shares, [self.setup.source_index[name] for name in self.setup.noise_sources], noise)
        np.add.at(shares, self.column_source, columns.T)
        return shares

    def _decision_residual(self, decision: BurnDecision) -> tuple[np.ndarray, np.ndarray]:
        """Noise columns of the decision's residual, and their sources."""
        columns = np.zeros((self.loop.layout.size, 4))
        columns[self.loop.layout.slices[PENDING_BURN]] = covariance_root(decision.linearisation.residual)
        return columns, np.full(4, self.setup.noise_sources.index(deviation_vector.DECISION))

    def _execution_errors(self, decision: BurnDecision) -> tuple[np.ndarray, np.ndarray]:
        """Noise columns of the execution errors of the decided burns, and their sources."""
        mass = float(self.loop.params.plant.servicer.mass)
        along = self._initial_variance("plant.thruster.force_scale") + self._initial_variance("truth.mass") / mass**2
        across = self._initial_variance("plant.thruster.misalignment") + self._initial_variance(
            "star_tracker.misalignment"
        )
        columns = np.zeros((self.loop.layout.size, 3))
        columns[self.loop.layout.slices["truth.v_ST_N"]] = execution_error_columns(
            decision, self.loop.params.plant.thruster, along, across
        )
        return columns, np.full(3, self.setup.noise_sources.index(deviation_vector.BURN))

    def _initial_variance(self, name: str) -> float:
        """Mean variance of the components of a number that comes from its initial dispersion."""
        part = self.loop.layout.slices.get(name)
        if part is None:
            return 0.0
        return float(np.mean(np.sum(self.recursion.columns[part] ** 2, axis=1)))


def average_records(records: list[PeriodRecord]) -> PeriodRecord:
    """Mean of the records of one period over the nominal runs."""
    names = [each.name for each in dataclasses.fields(PeriodRecord)]
    return PeriodRecord(**{name: np.mean([getattr(record, name) for record in records], axis=0) for name in names})


def merge_recursions(recursions: list[NominalRecursion]) -> NominalRecursion:
    """A recursion with the mean covariance of two, along the first one's nominal run."""
    for each in recursions:
        each.wait()
    one, other = recursions
    layout, params = one.loop.layout, one.loop.params
    nominal = [np.asarray(layout.pack(recursion.state, params)) for recursion in recursions]
    sign = layout.quaternion_signs(*nominal)
    one.mean = 0.5 * (one.mean + sign * (nominal[1] + other.mean) - nominal[0])
    half = math.sqrt(0.5)
    columns = np.concatenate([one.recursion.columns, sign[:, None] * other.recursion.columns], axis=1)
    noise = 0.5 * (one.recursion.noise + np.outer(sign, sign) * other.recursion.noise)
    one.recursion = CovarianceRecursion(columns=half * columns, noise=noise, noise_source=one.recursion.noise_source)
    one.column_source = np.concatenate([one.column_source, other.column_source])
    one.outline_columns = half * np.concatenate([one.outline_columns, other.outline_columns], axis=1)
    return one
