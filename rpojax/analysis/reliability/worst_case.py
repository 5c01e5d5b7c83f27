"""The most likely combination of dispersions that breaks a requirement, found by derivatives and then really flown.

Everything that is not a dispersion made from normal numbers (sensor noise, hand-over errors, choices) stays what a
run's own random key gives: a search is on one run of a campaign, and several runs are tried.
"""

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from scipy.special import ndtr

from rpojax.analysis.gradients import run_derivatives
from rpojax.analysis.gradients.evaluation_log import Effort, Found, Point
from rpojax.analysis.gradients.run_derivatives import Flights
from rpojax.analysis.reliability import form_search
from rpojax.analysis.reliability.metric_limit import Bound
from rpojax.campaign import run_and_resume
from rpojax.dispersions import standard_normal
from rpojax.dispersions.standard_normal import NormalSpace
from rpojax.errors import RpojaxError
from rpojax.scenario.schema import ScenarioFile

_MOST_STARTS = 64
_FORWARD_UP_TO_RUNS = 1
"""Runs at a time up to which the forward mode is the faster one."""


@dataclass(frozen=True)
class Costs:
    """What a flight and a gradient take, each for one run of a whole batch [s], and how many runs that is."""

    batch: int
    flight_s: float
    gradient_s: float

    @property
    def gradient_flights(self) -> int:
        """What a gradient costs in flights, rounded up so that the noise of a clock rarely shows."""
        return max(1, math.ceil(self.gradient_s / self.flight_s))


