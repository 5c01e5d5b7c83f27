"""Covariance recursion of a linear time-varying system, source by source: `x' = A x + B w`, `y = C x + D w`.

Initial deviations and the ensemble of outlines are columns, `x = X z`, with one `z` for the whole run; white noise has
a covariance per source. Both are propagated from the start of one span of ticks to that of the next. In between, the
transition matrix and the responses to the noise since the start of the span give the covariance.
"""

from dataclasses import dataclass, field

import numpy as np


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
