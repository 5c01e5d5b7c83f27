"""Derivatives of metrics with respect to scenario keys."""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import rpojax
from rpojax.analysis.gradients import scenario_gradient
from rpojax.analysis.gradients.rollout_evaluator import RolloutEvaluator, RolloutResult
from rpojax.analysis.gradients.scenario_gradient import Gradient

CALM = ["duration_s=120", "camera.outlier_probability=0.0"]
METRIC = "nav_relative_position_error_rms_m"


class SquaredValues(RolloutEvaluator):
    """Takes the place of rollouts: the metric of a run is half the sum of squares of its values of two keys."""

    def __init__(self, file: Any, input_function: Callable[..., Any], *_: Any, **__: Any) -> None:
        self._values, self.compile_s = input_function, 0.0

    def jacobian(self, inputs: np.ndarray, keys: np.ndarray) -> Any:
        def metric(shifts: jax.Array, key: jax.Array) -> jax.Array:
            values = self._values(shifts, key)
            return 0.5 * (values["servicer.mass_kg"] ** 2 + jnp.sum(values["formation.desired_position_m"] ** 2))

        rows = [(jnp.asarray(x), jnp.asarray(key)) for x, key in zip(inputs, keys, strict=True)]
        return RolloutResult(
            metrics=np.array([[metric(*row)] for row in rows]),
            jacobian=np.array([[jax.jacfwd(metric)(*row)] for row in rows]),
            gradient=None,
            failed=np.array([False, True, False]),
            events=np.zeros(3, dtype=np.uint32),
        )