class FlownLimit:
    """A bound as a function of the numbers behind a run's dispersions; lanes are runs of a campaign's seed."""

    def __init__(self, flights: Flights, bound: Bound, costs: Costs, seed: int) -> None:
        self._flights, self._bound, self._costs, self._seed = flights, bound, costs, seed
        self._column = flights.names.index(bound.metric)

    @property
    def gradient_cost(self) -> float:
        """In flights."""
        return float(self._costs.gradient_flights)

    @property
    def batch(self) -> int:
        """Runs that fly together."""
        return self._flights.capacity

    def margins(self, points: np.ndarray, lanes: np.ndarray) -> np.ndarray:
        """Margins (n,) of numbers (n, k) in runs (n,); minus infinity for runs that fail."""
        found = self._flights.values(points, run_derivatives.run_keys(self._seed, lanes))
        return self._margins(found)

    def gradients(self, points: np.ndarray, lanes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Margins (n,) and their gradients (n, k)."""
        sign = -1.0 if self._bound.bound == "at most" else 1.0
        found, gradients = _gradients(
            self._flights,
            points,
            run_derivatives.run_keys(self._seed, lanes),
            sign * _only(self._flights, self._column),
        )
        return self._margins(found), gradients

    def _margins(self, found: run_derivatives.Found) -> np.ndarray:
        values = found.figures[:, self._column]
        return np.where(found.failed | ~np.isfinite(values), -np.inf, self._bound.margins(values))


@dataclass(frozen=True)
class Worst:
    """The most likely violation that was found, or how close the search came.

    Attributes:
        bound: that was to be broken
        space: the numbers behind the dispersions
        seed: of the campaign
        found: by the search, in those numbers
        costs: of flights and gradients
        compile_s: [s]
        values: of the dispersed keys in the user's units at the nearest violation, else at the closest point
    """

    bound: Bound
    space: NormalSpace
    seed: int
    found: Found
    costs: Costs
    compile_s: float
    values: dict[str, Any]

    @property
    def shown(self) -> Point:
        """The nearest violation, or the closest point where there is none."""
        return self.found.nearest or self.found.closest

    @property
    def probability(self) -> float | None:
        """First-order probability of a violation in runs with this run's noise; None without a violation."""
        return None if self.found.nearest is None else float(ndtr(-self.found.nearest.distance))

    @property
    def flyable(self) -> ScenarioFile:
        """The scenario with the dispersions of the point that is shown as choices of one value."""
        return standard_normal.pinned(self.space, self.values)


def check_effort(effort: Effort) -> None:
    """Refuses efforts that find nothing.

    Raises:
        RpojaxError: naming the option.
    """
    if not 1 <= effort.starts <= _MOST_STARTS:
        raise RpojaxError(f"--starts: found {effort.starts}, expected 1 to {_MOST_STARTS}")
    if not effort.budget >= effort.screened:
        raise RpojaxError(f"--budget: found {effort.budget:g}, expected at least the {effort.screened} first flights")


def flights_of(space: NormalSpace, metrics: Sequence[str], starts: int) -> Flights:
    """Flights of a scenario as a function of the numbers behind its dispersions, for so many starts at a time."""
    return Flights(space.file, space.values, space.count, metrics, runs=starts)


def _only(flights: Flights, column: int) -> np.ndarray:
    """Weights (figures,) that leave one figure."""
    return np.eye(len(flights.names))[column]


def _gradients(
    flights: Flights, points: np.ndarray, keys: np.ndarray, weights: np.ndarray
) -> tuple[run_derivatives.Found, np.ndarray]:
    """Figures of runs, and the gradients (n, k) of the sum of figures with weights (figures,).

    A run alone leaves most of what the processor does at once unused, and the forward mode fills it with directions:
    measured with 26 of them, it takes 6 flights and the reverse mode 17; with four runs, 19 and 17.
    """
    if flights.capacity <= _FORWARD_UP_TO_RUNS:
        found = flights.forward(points, keys)
        assert found.jacobian is not None
        return found, np.einsum("f,rfk->rk", weights, found.jacobian)
    found = flights.reverse(points, keys, np.tile(weights, (len(points), 1)))
    assert found.gradient is not None
    return found, found.gradient


def measure(flights: Flights, repeats: int = 2) -> Costs:
    """Times a whole batch of flights and of gradients, both compiled; the fastest of `repeats` counts.

    On a CPU it is the processor's time that counts: what else the machine does is no cost of a gradient.
    """
    clock = time.process_time if jax.default_backend() == "cpu" else time.perf_counter
    runs = flights.capacity
    numbers, keys = np.zeros((runs, flights.count)), run_derivatives.run_keys(0, np.arange(runs))
    weights = np.ones(len(flights.names))

    def fastest(fly: Callable[[], Any]) -> float:
        fly()
        times = []
        for _ in range(repeats):
            begin = clock()
            fly()
            times.append(clock() - begin)
        return min(times) / runs

    flight_s = fastest(lambda: flights.values(numbers, keys))
    return Costs(runs, flight_s, fastest(lambda: _gradients(flights, numbers, keys, weights)))


def search(
    space: NormalSpace,
    bound: Bound,
    effort: Effort,
    seed: int,
    flights: Flights | None = None,
    costs: Costs | None = None,
) -> Worst:
    """The most likely violation of a bound in runs of a seed; `flights` and their `costs` may be used again.

    Raises:
        RpojaxError: the effort can find nothing.
    """
    check_effort(effort)
    flown = flights or flights_of(space, (bound.metric,), effort.starts)
    measured = costs or measure(flown)
    found = form_search.search(FlownLimit(flown, bound, measured, seed), space.count, effort, seed)
    shown = found.nearest or found.closest
    key = run_derivatives.run_keys(seed, np.array([shown.lane]))[0]
    values = jax.jit(space.values)(jnp.asarray(shown.numbers), jnp.asarray(key))
    plain = {name: np.asarray(value) for name, value in values.items()}
    return Worst(bound, space, seed, found, measured, flown.compile_s, plain)


def fly(worst: Worst, directory: Path, force: bool = False) -> float:
    """Flies the point that is shown as `rpojax run` does, into a campaign folder; the metric that it has there.

    Raises:
        RpojaxError: the folder cannot be used.
    """
    flown = run_and_resume.run_campaign(
        worst.flyable, 1, directory, worst.seed, first_run=worst.shown.lane, block_size=1, force=force
    )
    return float(flown.metrics[worst.bound.metric][0]) if flown.completed.all() else math.nan
