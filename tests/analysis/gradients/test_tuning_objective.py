"""The objective of tuning on figures made by hand."""

import jax.numpy as jnp
import numpy as np
import pytest

import rpojax
from rpojax.analysis.gradients.tuning_objective import PART_METRICS, Objective
from rpojax.errors import ScenarioError
from rpojax.simulation.running_metrics import RUNNING_METRICS

RNG = np.random.default_rng(2)


def objective(**weights: float) -> Objective:
    every = [f"tuning.{name}={weights.get(name, 0.0)}" for name in PART_METRICS]
    return Objective(rpojax.load("inspection", every))


def slope(made: Objective, figures: np.ndarray, there: np.ndarray | None = None) -> np.ndarray:
    counted = np.ones(len(figures)) if there is None else there
    return np.asarray(made.gradient(*map(jnp.asarray, (figures, figures, counted))))


def test_all_parts_are_weights_of_the_scenario_and_need_figures_that_there_are() -> None:
    assert set(PART_METRICS) == set(rpojax.load("inspection").tuning.model_dump())
    assert {name for names in PART_METRICS.values() for name in names} <= set(RUNNING_METRICS)


def test_an_error_counts_by_its_logarithm() -> None:
    made = objective(formation=2.0)
    figures = np.array([[1.0], [np.e]])
    value, parts = made(figures)
    assert value == pytest.approx(1.0)
    assert parts == {"formation": pytest.approx(0.5)}
    np.testing.assert_allclose(slope(made, figures), [[1.0], [1.0 / np.e]])


def test_a_consistent_filter_has_nothing_to_gain() -> None:
    made, figures = objective(consistency=1.0), np.array([[11.0, 5.0], [13.0, 7.0]])
    assert made(figures)[0] == pytest.approx(0.0)
    np.testing.assert_allclose(slope(made, figures), 0.0, atol=1e-15)


@pytest.mark.parametrize("factor", [0.5, 2.0])
def test_doubt_and_overconfidence_count_alike(factor: float) -> None:
    value, _ = objective(consistency=1.0)(factor * np.array([[12.0, 6.0], [12.0, 6.0]]))
    assert value == pytest.approx(2.0 * np.log(2.0) ** 2)


def test_a_lost_run_says_nothing_about_consistency() -> None:
    figures = np.array([[12.0, 6.0]] * 9 + [[2e6, 1e6]])
    made = objective(consistency=1.0)
    assert made(figures)[0] == pytest.approx(0.0)
    np.testing.assert_array_equal(slope(made, figures)[-1], 0.0)


def test_a_run_without_numbers_is_left_out() -> None:
    made, figures = objective(formation=1.0), np.array([[1.0], [np.nan]])
    assert made(figures)[0] == pytest.approx(0.0)
    np.testing.assert_array_equal(slope(made, figures), [[1.0], [0.0]])


def test_a_run_that_fills_up_a_batch_does_not_count() -> None:
    made = objective(**dict.fromkeys(PART_METRICS, 1.0))
    figures = 1.0 + RNG.random((5, len(made.metric_names)))
    filled = np.concatenate([figures, figures[-1:], figures[-1:]])
    there = np.array([1.0] * 5 + [0.0] * 2)
    np.testing.assert_allclose(slope(made, filled, there)[:5], slope(made, figures), rtol=1e-12)
    np.testing.assert_array_equal(slope(made, filled, there)[5:], 0.0)


def test_the_slope_is_that_of_the_value() -> None:
    made = objective(**dict.fromkeys(PART_METRICS, 0.7))
    figures = 1.0 + RNG.random((6, len(made.metric_names)))
    direction = RNG.standard_normal(figures.shape)
    up, down = (made(figures + sign * 1e-6 * direction)[0] for sign in (1.0, -1.0))
    assert np.sum(slope(made, figures) * direction) == pytest.approx((up - down) / 2e-6, rel=1e-6)


def test_weights_of_zero_are_refused() -> None:
    with pytest.raises(ScenarioError, match="tuning: found 'no weight above zero', expected a weight for one of"):
        objective()
