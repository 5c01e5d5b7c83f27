"""The walk of a tuning: on a made-up loop whose best gains are known, and on the real one."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.sharding import Mesh

import rpojax
from rpojax.analysis.gradients import gradient_descent, gradient_estimator, tunable_parameters
from rpojax.analysis.gradients.gradient_descent import TuningSettings
from rpojax.analysis.gradients.rollout_evaluator import RolloutEvaluator, RolloutResult, run_keys
from rpojax.analysis.gradients.tuning_objective import Objective
from rpojax.errors import ResultError, RpojaxError
from rpojax.scenario.schema import ScenarioFile

CHOSEN = ("attitude_control.bandwidth_rad_s", "navigation.gps_noise_m", "formation")


class Bowl(RolloutEvaluator):
    """Runs whose formation error is least at known coordinates, with noise from their keys and some jumps.

    Derivatives to the weights of the control law, the last six, are those between two decisions: they point uphill.
    """

    best = np.array([0.5, -1.0, 0.3, 0.2, 0.1, 10.2, 10.1, 10.0])

    def __init__(self, file: ScenarioFile, input_function: Any, count: int, names: tuple[str, ...], *rest: Any) -> None:
        self.input_count, self.metric_names, self.compile_s = count, names, 0.0
        self.program_memory_bytes, self.runs_per_device = 0, 64
        self._mesh = Mesh(np.array(jax.devices()[:1]), ("runs",))
        self._cotangent = rest[2]

    def _off(self, inputs: np.ndarray, keys: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.random.Generator]:
        rng = np.random.default_rng(keys.astype(np.uint32).tolist())
        off = inputs - self.best + 0.1 * rng.standard_normal(inputs.shape)
        return off, np.exp(np.sum(off**2, axis=1, keepdims=True)), rng

    def evaluate(self, inputs: np.ndarray, keys: np.ndarray) -> RolloutResult:
        _, metrics, _ = self._off(inputs, keys)
        return RolloutResult(metrics, None, None, np.zeros(len(inputs), dtype=bool), np.zeros(len(inputs)))

    def gradient(self, inputs: np.ndarray, keys: np.ndarray, weights: np.ndarray | None = None) -> RolloutResult:
        off, metrics, rng = self._off(inputs, keys)
        cotangent = self._cotangent(*map(jnp.asarray, (metrics, metrics, np.ones(len(metrics)))))
        gradient = np.asarray(cotangent) * metrics * 2.0 * off
        gradient[:, 2:] *= -3.0
        gradient[rng.random(len(gradient)) < 0.05] *= 1e4
        gradient[0, 0] = np.nan
        return RolloutResult(metrics, None, gradient, np.zeros(len(inputs), dtype=bool), np.zeros(len(inputs)))


@pytest.fixture
def file(monkeypatch: pytest.MonkeyPatch) -> ScenarioFile:
    monkeypatch.setattr(gradient_descent, "RolloutEvaluator", Bowl)
    weights = [
        f"tuning.{name}=0" for name in ("innovations", "estimate", "consistency", "navigation", "delta_v", "pointing")
    ]
    return rpojax.load("inspection", [*weights, "tuning.formation=1"])


def test_a_walk_ends_at_the_best_place_in_spite_of_noise_and_jumps(file: ScenarioFile) -> None:
    found = gradient_descent.descend(file, TuningSettings(CHOSEN, runs=32, steps=100))
    np.testing.assert_allclose(found.coordinates, Bowl.best, atol=0.05)
    assert found.steps[-1].objective < 0.5 < 3.0 < found.steps[0].objective
    assert all(step.left_out == 1 for step in found.steps)
    assert sum(step.shortened for step in found.steps) > 50
    assert found.values["navigation.gps_noise_m"] == pytest.approx(np.exp(-1.0), rel=0.05)


class Cliff(Bowl):
    """The same, with derivatives that are a million times longer at the first steps."""

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self.seen = 0

    def gradient(self, inputs: np.ndarray, keys: np.ndarray, weights: np.ndarray | None = None) -> RolloutResult:
        found = super().gradient(inputs, keys, weights)
        self.seen += 1
        assert found.gradient is not None
        return replace(found, gradient=found.gradient * (1e6 if self.seen <= 5 else 1.0))


def test_a_walk_forgets_how_long_the_first_gradients_were(file: ScenarioFile, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(gradient_descent, "RolloutEvaluator", Cliff)
    found = gradient_descent.descend(file, TuningSettings(CHOSEN, runs=32, steps=80))
    np.testing.assert_allclose(found.coordinates, Bowl.best, atol=0.1)


@pytest.mark.parametrize(
    ("steps", "starts"),
    [(1, [0]), (20, [0]), (39, [0]), (40, [0, 20]), (80, [0, 20, 40]), (200, [0, 20, 40, 60, 80, 100])],
)
def test_a_walk_starts_afresh_every_twenty_steps_up_to_its_middle(steps: int, starts: list[int]) -> None:
    assert [number for number in range(steps) if gradient_descent._restarts(number, steps)] == starts


@pytest.mark.parametrize(("steps", "last"), [(12, 6), (42, 19), (42, 20), (42, 21)])
def test_an_interrupted_walk_ends_where_it_would_have_ended(
    file: ScenarioFile, tmp_path: Path, steps: int, last: int
) -> None:
    settings, kept = TuningSettings(CHOSEN, runs=8, steps=steps), tmp_path / "walk.json"
    whole = gradient_descent.descend(file, settings)

    def stop(number: int, _: gradient_descent.TuningStep) -> None:
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
    kept = tmp_path / "walk.json"
    gradient_descent.descend(file, TuningSettings(CHOSEN, runs=4, steps=2), kept)
    if content:
        kept.write_text(content)
    with pytest.raises(ResultError, match=message):
        gradient_descent.descend(file, TuningSettings(CHOSEN, runs=4, steps=3), kept, resume=True)


def test_a_new_walk_leaves_the_old_one_aside(file: ScenarioFile, tmp_path: Path) -> None:
    settings, kept = TuningSettings(CHOSEN, runs=4, steps=2), tmp_path / "walk.json"
    first = gradient_descent.descend(file, settings, kept)
    np.testing.assert_array_equal(gradient_descent.descend(file, settings, kept).coordinates, first.coordinates)


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"steps": 0}, "--steps: found 0, expected at least 1"),
        ({"runs": 0}, "--runs: found 0"),
        ({"rate": float("nan")}, "--rate: found nan"),
        ({"horizon_s": -1.0}, "--horizon: found -1.0, expected a time above 0 s"),
        ({"seed": -1}, "--seed: found -1"),
    ],
)
def test_settings_that_make_no_sense_are_refused(file: ScenarioFile, changed: dict[str, Any], message: str) -> None:
    with pytest.raises(RpojaxError, match=message):
        gradient_descent.descend(file, TuningSettings(**{"parameters": CHOSEN, **changed}))


@pytest.mark.parametrize(
    ("override", "message"),
    [("camera.model=rendered", "camera.model: found 'rendered'"), ("design.kind=sobol", "design.kind: found 'sobol'")],
)
def test_what_has_no_gradient_is_refused(override: str, message: str) -> None:
    with pytest.raises(RpojaxError, match=message):
        gradient_descent.descend(rpojax.load("inspection", [override]), TuningSettings(CHOSEN))


def test_a_walk_without_any_finite_gradient_stops(file: ScenarioFile, monkeypatch: pytest.MonkeyPatch) -> None:
    simulate = Bowl.gradient

    def lost(*arguments: Any) -> RolloutResult:
        found = simulate(*arguments)
        assert found.gradient is not None
        return replace(found, gradient=np.full_like(found.gradient, np.nan))

    monkeypatch.setattr(Bowl, "gradient", lost)
    with pytest.raises(RpojaxError, match="step 1: found no run with a finite gradient"):
        gradient_descent.descend(file, TuningSettings(CHOSEN, runs=4, steps=2))


@pytest.mark.parametrize(
    ("words", "mode"),
    [
        (("formation",), "differences"),
        (("attitude",), "reverse"),
        (("navigation.gps_noise_m",), "forward"),
        (("navigation.edge_noise_px",), "differences"),
        (("navigation",), "reverse and differences"),
    ],
)
def test_numbers_that_act_through_decisions_are_told_by_differences(words: tuple[str, ...], mode: str) -> None:
    assert (
        gradient_estimator.differentiation_mode(
            tunable_parameters.select_parameters(rpojax.load("inspection"), words).nonsmooth
        )
        == mode
    )


def test_a_run_that_is_lost_on_one_side_counts_on_none(file: ScenarioFile, monkeypatch: pytest.MonkeyPatch) -> None:
    objective = Objective(file)
    flights = Bowl(file, None, 8, objective.metric_names, 4, None, objective.gradient)
    x, keys, decides = Bowl.best + 0.3, run_keys(0, np.arange(4)), np.arange(8) > 1
    whole = gradient_estimator.estimate_gradient(flights, objective, decides, x, keys[:3]).gradient[2:]
    simulate = Bowl.evaluate

    def lose_the_last(self: Bowl, inputs: np.ndarray, keys: np.ndarray) -> RolloutResult:
        kept = simulate(self, inputs[:3], keys[:3]).metrics
        above = inputs[3, 2:] > x[2:]
        metrics = np.concatenate([kept, np.where(above.any(), np.nan, 1e9)[None, None]])
        return replace(simulate(self, inputs, keys), metrics=metrics)

    monkeypatch.setattr(Bowl, "evaluate", lose_the_last)
    np.testing.assert_allclose(
        gradient_estimator.estimate_gradient(flights, objective, decides, x, keys).gradient[2:], whole, rtol=1e-9
    )


@pytest.mark.slow
def test_a_filter_that_doubts_its_boxes_learns_better(tmp_path: Path) -> None:
    start = rpojax.load("inspection", ["navigation.edge_noise_px=10.0"])
    found = gradient_descent.descend(
        start, TuningSettings(("navigation.edge_noise_px",), runs=16, steps=40, horizon_s=400.0)
    )
    assert found.mode == "differences"  # the gate decides by it
    assert 0.5 < found.values["navigation.edge_noise_px"] < 3.0
