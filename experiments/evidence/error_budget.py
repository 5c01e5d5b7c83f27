"""Error budgets against a hand-worked example and the closed forms of a first-order Gauss-Markov error.

python experiments/evidence/error_budget.py

Prints the example; for windows of a tenth to ten correlation times the mean square of each error index with its 95 %
interval beside the exact one; the sizes that hold with 95 % in the mixed interpretation beside those of a normal
distribution; and how often the confidence bound of the ensemble is above the quantile that it bounds.
"""

import json

import numpy as np
from scipy.signal import lfilter
from scipy.stats import norm

from rpojax.analysis.statistics.error_budgets import (
    BudgetWindows,
    budget_line,
    error_budget,
    error_indices,
)
from rpojax.analysis.statistics.tolerance_bounds import runs_for_bound

RUNS, WINDOW, PERIODS = 4000, 50, 2
RATIOS = (0.1, 0.5, 1.0, 3.0, 10.0)
"""Windows over the correlation time."""
PROBABILITY, CAMPAIGNS, REFERENCE = 0.95, 4000, 400_000


def gauss_markov(rng: np.random.Generator, runs: int, ticks: int, correlation: float) -> np.ndarray:
    """Stationary errors (runs, ticks, 1) of variance 1, neighbours of which have the correlation."""
    draws = rng.normal(size=(runs, ticks))
    draws[:, 1:] *= np.sqrt(1.0 - correlation**2)
    return np.asarray(lfilter([1.0], [1.0, -correlation], draws, axis=1))[..., None]


def gauss_markov_mean_variance(variance: float, ratio: float) -> float:
    """Variance of the mean over a window of a first-order Gauss-Markov error of the given variance.

    `ratio` is the window over the correlation time, T / tau: s^2 = 2 variance (x - 1 + exp(-x)) / x^2.
    """
    # The series keeps what cancels at small ratios.
    factor = 1.0 - ratio / 3.0 if ratio < 1e-5 else 2.0 * (ratio + np.expm1(-ratio)) / ratio**2
    return float(variance * factor)


def gauss_markov_sampled_mean_variance(variance: float, correlation: float, count: int) -> float:
    """Variance of the mean of `count` samples of a Gauss-Markov error, neighbours of which have the correlation.

    Exact: variance / n (1 + 2 sum over k of (1 - k / n) correlation^k), from 1 to n - 1.
    """
    lag = np.arange(1, count)
    return float(variance / count * (1.0 + 2.0 * np.sum((1.0 - lag / count) * correlation**lag)))


def exact_variances(correlation: float, windows: BudgetWindows) -> dict[str, float]:
    """Mean square of each index of samples of a Gauss-Markov error of variance 1."""
    mean = gauss_markov_sampled_mean_variance(1.0, correlation, windows.window)
    lags = np.arange(windows.window)[:, None] - np.arange(windows.window)
    apart = {
        name: 2.0 * (mean - float(np.mean(correlation ** (lag + lags))))
        for name, lag in (("drift", windows.drift), ("reproducibility", windows.period))
    }
    return {"absolute": 1.0, "mean": mean, "relative": 1.0 - mean, **apart}


def hand_worked() -> None:
    """The example of the README: two members of eight instants, windows of two, periods of four."""
    error = np.array([[1.0, 3, 2, 6, 0, -2, 5, 9], [0.0, 2, 1, 1, 3, 5, 2, 2]])[..., None]
    windows = BudgetWindows(window=2, drift=2, period=4)
    for name, sizes in error_indices(error, windows).items():
        line = budget_line(sizes, 0.75)
        print(json.dumps({name: sizes.tolist(), "75 %": [line.temporal, line.ensemble, line.mixed]}))


def closed_forms(rng: np.random.Generator) -> None:
    """Mean squares and mixed sizes beside the exact ones."""
    windows = BudgetWindows(WINDOW, 2 * WINDOW, 4 * WINDOW)
    inside = count = 0
    for ratio in RATIOS:
        correlation = float(np.exp(-ratio / WINDOW))
        error = gauss_markov(rng, RUNS, PERIODS * windows.period, correlation)
        exact, budget = exact_variances(correlation, windows), error_budget(error, windows, PROBABILITY)
        row: dict[str, object] = {"T/tau": ratio, "continuous": round(gauss_markov_mean_variance(1.0, ratio), 4)}
        for name, sizes in error_indices(error, windows).items():
            by_run = np.mean(sizes**2, axis=1)
            reach = norm.ppf(0.975) * by_run.std(ddof=1) / np.sqrt(RUNS)
            low, high = by_run.mean() - reach, by_run.mean() + reach
            inside, count = inside + int(low <= exact[name] <= high), count + 1
            row[name] = [round(value, 4) for value in (exact[name], low, high)]
            if name != "relative":
                # Its variance depends on the place in the window, so its sizes are not those of one normal error.
                mixed = budget[name].mixed
                assert mixed is not None
                row[f"{name}, mixed over exact"] = round(mixed / (norm.ppf(0.975) * np.sqrt(exact[name])), 3)
        print(json.dumps(row))
    print(json.dumps({"95 % intervals of mean squares that hold the exact one": f"{inside} of {count}"}))


def bound_coverage(rng: np.random.Generator) -> None:
    """Share of campaigns whose bound is above the quantile over members of the largest error of a run."""
    correlation, ticks = float(np.exp(-1.0 / 10.0)), 40
    runs = runs_for_bound(PROBABILITY, 0.95)
    largest = np.abs(gauss_markov(rng, REFERENCE, ticks, correlation)[..., 0]).max(axis=1)
    quantile = float(np.quantile(largest, PROBABILITY))
    for count in (runs - 1, runs, 2 * runs):
        errors = np.abs(gauss_markov(rng, CAMPAIGNS * count, ticks, correlation)[..., 0])
        bounds = [budget_line(each, PROBABILITY).ensemble_bound for each in errors.reshape(CAMPAIGNS, count, ticks)]
        above = [bound > quantile for bound in bounds if bound is not None]
        share = float(np.mean(above)) if above else None
        error = None if share is None else round(1.96 * float(np.sqrt(share * (1.0 - share) / CAMPAIGNS)), 4)
        print(json.dumps({"runs": count, "bounds": len(above), "above": share, "plus or minus": error}))


def main() -> None:
    """Prints all of it."""
    rng = np.random.default_rng(1)
    hand_worked()
    closed_forms(rng)
    bound_coverage(rng)


if __name__ == "__main__":
    main()
