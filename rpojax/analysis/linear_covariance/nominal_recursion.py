"""The recursion along one nominal run of a linear covariance, burn period by burn period."""

import dataclasses
import math
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np

from rpojax.analysis.linear_covariance import initial_conditions, tick_noise_vector
from rpojax.analysis.linear_covariance.analysis_setup import AnalysisSetup
from rpojax.analysis.linear_covariance.burn_decision import (
    BurnDecision,
    covariance_root,
    execution_error_columns,
    linearise_decision,
)
from rpojax.analysis.linear_covariance.covariance_recursion import CovarianceRecursion, TickSystem
from rpojax.analysis.linear_covariance.deviation_vector import PENDING_BURN
from rpojax.analysis.linear_covariance.linearised_loop import OUTPUTS, LinearisationPoint

_HOLD_UNDER_WAY = 3
"""Ticks that one derivative stands for during the transfer."""


@dataclass(frozen=True)
class PeriodRecord:
    """What a period gives; fields as those of `LinearCovariance`, and the decision's probability and size of a burn."""

    nominal: np.ndarray
    mean: np.ndarray
    covariance: np.ndarray
    filter_variance_H: np.ndarray
    box_fraction: np.ndarray
    shares: np.ndarray
    decision: np.ndarray


class NominalRecursion:
    """The recursion along one nominal run, burn period by burn period."""

    def __init__(
        self, setup: AnalysisSetup, start: initial_conditions.InitialCondition, hold: int, pool: ThreadPoolExecutor
    ) -> None:
        self.setup, self.hold, self.pool = setup, hold, pool
        self.file, self.loop, self.compiled, self.sigma = setup.file, setup.loop, setup.compiled, setup.noise_sigma
        self.state, self.tumble, self.mean = start.state, setup.ensemble, start.mean_offset
        size, count = setup.loop.layout.size, len(setup.ensemble.q_TN)
        columns = [*start.columns.values(), np.zeros((size, count))]
        self.recursion = CovarianceRecursion(
            columns=np.concatenate(columns, axis=1),
            noise=np.zeros((len(setup.noise_sources), size, size)),
            noise_source=self._noise_of(),
        )
        owners = [setup.source_index[name] for name in (*start.columns, tick_noise_vector.OUTLINE)]
        self.column_of = np.repeat(owners, [each.shape[1] for each in columns])
        # Factors of the outlines' deviations in the columns.
        self.driven = np.concatenate([np.zeros((count, self.column_of.size - count)), np.eye(count)], axis=1)
        self.missed, self.owed = 0.0, 0.0
        self.last: BurnDecision | None = None
        # Whether the nominal run burns in this period, has burned at all, and has then stopped.
        self.burned, self.moved, self.arrived = True, False, False
        self.carried: Future[PeriodRecord] | None = None

    def _noise_of(self) -> np.ndarray:
        inputs = self.loop.noise_vector
        numbers = np.zeros(inputs.size, dtype=int)
        for name, part in inputs.slices.items():
            numbers[part] = self.setup.noise_sources.index(name)
        return numbers

    def advance_period(self, count: int) -> Future[PeriodRecord]:
        """The next burn period, of which the first `count` ticks count; what it gives is still being worked out."""
        seen = self._seen()
        self.state, self.tumble, moments = self.compiled.simulate_period(self.state, self.tumble, seen)
        keys = self._keys(moments, count)
        ticks = np.unique(keys)
        derivatives = self.compiled.jacobians(moments, ticks)
        self.wait()
        self.last = self._decide(moments, derivatives[0])
        burned, self.burned = self.burned, bool(np.any(self.last.nominal_burn))
        self.arrived = self.arrived or (burned and not self.burned and self.moved)
        self.moved = self.moved or self.burned
        self.carried = self.pool.submit(self._carry, moments, derivatives, np.searchsorted(ticks, keys), self.last)
        return self.carried

    def wait(self) -> None:
        """Until the recursion has come to the end of the period before."""
        if self.carried is not None:
            self.carried.result()

    def _keys(self, moments: LinearisationPoint, count: int) -> np.ndarray:
        """For each of the period's first `count` ticks the one whose derivative stands for it.

        Once there has been a decision little changes from tick to tick while the camera looks on and boxes come: then
        one derivative in a few is enough, and in many when the transfer is over.
        """
        keys = np.arange(count)
        burns = np.any(np.asarray(moments.memory.plan.delta_v_N[0]))
        hold = self.hold if self.arrived and not burns else min(self.hold, _HOLD_UNDER_WAY)
        if self.last is None:
            return keys
        seen, quiet = np.asarray(moments.box_used), np.asarray(moments.on_target)
        for tick in range(2, count):
            key = keys[tick - 1]
            alike = quiet[tick] and quiet[key] and seen[tick] == seen[key]
            if key > 0 and alike and tick - key < hold:
                keys[tick] = key
        return keys

    def _forcing(self, edges: np.ndarray) -> np.ndarray:
        """(inputs, columns) of the outlines (members, 4) [px], as multiples of the inputs' sigmas."""
        forcing = np.zeros((len(self.sigma), self.driven.shape[1]))
        scale = self.setup.edge_noise_px * math.sqrt(len(edges))
        forcing[self.loop.noise_vector.slices[tick_noise_vector.BOX]] = edges.T @ self.driven / scale
        return forcing

    def _decide(self, moments: LinearisationPoint, derivative: np.ndarray) -> BurnDecision:
        """The decision on the first of the moments, where the derivative is `derivative`."""
        size = self.loop.layout.size
        gradient = derivative[size:][OUTPUTS["law_H"]]
        U, V = gradient[:, :size], gradient[:, size:]
        forcing = self._forcing(np.asarray(moments.edge_deviations[0]))
        covariance = self.recursion.output_covariance(U, V * self.sigma, forcing)
        mean = np.asarray(moments.outputs[0])[OUTPUTS["law_H"]] + U @ self.mean
        return linearise_decision(self.compiled, moments, gradient, mean, covariance, self.setup.normal_points)

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
        if self.last is not None and not np.any(self.last.nominal_burn):
            self.owed += self.last.probability
            if self.owed >= 1.0:
                self.owed -= 1.0
                times = np.arange(len(seen)) * static.tick_s
                seen &= (times < self.last.look_away[0]) | (times >= self.last.look_away[1])
        return seen

    def _carry(
        self, moments: LinearisationPoint, derivatives: np.ndarray, rows: np.ndarray, decision: BurnDecision
    ) -> PeriodRecord:
        """The recursion along one period."""
        size, sigma = self.loop.layout.size, self.sigma
        middle = round(float(self.loop.params.flight.formation.lead) / self.loop.scenario.tick_s)
        edges = np.asarray(moments.edge_deviations)
        nominal = np.asarray(moments.outputs)
        means, covariances, shares = [], [], []
        for index, row in enumerate(rows):
            derivative = derivatives[row]
            A, B = derivative[:size, :size].copy(), derivative[:size, size:] * sigma
            C, D = derivative[size:, :size].copy(), derivative[size:, size:] * sigma
            forcing = self._forcing(edges[index])
            pending = self.loop.layout.slices[PENDING_BURN]
            A[pending, pending] = np.eye(4)
            added = before = (np.zeros((size, 0)), np.zeros(0, dtype=int))
            if index == middle:
                jump = self.loop.layout.burn_jump()
                before = self._execution(decision)
                A, C = A @ jump, C @ jump
            mean_y = nominal[index] + C @ self.mean
            self.mean = A @ self.mean
            if index == 0:
                A[pending] = decision.linearisation.gain @ decision.command_jacobian[:, :size]
                B = B.copy()
                B[pending] = decision.linearisation.gain @ (decision.command_jacobian[:, size:] * sigma)
                self.mean[pending] = decision.linearisation.mean
                added = self._decided(decision)
            tick = TickSystem(A, B, C, D, forcing, *added, *before)
            if index % self.setup.span_ticks == 0:
                shares.append(self._share(tick))
            covariance = self.recursion.step(tick)
            means.append(mean_y)
            covariances.append(covariance)
            if (index + 1) % self.setup.span_ticks == 0 or index + 1 == len(rows):
                self.recursion.end_span()
        kept = len(rows)
        return PeriodRecord(
            nominal=nominal[:kept],
            mean=np.array(means),
            covariance=np.array(covariances),
            filter_variance_H=np.asarray(moments.sigma_H)[:kept].astype(np.float64) ** 2,
            box_fraction=np.asarray(moments.box_used)[:kept].astype(np.float64),
            shares=np.array(shares),
            decision=np.array([decision.probability, decision.mean_size]),
        )

    def _share(self, tick: TickSystem) -> np.ndarray:
        columns, noise = self.recursion.variance_shares(tick)
        found = np.zeros((len(self.setup.sources), noise.shape[1]))
        np.add.at(found, [self.setup.source_index[name] for name in self.setup.noise_sources], noise)
        np.add.at(found, self.column_of, columns.T)
        return found

    def _decided(self, decision: BurnDecision) -> tuple[np.ndarray, np.ndarray]:
        """What the decision leaves of its input."""
        columns = np.zeros((self.loop.layout.size, 4))
        columns[self.loop.layout.slices[PENDING_BURN]] = covariance_root(decision.linearisation.residual)
        return columns, np.full(4, self.setup.noise_sources.index(tick_noise_vector.DECISION))

    def _execution(self, decision: BurnDecision) -> tuple[np.ndarray, np.ndarray]:
        """Execution errors of the burns that are decided on."""
        mass = float(self.loop.params.plant.servicer.mass)
        along = self._variance("plant.thruster.force_scale") + self._variance("truth.mass") / mass**2
        across = self._variance("plant.thruster.misalignment") + self._variance("star_tracker.misalignment")
        columns = np.zeros((self.loop.layout.size, 3))
        columns[self.loop.layout.slices["truth.v_ST_N"]] = execution_error_columns(
            decision, self.loop.params.plant.thruster, along, across
        )
        return columns, np.full(3, self.setup.noise_sources.index(tick_noise_vector.BURN))

    def _variance(self, name: str) -> float:
        """Mean variance of the components of a number, from what it started with."""
        part = self.loop.layout.slices.get(name)
        if part is None:
            return 0.0
        return float(np.mean(np.sum(self.recursion.columns[part] ** 2, axis=1)))


