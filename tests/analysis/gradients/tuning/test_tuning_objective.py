"""The objective of tuning on metrics made by hand."""

import jax.numpy as jnp
import numpy as np
import pytest

import rpojax
from rpojax.analysis.gradients.tuning.tuning_objective import PART_METRICS, Objective
from rpojax.errors import ScenarioError
from rpojax.metrics.metric_catalogue import DIFFERENTIABLE


def objective(**weights: float) -> Objective:
    every = [f"tuning.{name}={weights.get(name, 0.0)}" for name in PART_METRICS]
    return Objective(rpojax.load("inspection", every))


def gradient(made: Objective, metrics: np.ndarray, mask: np.ndarray | None = None) -> np.ndarray:
    counted = np.ones(len(metrics)) if mask is None else mask
    return np.asarray(made.gradient(jnp.asarray(metrics), jnp.asarray(counted)))


def test_all_parts_are_weights_of_the_scenario_and_need_existing_metrics() -> None:
    assert set(PART_METRICS) == set(rpojax.load("inspection").tuning.model_dump())
    assert {name for names in PART_METRICS.values() for name in names} <= set(DIFFERENTIABLE)


def test_an_error_counts_by_its_logarithm() -> None:
    made = objective(formation=2.0)
    metrics = np.array([[1.0], [np.e]])
    value, parts = made(metrics)
    assert value == pytest.approx(1.0)
    assert parts == {"formation": pytest.approx(0.5)}
    np.testing.assert_allclose(gradient(made, metrics), [[1.0], [1.0 / np.e]])


def test_a_consistent_filter_has_no_gradient() -> None:
    made, metrics = objective(consistency=1.0), np.array([[11.0, 5.0], [13.0, 7.0]])
    assert made(metrics)[0] == pytest.approx(0.0)
    np.testing.assert_allclose(gradient(made, metrics), 0.0, atol=1e-15)


@pytest.mark.parametrize("factor", [0.5, 2.0])
def test_conservative_and_overconfident_filters_count_alike(factor: float) -> None:
    value, _ = objective(consistency=1.0)(factor * np.array([[12.0, 6.0], [12.0, 6.0]]))
    assert value == pytest.approx(2.0 * np.log(2.0) ** 2)


def test_the_nees_of_a_lost_run_does_not_count_for_consistency_but_its_loss_does() -> None:
    metrics = np.array([[12.0, 6.0]] * 9 + [[2e6, 1e6]])
    made = objective(consistency=1.0)
    # Both halves are lost in a tenth of the runs.
    assert made(metrics)[0] == pytest.approx(2.0 * 0.1 * 6.0)
    np.testing.assert_array_equal(gradient(made, metrics)[-1], 0.0)
    worse = metrics.copy()
    worse[-1] = [2e9, 1e9]
    assert made(worse)[0] == made(metrics)[0]


def test_a_run_that_never_settles_does_not_look_perfect() -> None:
    made = objective(pointing=1.0)
    settled, one_of_two = made(np.array([[0.1], [0.1]]))[0], made(np.array([[0.1], [np.nan]]))[0]
    assert settled == pytest.approx(np.log(0.1))
    assert one_of_two == pytest.approx(0.5 * (np.log(0.1) + np.log(180.0)))


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_a_run_without_a_value_counts_as_the_worst_and_has_no_gradient(value: float) -> None:
    made, metrics = objective(formation=1.0), np.array([[1.0], [value]])
    assert made(metrics)[0] == pytest.approx(0.5 * np.log(1e7))
    np.testing.assert_array_equal(gradient(made, metrics), [[0.5], [0.0]])
    assert made.undefined_runs(metrics) == {"formation": 1}


def test_a_run_without_one_value_counts_with_the_others() -> None:
    made = objective(formation=1.0, pointing=1.0)
    metrics = np.array([[np.e, 0.1], [np.e, np.nan], [np.e, np.nan]])
    assert made(metrics)[1]["formation"] == pytest.approx(1.0)
    assert made.undefined_runs(metrics) == {"formation": 0, "pointing": 2}


def with_weight(name: str, weight: float) -> Objective:
    """Objective of one part, or of one metric with a weight of its own."""
    if name in PART_METRICS:
        return objective(**{name: weight})
    file = rpojax.load("inspection", [f"tuning.{part}=0" for part in PART_METRICS])
    return Objective(file.model_copy(update={"tuning": file.tuning.model_copy(update={"metrics": {name: weight}})}))


