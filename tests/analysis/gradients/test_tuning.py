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
from rpojax.analysis.gradients import gradient_estimator, tunable_parameters, tuning
from rpojax.analysis.gradients.run_derivatives import Flights, Found, run_keys
from rpojax.analysis.gradients.tuning import Settings
from rpojax.analysis.gradients.tuning_objective import Objective
from rpojax.errors import ResultError, RpojaxError
from rpojax.scenario.schema import ScenarioFile

CHOSEN = ("attitude_control.bandwidth_rad_s", "navigation.gps_noise_m", "formation")


class Bowl(Flights):
    """Runs whose formation error is least at known coordinates, with noise from their keys and some jumps.

    Derivatives to the weights of the control law, the last six, are those between two decisions: they point uphill.
    """

    best = np.array([0.5, -1.0, 0.3, 0.2, 0.1, 10.2, 10.1, 10.0])

    def __init__(self, file: ScenarioFile, inputs: Any, count: int, names: tuple[str, ...], *rest: Any) -> None:
        self.count, self.names, self.compile_s, self.memory_bytes, self.size = count, names, 0.0, 0, 64
        self._mesh = Mesh(np.array(jax.devices()[:1]), ("runs",))
        self._slope = rest[2]

    def _off(self, numbers: np.ndarray, keys: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.random.Generator]:
        rng = np.random.default_rng(keys.astype(np.uint32).tolist())
        off = numbers - self.best + 0.1 * rng.standard_normal(numbers.shape)
        return off, np.exp(np.sum(off**2, axis=1, keepdims=True)), rng

    def values(self, numbers: np.ndarray, keys: np.ndarray) -> Found:
        _, figures, _ = self._off(numbers, keys)
        return Found(figures, None, None, np.zeros(len(numbers), dtype=bool), np.zeros(len(numbers)))

    def reverse(self, numbers: np.ndarray, keys: np.ndarray, weights: np.ndarray | None = None) -> Found:
        off, figures, rng = self._off(numbers, keys)
        slope = self._slope(*map(jnp.asarray, (figures, figures, np.ones(len(figures)))))
        gradient = np.asarray(slope) * figures * 2.0 * off
        gradient[:, 2:] *= -3.0
        gradient[rng.random(len(gradient)) < 0.05] *= 1e4
        gradient[0, 0] = np.nan
        return Found(figures, None, gradient, np.zeros(len(numbers), dtype=bool), np.zeros(len(numbers)))


@pytest.fixture
def file(monkeypatch: pytest.MonkeyPatch) -> ScenarioFile:
    monkeypatch.setattr(tuning, "Flights", Bowl)
    weights = [
        f"tuning.{name}=0" for name in ("innovations", "estimate", "consistency", "navigation", "delta_v", "pointing")
    ]
    return rpojax.load("inspection", [*weights, "tuning.formation=1"])


def test_a_walk_ends_at_the_best_place_in_spite_of_noise_and_jumps(file: ScenarioFile) -> None:
    found = tuning.tune(file, Settings(CHOSEN, runs=32, steps=100))
    np.testing.assert_allclose(found.x, Bowl.best, atol=0.05)
    assert found.steps[-1].objective < 0.5 < 3.0 < found.steps[0].objective
    assert all(step.left_out == 1 for step in found.steps)
    assert sum(step.shortened for step in found.steps) > 50
    assert found.values["navigation.gps_noise_m"] == pytest.approx(np.exp(-1.0), rel=0.05)


class Cliff(Bowl):
    """The same, with derivatives that are a million times longer at the first steps."""

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self.seen = 0

    def reverse(self, numbers: np.ndarray, keys: np.ndarray, weights: np.ndarray | None = None) -> Found:
        found = super().reverse(numbers, keys, weights)
        self.seen += 1
        assert found.gradient is not None
        return replace(found, gradient=found.gradient * (1e6 if self.seen <= 5 else 1.0))


def test_a_walk_forgets_how_long_the_first_gradients_were(file: ScenarioFile, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tuning, "Flights", Cliff)
    found = tuning.tune(file, Settings(CHOSEN, runs=32, steps=80))
    np.testing.assert_allclose(found.x, Bowl.best, atol=0.1)


