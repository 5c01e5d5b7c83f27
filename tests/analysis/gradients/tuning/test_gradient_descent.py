"""Gradient descent on synthetic runs whose best gains are known, and on simulated ones."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from quadratic_runs import ONE_WEIGHT, TUNED, QuadraticRuns

import rpojax
from rpojax.analysis.gradients.rollout_evaluator import RolloutResult
from rpojax.analysis.gradients.tuning import gradient_descent
from rpojax.analysis.gradients.tuning.gradient_descent import TuningStep
from rpojax.analysis.gradients.tuning.tuning_settings import TuningSettings
from rpojax.errors import Notice, ResultError, RpojaxError
from rpojax.scenario.schema import ScenarioFile


@pytest.fixture
def file(monkeypatch: pytest.MonkeyPatch) -> ScenarioFile:
    monkeypatch.setattr(gradient_descent, "RolloutEvaluator", QuadraticRuns)
    return rpojax.load("inspection", ONE_WEIGHT)


def test_a_descent_ends_at_the_optimum_in_spite_of_noise_and_jumps(file: ScenarioFile) -> None:
    found = gradient_descent.descend(file, TuningSettings(TUNED, runs=32, steps=100))
    np.testing.assert_allclose(found.coordinates, QuadraticRuns.best, atol=0.05)
    assert found.steps[-1].objective < 0.5 < 3.0 < found.steps[0].objective
    assert all(step.left_out == 1 for step in found.steps)
    assert sum(step.shortened for step in found.steps) > 50
    assert found.values["navigation.gps_noise_m"] == pytest.approx(np.exp(-1.0), rel=0.05)


class SteepStart(QuadraticRuns):
    """The same, with derivatives that are a million times longer at the first steps."""

    def __init__(self, *arguments: Any, **further: Any) -> None:
        super().__init__(*arguments, **further)
        self.calls = 0

    def gradient(self, inputs: np.ndarray, keys: np.ndarray, weights: np.ndarray | None = None) -> RolloutResult:
        found = super().gradient(inputs, keys, weights)
        self.calls += 1
        assert found.gradient is not None
        return replace(found, gradient=found.gradient * (1e6 if self.calls <= 5 else 1.0))


def test_restarts_forget_the_size_of_the_first_gradients(file: ScenarioFile, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(gradient_descent, "RolloutEvaluator", SteepStart)
    found = gradient_descent.descend(file, TuningSettings(TUNED, runs=32, steps=80))
    np.testing.assert_allclose(found.coordinates, QuadraticRuns.best, atol=0.1)


@pytest.mark.parametrize(
    ("steps", "starts"),
    [(1, [0]), (20, [0]), (39, [0]), (40, [0, 20]), (80, [0, 20, 40]), (200, [0, 20, 40, 60, 80, 100])],
)
def test_adam_restarts_every_twenty_steps_up_to_the_middle(steps: int, starts: list[int]) -> None:
    assert [number for number in range(steps) if gradient_descent._restarts(number, steps)] == starts


@pytest.mark.parametrize(("steps", "last"), [(12, 6), (42, 19), (42, 20), (42, 21)])
def test_a_resumed_descent_ends_where_an_uninterrupted_one_does(
    file: ScenarioFile, tmp_path: Path, steps: int, last: int
) -> None:
    settings, kept = TuningSettings(TUNED, runs=8, steps=steps), tmp_path / "descent.json"
    whole = gradient_descent.descend(file, settings)

    def stop(number: int, _: TuningStep) -> None:
        if number == last:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        gradient_descent.descend(file, settings, kept, on_step=stop)
    resumed = gradient_descent.descend(file, settings, kept, resume=True)
    np.testing.assert_array_equal(resumed.coordinates, whole.coordinates)
    assert [step.objective for step in resumed.steps] == [step.objective for step in whole.steps]


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (None, "found the progress of another tuning"),
        ('{"of": 1}', "found the progress of another tuning"),
        ("{}", "found KeyError"),
        ("[", "the progress of a tuning"),
    ],
)
def test_a_foreign_progress_file_is_refused(
    file: ScenarioFile, tmp_path: Path, content: str | None, message: str
) -> None:
    kept = tmp_path / "descent.json"
    gradient_descent.descend(file, TuningSettings(TUNED, runs=4, steps=2), kept)
    if content:
        kept.write_text(content)
    with pytest.raises(ResultError, match=message):
        gradient_descent.descend(file, TuningSettings(TUNED, runs=4, steps=3), kept, resume=True)


def test_a_new_descent_ignores_an_old_progress_file(file: ScenarioFile, tmp_path: Path) -> None:
    settings, kept = TuningSettings(TUNED, runs=4, steps=2), tmp_path / "descent.json"
    first = gradient_descent.descend(file, settings, kept)
    np.testing.assert_array_equal(gradient_descent.descend(file, settings, kept).coordinates, first.coordinates)


def test_a_descent_without_any_finite_gradient_stops(file: ScenarioFile, monkeypatch: pytest.MonkeyPatch) -> None:
    simulate = QuadraticRuns.gradient

    def without_gradient(*arguments: Any) -> RolloutResult:
        found = simulate(*arguments)
        assert found.gradient is not None
        return replace(found, gradient=np.full_like(found.gradient, np.nan))

    monkeypatch.setattr(QuadraticRuns, "gradient", without_gradient)
    with pytest.raises(RpojaxError, match="step 1: found no run with a finite gradient"):
        gradient_descent.descend(file, TuningSettings(TUNED, runs=4, steps=2))


def lose(monkeypatch: pytest.MonkeyPatch, lost: slice) -> None:
    """Makes the formation error of some runs undefined, as a running metric is that nothing counts for."""
    simulate = QuadraticRuns.gradient

    def without_metric(*arguments: Any) -> RolloutResult:
        found = simulate(*arguments)
        assert found.gradient is not None
        metrics, gradient = found.metrics.copy(), found.gradient.copy()
        metrics[lost], gradient[lost] = np.nan, 0.0
        return replace(found, metrics=metrics, gradient=gradient)

    monkeypatch.setattr(QuadraticRuns, "gradient", without_metric)


def test_runs_without_a_metric_are_counted_at_every_step(file: ScenarioFile, monkeypatch: pytest.MonkeyPatch) -> None:
    lose(monkeypatch, slice(1, 3))
    kept: list[TuningStep] = []
    found = gradient_descent.descend(
        file, TuningSettings(TUNED, runs=8, steps=2), on_step=lambda _, step: kept.append(step)
    )
    assert [step.undefined for step in found.steps] == [{"formation": 2}] * 2 == [step.undefined for step in kept]
    assert all(step.left_out == 1 for step in found.steps)


def test_a_start_without_any_value_of_a_part_is_refused(file: ScenarioFile, monkeypatch: pytest.MonkeyPatch) -> None:
    lose(monkeypatch, slice(None))
    with pytest.raises(
        RpojaxError, match=r"^tuning.formation: found no run of 4 with formation_error_rms_m, expected some; "
    ):
        gradient_descent.descend(file, TuningSettings(TUNED, runs=4, steps=2))


def test_a_part_that_is_zero_in_every_run_is_warned_of_once(
    file: ScenarioFile, monkeypatch: pytest.MonkeyPatch
) -> None:
    simulate = QuadraticRuns.gradient

    def zero(*arguments: Any) -> RolloutResult:
        found = simulate(*arguments)
        return replace(found, metrics=np.zeros_like(found.metrics))

    monkeypatch.setattr(QuadraticRuns, "gradient", zero)
    with pytest.warns(Notice) as caught:
        gradient_descent.descend(file, TuningSettings(TUNED, runs=8, steps=2))
    assert [str(each.message) for each in caught] == [
        "warning: tuning.formation: found formation_error_rms_m = 0 in all 8 runs that have it, expected some between "
        "1e-09 and 1e+07, beyond which it counts as constant and has no gradient"
    ]


@pytest.mark.slow
def test_a_too_large_box_noise_is_tuned_back(tmp_path: Path) -> None:
    start = rpojax.load("inspection", ["navigation.edge_noise_px=10.0"])
    found = gradient_descent.descend(
        start, TuningSettings(("navigation.edge_noise_px",), runs=16, steps=40, horizon_s=400.0)
    )
    assert found.mode == "differences"  # it acts through the gate
    assert 0.5 < found.values["navigation.edge_noise_px"] < 3.0