@pytest.mark.parametrize("others", [1e-3, 1.0, 50.0])
@pytest.mark.parametrize(
    ("name", "weight"),
    [*((part, 1.0) for part in PART_METRICS), ("min_range_m", -1.0), ("final_range_m", 1.0), ("pose_surprise", 1.0)],
)
def test_no_objective_improves_when_a_run_loses_a_value(name: str, weight: float, others: float) -> None:
    made = with_weight(name, weight)
    rows = others * (1.0 + np.random.default_rng(2).random((4, len(made.metric_names))))
    if name == "consistency":
        rows = rows[:, :1] * [2.0, 1.0]
    without = np.concatenate([rows, np.full_like(rows[:1], np.nan)])
    worst = made(without)[0]
    assert np.isfinite(worst)
    assert np.isfinite(gradient(made, without)).all()
    for value in np.logspace(-12.0, 12.0, 49):
        before = np.concatenate([rows, np.full_like(rows[:1], value)])
        if name == "consistency":
            before[-1] = [2.0 * value, value]
        assert made(before)[0] <= worst + 1e-12 * abs(worst)


def test_a_likelihood_with_a_weight_of_its_own_counts_as_it_is_and_may_be_negative() -> None:
    made, metrics = with_weight("pose_surprise", 2.0), np.array([[-7.0], [1.0]])
    assert made(metrics)[0] == pytest.approx(-6.0)
    np.testing.assert_allclose(gradient(made, metrics), [[1.0], [1.0]])


def test_a_negative_value_of_a_metric_with_a_weight_of_its_own_is_refused() -> None:
    made = with_weight("min_range_m", 1.0)
    assert np.isfinite(made(np.array([[5.0], [0.0], [np.nan]]))[0])
    with pytest.raises(ScenarioError) as caught:
        made(np.array([[5.0], [-0.25]]))
    assert str(caught.value) == (
        "tuning.metrics.min_range_m: found -0.25, expected 0 or more in every run, since its logarithm counts"
    )


@pytest.mark.parametrize(
    ("values", "found"), [([0.0, 0.0], "0"), ([0.0, np.nan, 1e-12], "0 to 1e-12"), ([3e9, 2e9], "2e+09 to 3e+09")]
)
@pytest.mark.parametrize("weight", [1.0, -1.0])
def test_a_metric_that_is_beyond_its_range_in_every_run_is_named(
    values: list[float], found: str, weight: float
) -> None:
    made, metrics = with_weight("min_range_m", weight), np.array(values)[:, None]
    assert made.constant_parts(metrics) == [
        f"tuning.metrics.min_range_m: found min_range_m = {found} in all 2 runs that have it, expected some between "
        "1e-09 and 1e+09, beyond which it counts as constant and has no gradient"
    ]
    np.testing.assert_array_equal(gradient(made, metrics), 0.0)


def test_a_part_with_a_value_within_its_range_is_not_constant() -> None:
    made = with_weight("min_range_m", 1.0)
    assert made.constant_parts(np.array([[0.0], [1e-8]])) == []
    every = objective(**dict.fromkeys(PART_METRICS, 1.0))
    assert every.constant_parts(np.ones((2, len(every.metric_names)))) == []
    lines = every.constant_parts(np.zeros((2, len(every.metric_names))))
    assert [line.partition(":")[0] for line in lines] == [
        "tuning.navigation", "tuning.formation", "tuning.delta_v", "tuning.pointing",
    ]  # fmt: skip


@pytest.mark.parametrize("metrics", [[[np.nan, np.nan]], [[12.0, np.nan]]])
def test_a_batch_without_any_nees_is_as_inconsistent_as_one_of_a_million(metrics: list[list[float]]) -> None:
    made = objective(consistency=1.0)
    penalty = 6.0 + 18.0 * np.log(1e6 / 6.0)
    assert made(np.array(metrics))[0] == pytest.approx(2.0 * (np.log(1e6 / 6.0) ** 2 + penalty))


def test_padding_does_not_count() -> None:
    made = objective(**dict.fromkeys(PART_METRICS, 1.0))
    metrics = 1.0 + np.random.default_rng(2).random((5, len(made.metric_names)))
    padded = np.concatenate([metrics, metrics[-1:], metrics[-1:]])
    mask = np.array([1.0] * 5 + [0.0] * 2)
    np.testing.assert_allclose(gradient(made, padded, mask)[:5], gradient(made, metrics), rtol=1e-12)
    np.testing.assert_array_equal(gradient(made, padded, mask)[5:], 0.0)


def test_the_gradient_is_that_of_the_value() -> None:
    made = objective(**dict.fromkeys(PART_METRICS, 0.7))
    rng = np.random.default_rng(2)
    metrics = 1.0 + rng.random((6, len(made.metric_names)))
    direction = rng.standard_normal(metrics.shape)
    up, down = (made(metrics + sign * 1e-6 * direction)[0] for sign in (1.0, -1.0))
    assert np.sum(gradient(made, metrics) * direction) == pytest.approx((up - down) / 2e-6, rel=1e-6)


def test_weights_of_zero_are_refused() -> None:
    with pytest.raises(ScenarioError, match="tuning: found 'no weight above zero', expected a weight for one of"):
        objective()
