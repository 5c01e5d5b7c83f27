"""Error budgets against a hand-worked example, the closed form of a Gauss-Markov error, and identities."""

import numpy as np
import pytest
from experiment_modules import load_experiment
from hypothesis import given
from hypothesis import strategies as st

from rpojax.analysis.statistics.error_budgets import (
    INDICES,
    BudgetWindows,
    budget_line,
    error_budget,
    error_indices,
    window_means,
)
from rpojax.analysis.statistics.tolerance_bounds import quantile_upper_bound

FORMS = load_experiment("evidence/error_budget.py")
"""Closed forms of a Gauss-Markov error."""


def test_hand_worked_indices() -> None:
    # Two periods of two windows of two ticks, and a tick that fills no window.
    # Windows: (1, 3) (2, 6) | (0, -2) (5, 9) | 100; means 2, 4, -1, 7.
    error = np.array([1.0, 3.0, 2.0, 6.0, 0.0, -2.0, 5.0, 9.0, 100.0])[:, None]
    found = error_indices(error, BudgetWindows(window=2, drift=2, period=4))
    assert found["absolute"].tolist() == [1, 3, 2, 6, 0, 2, 5, 9, 100]
    assert found["mean"].tolist() == [2, 4, 1, 7]
    assert found["relative"].tolist() == [1, 1, 2, 2, 1, 1, 2, 2]
    # 4 - 2 in the first period and 7 + 1 in the second; never 4 to -1, which are in two periods.
    assert found["drift"].tolist() == [2, 8]
    # -1 - 2 and 7 - 4: the same place in successive periods.
    assert found["reproducibility"].tolist() == [3, 3]


def test_hand_worked_interpretations() -> None:
    # At 75 %: three of four times, three of four members, twelve of sixteen pairs.
    sizes = np.array([[1.0, 2.0, 3.0, 9.0], [1.0, 1.0, 1.0, 4.0], [2.0, 2.0, 5.0, 6.0], [1.0, 7.0, 7.0, 8.0]])
    line = budget_line(sizes, 0.75)
    assert line.runs == 4
    # Third smallest of each member: 3, 1, 5, 7.
    assert line.temporal == 7.0
    # Largest of each member: 9, 4, 6, 8, of which three are at most 8.
    assert line.ensemble == 8.0
    # 1 1 1 1 1 2 2 2 3 4 5 6 | 7 7 8 9
    assert line.mixed == 6.0
    # Four members: the largest is above the 75 % quantile with 1 - 0.75^4 = 68 % only, which is enough for 60 %.
    assert line.ensemble_bound is None
    assert budget_line(sizes, 0.75, confidence=0.6).ensemble_bound == 9.0
    assert budget_line(sizes, 0.75, confidence=0.6, independent=False).ensemble_bound is None


def test_a_vector_error_is_averaged_before_its_size_is_taken() -> None:
    # A boresight on a circle about the target: never nearer than 1, and nothing of it remains in the mean.
    angle = np.arange(8) * np.pi / 4.0
    found = error_indices(np.stack([np.cos(angle), np.sin(angle)], axis=1), BudgetWindows(8, 8, 16))
    assert found["absolute"] == pytest.approx(np.ones(8))
    assert found["mean"] == pytest.approx([0.0], abs=1e-15)
    assert found["relative"] == pytest.approx(np.ones(8))


def test_undefined_instants_are_left_out_of_means_and_of_members() -> None:
    error = np.array([1.0, np.nan, 5.0, 3.0, np.nan, np.nan, np.nan, 2.0])[:, None]
    means = window_means(error, 4)[:, 0]
    assert means.tolist()[0] == 3.0
    assert np.isnan(means[1])  # a quarter of the instants is too few
    error[4] = 6.0
    assert window_means(error, 4)[1, 0] == 4.0  # half of them are enough
    line = budget_line(np.array([[1.0, np.nan], [np.nan, np.nan], [2.0, 3.0]]), 0.5)
    assert line.runs == 2
    # Half of the weight: the only time of the first member.
    assert line.mixed == 1.0
    assert budget_line(np.full((2, 3), np.nan), 0.9) == budget_line(np.zeros((0, 3)), 0.9)


def test_windows_that_do_not_fit_are_refused() -> None:
    for lengths in ((0, 1, 2), (2, 3, 8), (2, 4, 7), (2, 4, 4), (4, 0, 8)):
        with pytest.raises(ValueError, match="expected"):
            BudgetWindows(*lengths)


