"""Measures of dependence against worked numbers, and rankings where the answer is known."""

import numpy as np
import pytest
from scipy import stats

from rpojax.analysis.statistics.dependence_measures import (
    group_difference,
    hsic,
    kendall_correlation,
    kernel_factor,
    spearman,
    spearman_p,
)
from rpojax.analysis.statistics.rank_sensitivity import rank_inputs, separate_failing_runs, sobol_indices

STEPS = np.arange(1.0, 9.0)
SWAPPED = np.array([2.0, 1.0, 4.0, 3.0, 6.0, 5.0, 8.0, 7.0])


def test_rank_correlations_against_worked_numbers() -> None:
    found = spearman(STEPS, SWAPPED)
    assert found == pytest.approx(0.9047619, abs=5e-8)
    assert spearman_p(np.array([found]), 8) == pytest.approx([0.0020083], abs=5e-8)
    assert spearman_p(np.array([1.0, 0.0]), 8) == pytest.approx([0.0, 1.0])
    assert kendall_correlation(STEPS, SWAPPED) == pytest.approx(0.7142857, abs=5e-8)


def test_rank_correlation_agrees_with_scipy_with_ties_and_is_none_for_a_constant() -> None:
    rng = np.random.default_rng(2)
    x, y = rng.integers(0, 5, 200), rng.normal(size=200)
    assert spearman(x, y) == pytest.approx(stats.spearmanr(x, y)[0])
    assert spearman(np.ones(9), y[:9]) is None


def test_hsic_against_worked_numbers() -> None:
    x = np.arange(4.0)
    assert hsic(x, x) == pytest.approx(0.0722874, abs=5e-8)
    assert hsic(x, np.array([0.0, 1.0, 1.0, 0.0])) == pytest.approx(0.0126002, abs=5e-8)


def test_hsic_is_the_trace_of_the_centred_kernels() -> None:
    rng = np.random.default_rng(4)
    x = rng.normal(size=60)
    y = np.round(x**2 + rng.normal(size=60), 1)

    def kernel(values: np.ndarray) -> np.ndarray:
        distance = np.abs(values[:, None] - values)
        return np.exp(-0.5 * (distance / np.median(distance[np.triu_indices(60, 1)])) ** 2)

    center = np.eye(60) - 1.0 / 60.0
    expected = np.trace(kernel(x) @ center @ kernel(y) @ center) / 3600.0
    assert hsic(x, y) == pytest.approx(expected, rel=1e-8)
    centred = center @ kernel(x) @ center
    rough = kernel_factor(x, 1e-3)
    assert rough.shape[1] < 15
    assert np.trace(centred - rough @ rough.T) < 1e-3 * 60.0


def test_hsic_of_a_quantity_that_hardly_varies() -> None:
    rare = np.zeros(40)
    rare[:3] = 1.0
    assert hsic(rare, rare) > 0.0
    assert hsic(np.zeros(40), rare) == pytest.approx(0.0, abs=1e-15)


def test_failing_against_passing_inputs_against_worked_numbers() -> None:
    found = group_difference(np.arange(1.0, 6.0), np.arange(4.0, 9.0))
    assert found.ks_distance == pytest.approx(0.6, rel=1e-12)
    assert found.ks_p == pytest.approx(0.357143, abs=5e-7)
    assert found.auc * 25.0 == pytest.approx(23.0, rel=1e-12)
    assert found.auc_p == pytest.approx(0.035579, abs=5e-7)


def ishigami(points: np.ndarray) -> np.ndarray:
    """Ishigami's function with a = 7, b = 0.1."""
    x, y, z = points.T
    return np.sin(x) + 7.0 * np.sin(y) ** 2 + 0.1 * z**4 * np.sin(x)


def test_sobol_indices_of_ishigamis_function_against_exact_and_worked_numbers() -> None:
    a, b, pi = 7.0, 0.1, np.pi
    alone = [0.5 * (1.0 + b * pi**4 / 5.0) ** 2, a**2 / 8.0, 0.0]
    both = b**2 * pi**8 * (1.0 / 18.0 - 1.0 / 50.0)
    variance = sum(alone) + both
    exact_first = np.array(alone) / variance
    exact_total = np.array([alone[0] + both, alone[1], both]) / variance
    np.testing.assert_allclose(exact_first, [0.313905, 0.442411, 0.0], atol=5e-7)
    np.testing.assert_allclose(exact_total, [0.557589, 0.442411, 0.243684], atol=5e-7)
    found = sobol_indices(ishigami, np.full(3, -pi), np.full(3, pi), 4096, seed=1)
    np.testing.assert_allclose(found.first_order, exact_first, atol=2e-3)
    np.testing.assert_allclose(found.total_order, exact_total, atol=2e-3)
    np.testing.assert_allclose(found.first_order, [0.31400, 0.44338, -0.00025], atol=5.1e-6)
    np.testing.assert_allclose(found.total_order, [0.55761, 0.44241, 0.24409], atol=5.1e-6)


