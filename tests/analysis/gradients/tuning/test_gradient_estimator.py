"""The gradient estimator on synthetic runs."""

from dataclasses import replace

import numpy as np
import pytest
from quadratic_runs import ONE_WEIGHT, QuadraticRuns

import rpojax
from rpojax.analysis.gradients.rollout_evaluator import RolloutResult, run_keys
from rpojax.analysis.gradients.tuning import gradient_estimator, tunable_parameters
from rpojax.analysis.gradients.tuning.tuning_objective import Objective


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
        gradient_estimator.differentiation_mode(
            tunable_parameters.select_parameters(rpojax.load("inspection"), names).nonsmooth
        )
        == mode
    )


def test_a_run_that_fails_on_one_side_counts_on_neither(monkeypatch: pytest.MonkeyPatch) -> None:
    file = rpojax.load("inspection", ONE_WEIGHT)
    objective = Objective(file)
    evaluator = QuadraticRuns(file, None, 8, objective.metric_names, 4, None, objective.gradient)
    x, keys, nonsmooth = QuadraticRuns.best + 0.3, run_keys(0, np.arange(4)), np.arange(8) > 1
    whole = gradient_estimator.estimate_gradient(evaluator, objective, nonsmooth, x, keys[:3]).gradient[2:]
    simulate = QuadraticRuns.evaluate

    def fail_the_last(self: QuadraticRuns, inputs: np.ndarray, keys: np.ndarray) -> RolloutResult:
        kept = simulate(self, inputs[:3], keys[:3]).metrics
        above = inputs[3, 2:] > x[2:]
        metrics = np.concatenate([kept, np.where(above.any(), np.nan, 1e9)[None, None]])
        return replace(simulate(self, inputs, keys), metrics=metrics)

    monkeypatch.setattr(QuadraticRuns, "evaluate", fail_the_last)
    np.testing.assert_allclose(
        gradient_estimator.estimate_gradient(evaluator, objective, nonsmooth, x, keys).gradient[2:], whole, rtol=1e-9
    )