def test_keys_are_shifted_from_the_dispersed_value_of_each_run(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(scenario_gradient, "RolloutEvaluator", SquaredValues)
    file = rpojax.load("inspection")
    keys = ["servicer.mass_kg", "formation.desired_position_m"]
    found = rpojax.gradient(file, keys, [METRIC], runs=3, seed=3, progress=False)
    # The derivative of half a square is the value itself: dispersed for the mass, nominal for the place.
    mass = found.derivatives[METRIC]["servicer.mass_kg"]
    assert mass.shape == (3,)
    assert len(set(mass.tolist())) == 3
    drawn = [float(rpojax.initialise_run(file, 3, run_id)[1].plant.servicer.mass) for run_id in range(3)]
    np.testing.assert_allclose(mass, drawn)
    place = found.derivatives[METRIC]["formation.desired_position_m"]
    np.testing.assert_allclose(place, [file.formation.desired_position_m] * 3)
    np.testing.assert_allclose(found.mean(METRIC)["servicer.mass_kg"], mass[[0, 2]].mean())
    error = found.standard_error(METRIC)["servicer.mass_kg"]
    np.testing.assert_allclose(error, abs(mass[0] - mass[2]) / 2.0)
    assert found.completed.tolist() == [True, False, True]


def made_gradient(metric: list[float]) -> Gradient:
    """Derivatives 0, 1 and 2 of a metric of three runs, of which the last one failed."""
    return Gradient(
        run_ids=np.arange(3),
        metrics={METRIC: np.array(metric)},
        derivatives={METRIC: {"gps.noise_m": np.where(np.isnan(metric), np.nan, np.arange(3.0))}},
        completed=np.array([True, True, False]),
        events=np.zeros(3, dtype=np.uint32),
        mode="forward",
        compile_s=0.0,
    )


def test_runs_without_the_metric_are_in_no_mean() -> None:
    assert made_gradient([1.0, 2.0, 3.0]).mean(METRIC)["gps.noise_m"] == 0.5
    found = made_gradient([np.nan, 2.0, 3.0])
    assert found.counts(METRIC).tolist() == [False, True, False]
    assert found.mean(METRIC)["gps.noise_m"] == 1.0
    with pytest.raises(rpojax.RpojaxError, match=f"^{METRIC}: found 1 completed runs with a value, expected"):
        found.standard_error(METRIC)
    with pytest.raises(rpojax.RpojaxError, match=f"^{METRIC}: found 0 completed runs with a value, expected"):
        made_gradient([np.nan, np.nan, 3.0]).mean(METRIC)


@pytest.mark.slow
def test_derivatives_agree_with_central_differences() -> None:
    keys = ["navigation.edge_noise_px", "initial.relative_position_m"]
    file = rpojax.load("inspection", CALM)
    found = rpojax.gradient(file, keys, [METRIC], runs=2, seed=3, progress=False)
    assert found.derivatives[METRIC][keys[0]].shape == (2,)
    assert found.derivatives[METRIC][keys[1]].shape == (2, 3)
    assert found.completed.all()
    assert found.mode == "forward"
    backward = rpojax.gradient(file, keys, [METRIC], runs=2, seed=3, mode="reverse", progress=False)
    for key in keys:
        there, back = found.derivatives[METRIC][key], backward.derivatives[METRIC][key]
        # Both modes carry out the same derivative; sums are taken in another order.
        np.testing.assert_allclose(back, there, rtol=1e-7, atol=1e-10 * np.abs(there).max())
    nominal, step = file.navigation.edge_noise_px, 1e-5
    sides = [
        rpojax.gradient(
            rpojax.load("inspection", [*CALM, f"navigation.edge_noise_px={nominal + sign * step}"]),
            keys[:1],
            [METRIC],
            runs=2,
            seed=3,
            progress=False,
        )
        for sign in (1.0, -1.0)
    ]
    quiet = (sides[0].events == found.events) & (sides[1].events == found.events)
    assert quiet.any()
    central = (sides[0].metrics[METRIC] - sides[1].metrics[METRIC]) / (2.0 * step)
    # The truncation error of the differences is of order step^2, their rounding error 1e-16 / step.
    np.testing.assert_allclose(found.derivatives[METRIC][keys[0]][quiet], central[quiet], rtol=1e-5, atol=1e-8)
    np.testing.assert_allclose(found.mean(METRIC)[keys[1]], found.derivatives[METRIC][keys[1]].mean(axis=0))


@pytest.mark.parametrize(
    ("keys", "metrics", "settings", "words"),
    [
        ([], [METRIC], {}, "keys"),
        (["servicer.mas_kg"], [METRIC], {}, "servicer.mas_kg"),
        (["faults.fault.kind"], [METRIC], {}, "faults.fault.kind"),
        (["servicer.mass_kg"], ["no_such_metric"], {}, "no_such_metric"),
        (["servicer.mass_kg"], [METRIC], {"runs": 0}, "runs"),
        (["servicer.mass_kg"], [METRIC], {"mode": "sideways"}, "sideways"),
        (["servicer.mass_kg"], [METRIC], {"gates": "ramps"}, "gates: found 'ramps', expected 'slopes' or 'steps'"),
        (["servicer.mass_kg"], [METRIC], {"temperature": 0.25}, "^temperature: found camera.model = 'geometric'"),
        (["imaging.field.features"], [METRIC], {}, "^imaging.field.features: found a scenario without a rendered"),
    ],
)
def test_what_has_no_derivative_is_refused_before_anything_is_compiled(keys, metrics, settings, words) -> None:
    with pytest.raises(rpojax.RpojaxError, match=words):
        scenario_gradient.gradient(rpojax.load("inspection", CALM), keys, metrics, **settings)


@pytest.mark.parametrize(
    ("override", "words"),
    [("design.kind=sobol", "independent"), ("camera.model=rendered", "'geometric' or 'statistical'")],
)
def test_designs_and_the_rendered_camera_are_refused(override: str, words: str) -> None:
    file = rpojax.load("inspection", [*CALM, override])
    with pytest.raises(rpojax.RpojaxError, match=words):
        scenario_gradient.gradient(file, ["servicer.mass_kg"], [METRIC])


@pytest.mark.parametrize(
    ("keys", "settings", "words"),
    [
        (["imaging.exposure"], {"temperature": 0.0}, "^temperature: found 0, expected a positive number$"),
        (["imaging.exposure"], {"temperature": float("nan")}, "^temperature: found nan, expected a positive number$"),
        (["imaging.exposure"], {"gates": "steps"}, "^gates: found 'steps', expected 'slopes' with a soft detector$"),
        (["imaging.detector.second.out.bia"], {}, "^imaging.detector.second.out.bia: found no such tensor"),
    ],
)
def test_a_soft_detector_has_a_temperature_smooth_gates_and_known_tensors(keys, settings, words) -> None:
    file = rpojax.load("inspection", [*CALM, "camera.model=rendered"])
    with pytest.raises(rpojax.RpojaxError, match=words):
        scenario_gradient.gradient(file, keys, [METRIC], **{"temperature": 0.25, **settings})


@pytest.mark.slow
def test_a_gradient_through_pixels_is_the_same_in_both_modes() -> None:
    file = rpojax.load("inspection", ["duration_s=6", "camera.model=rendered"])
    keys = ["imaging.exposure", "imaging.detector.first.out.bias", "imaging.field.network.2.bias"]
    there, back = (
        rpojax.gradient(file, keys, [METRIC], runs=2, seed=5, mode=mode, temperature=0.25, progress=False)
        for mode in ("forward", "reverse")
    )
    for key in keys:
        found, other = there.derivatives[METRIC][key], back.derivatives[METRIC][key]
        assert np.abs(found).max() > 0.0
        # Pictures and networks are in single precision, of which both modes take sums in another order.
        np.testing.assert_allclose(other, found, rtol=1e-2, atol=1e-3 * np.abs(found).max())


def test_derivatives_are_labelled_arrays() -> None:
    values = {"gps.noise_m": np.arange(3.0), "formation.desired_position_m": np.ones((3, 3))}
    found = Gradient(
        run_ids=np.array([4, 5, 6]),
        metrics={"delta_v_m_s": np.array([0.1, 0.2, 0.3])},
        derivatives={"delta_v_m_s": values},
        completed=np.array([True, True, False]),
        events=np.zeros(3, dtype=np.uint32),
        mode="forward",
        compile_s=0.0,
    )
    labelled = found.to_xarray()
    np.testing.assert_array_equal(labelled["d_delta_v_m_s/d_gps.noise_m"].to_numpy(), values["gps.noise_m"])
    assert labelled["d_delta_v_m_s/d_formation.desired_position_m"].shape == (3, 3)
    assert labelled["run"].to_numpy().tolist() == [4, 5, 6]