@pytest.fixture(scope="module")
def points() -> np.ndarray:
    return np.random.default_rng(0).uniform(-np.pi, np.pi, (800, 3))


def test_the_two_methods_disagree_on_ishigamis_function_and_it_is_said(points: np.ndarray) -> None:
    found = rank_inputs(dict(zip("xyz", points.T, strict=True)), ishigami(points))
    assert found.leading_by_spearman == ("x",)
    assert set(found.leading_by_hsic) == {"x", "y", "z"}
    assert found.disagree
    numbers = {one.name: one for one in found.inputs}
    # Over many draws: ranks .42, -.04, .01 and HSIC .144, .011, .027.
    assert [numbers[name].spearman for name in "xyz"] == pytest.approx([0.42, -0.04, 0.01], abs=0.05)
    assert [numbers[name].hsic for name in "xyz"] == pytest.approx([0.144, 0.011, 0.027], abs=0.01)


def test_a_monotonic_influence_leads_by_both_and_noise_by_neither() -> None:
    rng = np.random.default_rng(8)  # chance names a noise, too, in one of twenty
    inputs = {f"noise{i}": rng.normal(size=1500) for i in range(12)}
    inputs |= {"strong": rng.normal(size=1500), "weak": rng.normal(size=1500), "fixed": np.ones(1500)}
    metric = np.exp(inputs["strong"]) + 0.7 * inputs["weak"] + 0.2 * rng.normal(size=1500)
    metric[::10] = np.nan
    found = rank_inputs(inputs, metric, seed=3)
    assert found.leading_by_spearman == found.leading_by_hsic == ("strong", "weak")
    assert not found.disagree
    assert (found.runs, found.sampled) == (1350, 1000)
    assert [one.name for one in found.inputs[:2]] == ["strong", "weak"]
    assert "fixed" not in {one.name for one in found.inputs}
    assert found.inputs[0].hsic == pytest.approx(_normalised(inputs["strong"], metric), abs=0.05)
    assert rank_inputs(inputs, metric, seed=3) == found


def _normalised(x: np.ndarray, y: np.ndarray) -> float:
    x, y = x[np.isfinite(y)], y[np.isfinite(y)]
    return hsic(x, y) / np.sqrt(hsic(x, x) * hsic(y, y))


def test_p_values_of_unrelated_inputs_are_below_a_twentieth_seldom() -> None:
    rng = np.random.default_rng(6)
    false_alarms = 0
    for seed in range(40):
        found = rank_inputs({"a": rng.normal(size=60), "b": rng.normal(size=60)}, rng.normal(size=60), seed)
        false_alarms += bool(found.leading_by_hsic)
    # At most a twentieth of forty; eight has a probability below 1e-3.
    assert false_alarms < 8


def test_nothing_is_ranked_without_enough_runs_or_where_nothing_varies() -> None:
    inputs = {"x": np.arange(40.0)}
    assert rank_inputs(inputs, np.where(np.arange(40) < 9, np.arange(40.0), np.nan)).inputs == ()
    assert rank_inputs(inputs, np.ones(40)).inputs == ()
    assert rank_inputs({"x": np.ones(40)}, np.arange(40.0)).inputs == ()


def test_what_sets_failing_runs_apart_comes_first_with_its_side() -> None:
    rng = np.random.default_rng(7)
    inputs = {f"noise{i}": rng.normal(size=400) for i in range(5)} | {"cause": rng.normal(size=400)}
    failing = inputs["cause"] < -1.5
    first, *rest = separate_failing_runs(inputs, failing)
    assert first.name == "cause"
    assert (first.difference.ks_distance, first.difference.auc) == (1.0, 0.0)
    assert first.difference.ks_p < 1e-6
    assert all(one.difference.ks_p > 0.05 and one.difference.auc_p > 0.05 for one in rest)
    alone = group_difference(inputs["noise0"][~failing], inputs["noise0"][failing])
    assert next(one for one in rest if one.name == "noise0").difference.ks_p >= alone.ks_p


def test_without_failing_or_passing_runs_nothing_is_set_apart() -> None:
    assert separate_failing_runs({"x": np.arange(4.0)}, np.zeros(4, bool)) == ()
    assert separate_failing_runs({"x": np.arange(4.0)}, np.ones(4, bool)) == ()