@pytest.mark.parametrize(
    ("steps", "starts"),
    [(1, [0]), (20, [0]), (39, [0]), (40, [0, 20]), (80, [0, 20, 40]), (200, [0, 20, 40, 60, 80, 100])],
)
def test_a_walk_starts_afresh_every_twenty_steps_up_to_its_middle(steps: int, starts: list[int]) -> None:
    assert [number for number in range(steps) if tuning._starts_afresh(number, steps)] == starts


@pytest.mark.parametrize(("steps", "last"), [(12, 6), (42, 19), (42, 20), (42, 21)])
def test_an_interrupted_walk_ends_where_it_would_have_ended(
    file: ScenarioFile, tmp_path: Path, steps: int, last: int
) -> None:
    settings, kept = Settings(CHOSEN, runs=8, steps=steps), tmp_path / "walk.json"
    whole = tuning.tune(file, settings)

    def stop(number: int, _: tuning.Step) -> None:
        if number == last:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        tuning.tune(file, settings, kept, tell=stop)
    resumed = tuning.tune(file, settings, kept, resume=True)
    np.testing.assert_array_equal(resumed.x, whole.x)
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
    tuning.tune(file, Settings(CHOSEN, runs=4, steps=2), kept)
    if content:
        kept.write_text(content)
    with pytest.raises(ResultError, match=message):
        tuning.tune(file, Settings(CHOSEN, runs=4, steps=3), kept, resume=True)


def test_a_new_walk_leaves_the_old_one_aside(file: ScenarioFile, tmp_path: Path) -> None:
    settings, kept = Settings(CHOSEN, runs=4, steps=2), tmp_path / "walk.json"
    first = tuning.tune(file, settings, kept)
    np.testing.assert_array_equal(tuning.tune(file, settings, kept).x, first.x)


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
        tuning.tune(file, Settings(**{"parameters": CHOSEN, **changed}))


@pytest.mark.parametrize(
    ("override", "message"),
    [("camera.model=rendered", "camera.model: found 'rendered'"), ("design.kind=sobol", "design.kind: found 'sobol'")],
)
def test_what_has_no_gradient_is_refused(override: str, message: str) -> None:
    with pytest.raises(RpojaxError, match=message):
        tuning.tune(rpojax.load("inspection", [override]), Settings(CHOSEN))


def test_a_walk_without_any_finite_gradient_stops(file: ScenarioFile, monkeypatch: pytest.MonkeyPatch) -> None:
    fly = Bowl.reverse

    def lost(*arguments: Any) -> Found:
        found = fly(*arguments)
        assert found.gradient is not None
        return replace(found, gradient=np.full_like(found.gradient, np.nan))

    monkeypatch.setattr(Bowl, "reverse", lost)
    with pytest.raises(RpojaxError, match="step 1: found no run with a finite gradient"):
        tuning.tune(file, Settings(CHOSEN, runs=4, steps=2))


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
    assert gradient_estimator.mode(tunable_parameters.choose(rpojax.load("inspection"), words).decides) == mode


def test_a_run_that_is_lost_on_one_side_counts_on_none(file: ScenarioFile, monkeypatch: pytest.MonkeyPatch) -> None:
    objective = Objective(file)
    flights = Bowl(file, None, 8, objective.names, 4, None, objective.slope)
    x, keys, decides = Bowl.best + 0.3, run_keys(0, np.arange(4)), np.arange(8) > 1
    whole = gradient_estimator.gradient(flights, objective, decides, x, keys[:3]).total[2:]
    fly = Bowl.values

    def lose_the_last(self: Bowl, numbers: np.ndarray, keys: np.ndarray) -> Found:
        kept = fly(self, numbers[:3], keys[:3]).figures
        above = numbers[3, 2:] > x[2:]
        figures = np.concatenate([kept, np.where(above.any(), np.nan, 1e9)[None, None]])
        return replace(fly(self, numbers, keys), figures=figures)

    monkeypatch.setattr(Bowl, "values", lose_the_last)
    np.testing.assert_allclose(
        gradient_estimator.gradient(flights, objective, decides, x, keys).total[2:], whole, rtol=1e-9
    )


@pytest.mark.slow
def test_a_filter_that_doubts_its_boxes_learns_better(tmp_path: Path) -> None:
    start = rpojax.load("inspection", ["navigation.edge_noise_px=10.0"])
    found = tuning.tune(start, Settings(("navigation.edge_noise_px",), runs=16, steps=40, horizon_s=400.0))
    assert found.mode == "differences"  # the gate decides by it
    assert 0.5 < found.values["navigation.edge_noise_px"] < 3.0