@given(
    seed=st.integers(0, 2**32 - 1),
    window=st.integers(1, 7),
    counts=st.tuples(st.integers(2, 5), st.integers(1, 3)),
    undefined=st.floats(0.0, 0.4),
)
def test_the_square_splits_into_mean_and_relative(
    seed: int, window: int, counts: tuple[int, int], undefined: float
) -> None:
    """Mean square of the absolute error over a window = square of the mean + mean square of the relative error."""
    rng = np.random.default_rng(seed)
    windows, components = counts
    error = rng.normal(3.0, 10.0 ** rng.uniform(-3, 3), (2, windows * window, components))
    error[rng.random(error.shape[:2]) < undefined] = np.nan
    found = error_indices(error, BudgetWindows(window, window, windows * window))
    shape = (2, windows, window)
    relative = found["relative"].reshape(shape)
    absolute = np.where(np.isfinite(relative), found["absolute"].reshape(shape), np.nan)
    known = np.isfinite(found["mean"])
    defined = np.isfinite(found["absolute"]).reshape(shape).sum(axis=2)
    assert np.array_equal(known, (defined > 0) & (2 * defined >= window))
    squares = [np.nanmean(values[known] ** 2, axis=1) for values in (absolute, relative)] if known.any() else [[], []]
    np.testing.assert_allclose(squares[0], found["mean"][known] ** 2 + squares[1], rtol=1e-9)


@given(seed=st.integers(0, 2**32 - 1), probability=st.floats(0.05, 0.99))
def test_interpretations_have_their_order_and_mean_what_they_say(seed: int, probability: float) -> None:
    sizes = np.random.default_rng(seed).lognormal(size=(9, 11))
    line = budget_line(sizes, probability)
    assert line.temporal is not None and line.ensemble is not None and line.mixed is not None
    assert line.mixed <= min(line.temporal, line.ensemble)
    share = probability - 1e-9
    assert (np.mean(sizes <= line.temporal, axis=1) >= share).all()
    assert np.mean((sizes <= line.ensemble).all(axis=1)) >= share
    assert np.mean(sizes <= line.mixed) >= share
    # No smaller size would do.
    assert (np.mean(sizes < line.temporal, axis=1) < probability).any()
    assert np.mean((sizes < line.ensemble).all(axis=1)) < probability + 1e-9
    assert np.mean(sizes < line.mixed) < probability + 1e-9


def test_gauss_markov_closed_form() -> None:
    """Variances of window mean, relative error, drift and reproducibility are the exact ones, within 5 sigma."""
    runs, window, correlation = 20_000, 20, np.exp(-1.0 / 15.0)
    found = error_indices(
        FORMS.gauss_markov(np.random.default_rng(1), runs, 6 * window, correlation),
        BudgetWindows(window, 2 * window, 3 * window),
    )
    mean = FORMS.gauss_markov_sampled_mean_variance(1.0, correlation, window)

    def difference(apart: int) -> float:
        # Covariance of means of windows `apart` ticks from begin to begin: sum of correlation^lag over pairs.
        lags = apart + np.arange(window)[:, None] - np.arange(window)
        return 2.0 * (mean - float(np.mean(correlation**lags)))

    expected = {
        "absolute": 1.0,
        "mean": mean,
        "relative": 1.0 - mean,
        "drift": difference(2 * window),
        "reproducibility": difference(3 * window),
    }
    for name in INDICES:
        by_run = np.mean(found[name] ** 2, axis=1)
        assert abs(by_run.mean() - expected[name]) < 5.0 * by_run.std() / np.sqrt(runs), name


def test_sampled_variance_tends_to_that_of_continuous_time() -> None:
    # exp(-2): T / tau = 2 has the variance (2 - 1 + exp(-2)) / 2.
    assert FORMS.gauss_markov_mean_variance(1.0, 2.0) == pytest.approx(0.5 * (1.0 + np.exp(-2.0)))
    sampled = FORMS.gauss_markov_sampled_mean_variance(3.0, np.exp(-2.0 / 4000), 4000)
    assert sampled == pytest.approx(FORMS.gauss_markov_mean_variance(3.0, 2.0), rel=1e-6)
    # Both ends: an error that does not change in the window, and white noise of two samples.
    assert FORMS.gauss_markov_mean_variance(1.0, 1e-9) == pytest.approx(1.0, abs=1e-9)
    assert FORMS.gauss_markov_mean_variance(1.0, 1.1e-5) == pytest.approx(1.0 - 1.1e-5 / 3.0, abs=1e-6)
    assert FORMS.gauss_markov_sampled_mean_variance(1.0, 0.0, 2) == 0.5


def test_a_budget_of_runs_has_the_bound_of_order_statistics() -> None:
    error = np.random.default_rng(5).normal(size=(60, 40, 3))
    found = error_budget(error, BudgetWindows(5, 10, 20), 0.95)
    assert tuple(found) == INDICES
    worst = np.linalg.norm(error, axis=2).max(axis=1)
    # 59 runs are enough at 95 % with 95 %: of 60 it is the largest.
    assert found["absolute"].ensemble_bound == quantile_upper_bound(worst, 0.95) == worst.max()
    assert found["absolute"].ensemble == np.sort(worst)[56]
    fewer = error_budget(error[:58], BudgetWindows(5, 10, 20), 0.95)
    assert fewer["absolute"].ensemble_bound is None
