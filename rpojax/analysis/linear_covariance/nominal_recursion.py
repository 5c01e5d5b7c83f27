"""The recursion along one nominal run of a linear covariance, burn period by burn period."""

import dataclasses
import math
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np

from rpojax.analysis.linear_covariance import initial_deviation, noise_inputs
from rpojax.analysis.linear_covariance.burn_decision import Decision, decide, execution, root
from rpojax.analysis.linear_covariance.covariance_recursion import Recursion, Tick
from rpojax.analysis.linear_covariance.deviation_vector import PENDING
from rpojax.analysis.linear_covariance.linearised_loop import OUTPUTS, Moment
from rpojax.analysis.linear_covariance.nominal_setup import Setup

_HOLD_UNDER_WAY = 3
"""Ticks that one derivative stands for during the transfer."""


@dataclass(frozen=True)
class Record:
    """What a period gives; fields as those of `LinearCovariance`, and the decision's probability and size of a burn."""

    nominal: np.ndarray
    mean: np.ndarray
    covariance: np.ndarray
    filter_variance_H: np.ndarray
    seen: np.ndarray
    shares: np.ndarray
    decision: np.ndarray


class Side:
    """The recursion along one nominal run, burn period by burn period."""

    def __init__(self, setup: Setup, start: initial_deviation.Start, hold: int, pool: ThreadPoolExecutor) -> None:
        self.setup, self.hold, self.pool = setup, hold, pool
        self.file, self.loop, self.compiled, self.sigma = setup.file, setup.loop, setup.compiled, setup.sigma
        self.state, self.tumble, self.mean = start.state, setup.tumble, start.mean
        size, count = setup.loop.layout.size, len(setup.tumble.q_TN)
        columns = [*start.columns.values(), np.zeros((size, count))]
        self.recursion = Recursion(
            columns=np.concatenate(columns, axis=1),
            noise=np.zeros((len(setup.noises), size, size)),
            noise_of=self._noise_of(),
        )
        owners = [setup.number[name] for name in (*start.columns, noise_inputs.OUTLINE)]
        self.column_of = np.repeat(owners, [each.shape[1] for each in columns])
        # Factors of the outlines' deviations in the columns.
        self.driven = np.concatenate([np.zeros((count, self.column_of.size - count)), np.eye(count)], axis=1)
        self.missed, self.owed = 0.0, 0.0
        self.last: Decision | None = None
        # Whether the nominal run burns in this period, has burned at all, and has then stopped.
        self.burned, self.moved, self.arrived = True, False, False
        self.carried: Future[Record] | None = None

    def _noise_of(self) -> np.ndarray:
        inputs = self.loop.inputs
        numbers = np.zeros(inputs.size, dtype=int)
        for name, part in inputs.parts.items():
            numbers[part] = self.setup.noises.index(name)
        return numbers

    def period(self, count: int) -> Future[Record]:
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

        Once there has been a decision little changes from tick to tick while the camera looks on and boxes come: then
        one derivative in a few is enough, and in many when the transfer is over.
        """
        keys = np.arange(count)
        burns = np.any(np.asarray(moments.memory.plan.delta_v_N[0]))
        hold = self.hold if self.arrived and not burns else min(self.hold, _HOLD_UNDER_WAY)
        if self.last is None:
            return keys
        seen, quiet = np.asarray(moments.seen), np.asarray(moments.quiet)
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
        forcing[self.loop.inputs.parts[noise_inputs.BOX]] = edges.T @ self.driven / scale
        return forcing

    def _decide(self, moments: Moment, derivative: np.ndarray) -> Decision:
        """The decision on the first of the moments, where the derivative is `derivative`."""
        size = self.loop.layout.size
        gradient = derivative[size:][OUTPUTS["law_H"]]
        U, V = gradient[:, :size], gradient[:, size:]
        forcing = self._forcing(np.asarray(moments.edges[0]))
        covariance = self.recursion.look(U, V * self.sigma, forcing)
        mean = np.asarray(moments.outputs[0])[OUTPUTS["law_H"]] + U @ self.mean
        return decide(self.compiled, moments, gradient, mean, covariance, self.setup.points)

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

    def _carry(self, moments: Moment, derivatives: np.ndarray, rows: np.ndarray, decision: Decision) -> Record:
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
        return Record(
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
        found = np.zeros((len(self.setup.sources), noise.shape[1]))
        np.add.at(found, [self.setup.number[name] for name in self.setup.noises], noise)
        np.add.at(found, self.column_of, columns.T)
        return found

    def _decided(self, decision: Decision) -> tuple[np.ndarray, np.ndarray]:
        """What the decision leaves of its input."""
        columns = np.zeros((self.loop.layout.size, 4))
        columns[self.loop.layout.slices[PENDING]] = root(decision.found.residual)
        return columns, np.full(4, self.setup.noises.index(noise_inputs.DECISION))

    def _execution(self, decision: Decision) -> tuple[np.ndarray, np.ndarray]:
        """Execution errors of the burns that are decided on."""
        mass = float(self.loop.params.plant.servicer.mass)
        along = self._variance("plant.thruster.force_scale") + self._variance("truth.mass") / mass**2
        across = self._variance("plant.thruster.misalignment") + self._variance("star_tracker.misalignment")
        columns = np.zeros((self.loop.layout.size, 3))
        columns[self.loop.layout.slices["truth.v_ST_N"]] = execution(
            decision, self.loop.params.plant.thruster, along, across
        )
        return columns, np.full(3, self.setup.noises.index(noise_inputs.BURN))

    def _variance(self, name: str) -> float:
        """Mean variance of the components of a number, from what it started with."""
        part = self.loop.layout.slices.get(name)
        if part is None:
            return 0.0
        return float(np.mean(np.sum(self.recursion.columns[part] ** 2, axis=1)))


def average(records: list[Record]) -> Record:
    """What one period gives in the mean of the nominal runs."""
    names = [each.name for each in dataclasses.fields(Record)]
    return Record(**{name: np.mean([getattr(record, name) for record in records], axis=0) for name in names})


def merge(sides: list[Side]) -> Side:
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
