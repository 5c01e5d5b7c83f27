"""The gradient estimator on synthetic runs."""

from dataclasses import replace

import numpy as np
import pytest
from quadratic_runs import ONE_WEIGHT, QuadraticRuns

import rpojax
from rpojax.analysis.gradients.rollout_evaluator import RolloutResult
from rpojax.analysis.gradients.tuning import gradient_descent, tunable_parameters
from rpojax.analysis.gradients.tuning.tuning_objective import Objective
from rpojax.simulation.noise import run_keys


@pytest.mark.parametrize(
    ("names", "mode"),
    [
        (("formation",), "differences"),
        (("attitude",), "reverse"),
        (("navigation.gps_noise_m",), "forward"),
        (("navigation.edge_noise_px",), "differences"),
        (("navigation",), "reverse and differences"),
    ],
)
def test_numbers_that_act_through_decisions_are_differentiated_by_differences(
    names: tuple[str, ...], mode: str
) -> None:
    assert (
        gradient_descent.differentiation_mode(
            tunable_parameters.select_parameters(rpojax.load("inspection"), names).nonsmooth
        )
        == mode
    )


def test_differences_point_away_from_the_side_where_a_run_loses_its_metric(monkeypatch: pytest.MonkeyPatch) -> None:
    file = rpojax.load("inspection", ONE_WEIGHT)
    objective = Objective(file)
    evaluator = QuadraticRuns(file, None, 8, objective.metric_names, 4, None, objective.gradient)
    x, keys, nonsmooth = QuadraticRuns.best + 0.3, run_keys(0, np.arange(4)), np.arange(8) > 1
    simulate = QuadraticRuns.evaluate

    def lose_the_last(self: QuadraticRuns, inputs: np.ndarray, keys: np.ndarray) -> RolloutResult:
        found = simulate(self, inputs, keys)
        metrics = np.full_like(found.metrics, 10.0)
        metrics[3] = np.where((inputs[3, 2:] > x[2:]).any(), np.nan, 10.0)
        return replace(found, metrics=metrics)

    monkeypatch.setattr(QuadraticRuns, "evaluate", lose_the_last)
    found = gradient_descent.estimate_gradient(evaluator, objective, nonsmooth, x, keys).gradient
    # One of four runs goes from 10 m to the worst, 1e7 m, over twice 0.4.
    np.testing.assert_allclose(found[2:], np.log(1e6) / 4.0 / 0.8, rtol=1e-12)


@pytest.mark.parametrize(
    ("gradients", "total", "excluded", "clipped"),
    [
        ([1.0, 2.0, 3.0], 6.0, 0, 0),
        ([1.0, 2.0, 1e6], 23.0, 0, 1),
        # Most runs have no metric, and the others are not clipped to nothing.
        ([1.0, 2.0, 0.0, 0.0, 0.0], 3.0, 0, 0),
        ([0.0, 0.0], 0.0, 0, 0),
        # The mean of the others stands for a run that is left out.
        ([1.0, 2.0, 3.0, np.nan], 8.0, 1, 0),
    ],
)
def test_gradients_are_clipped_at_ten_times_the_median(
    gradients: list[float], total: float, excluded: int, clipped: int
) -> None:
    found = gradient_descent.clipped_sum(np.array(gradients)[:, None])
    assert found == (pytest.approx([total]), excluded, clipped)