def average_records(records: list[PeriodRecord]) -> PeriodRecord:
    """What one period gives in the mean of the nominal runs."""
    names = [each.name for each in dataclasses.fields(PeriodRecord)]
    return PeriodRecord(**{name: np.mean([getattr(record, name) for record in records], axis=0) for name in names})


def merge_recursions(sides: list[NominalRecursion]) -> NominalRecursion:
    """One side that goes on with the mean covariance of two, along the first one's nominal run."""
    for side in sides:
        side.wait()
    one, other = sides
    layout, params = one.loop.layout, one.loop.params
    places = [np.asarray(layout.pack(side.state, params)) for side in sides]
    sign = layout.quaternion_signs(*places)
    one.mean = 0.5 * (one.mean + sign * (places[1] + other.mean) - places[0])
    half = math.sqrt(0.5)
    columns = np.concatenate([one.recursion.columns, sign[:, None] * other.recursion.columns], axis=1)
    noise = 0.5 * (one.recursion.noise + np.outer(sign, sign) * other.recursion.noise)
    one.recursion = CovarianceRecursion(columns=half * columns, noise=noise, noise_source=one.recursion.noise_source)
    one.column_of = np.concatenate([one.column_of, other.column_of])
    one.driven = half * np.concatenate([one.driven, other.driven], axis=1)
    return one
