"""Settings and scenarios that cannot be tuned."""

import inspect
from dataclasses import asdict
from typing import Any

import pytest

import rpojax
from rpojax.analysis.gradients.tuning.tunable_parameters import scenario_at_horizon, unreached_phases_warning
from rpojax.analysis.gradients.tuning.tuning_settings import TuningSettings
from rpojax.errors import RpojaxError


def test_runs_are_as_long_as_the_horizon_and_no_longer_than_the_scenario() -> None:
    file = rpojax.load("inspection", ["duration_s=1000.0"])
    settings = TuningSettings(("navigation",), horizon_s=400.0)
    assert scenario_at_horizon(file, settings).duration_s == 400.0
    assert scenario_at_horizon(file, TuningSettings(("navigation",))).duration_s == 1000.0
    assert scenario_at_horizon(rpojax.load("inspection"), TuningSettings(("navigation",))).duration_s == 2000.0


def test_by_default_runs_of_a_mission_of_phases_are_as_long_as_the_mission() -> None:
    file, settings = rpojax.load("vbar_approach"), TuningSettings(("navigation",))
    assert file.duration_s > 2000.0
    assert scenario_at_horizon(file, settings).duration_s == file.duration_s
    assert unreached_phases_warning(file, settings) is None
    shorter = TuningSettings(("navigation",), horizon_s=2000.0)
    assert scenario_at_horizon(file, shorter).duration_s == 2000.0
    found = unreached_phases_warning(file, shorter)
    assert found is not None
    assert found.startswith(f"horizon: 2000 s of a mission of {file.duration_s:g} s")
    for one_phase in ("inspection", "safety_ellipse"):
        assert unreached_phases_warning(rpojax.load(one_phase), shorter) is None
        assert scenario_at_horizon(rpojax.load(one_phase), settings).duration_s == 2000.0
    with pytest.raises(RpojaxError, match=r"^horizon_s: found 2000 \(phases.drift.until.time_s: .*in which the phases"):
        scenario_at_horizon(rpojax.load("rendezvous"), shorter)


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"steps": 0}, "steps: found 0, expected at least 1"),
        ({"runs": 0}, "runs: found 0"),
        ({"rate": float("nan")}, "rate: found nan"),
        ({"horizon_s": -1.0}, "horizon_s: found -1.0, expected a time above 0 s"),
        ({"seed": -1}, "seed: found -1"),
        ({"validation_runs": 1}, "validation_runs: found 1, expected 0 or at least 2"),
    ],
)
def test_settings_out_of_range_are_refused(changed: dict[str, Any], message: str) -> None:
    with pytest.raises(RpojaxError, match=f"^{message}"):
        TuningSettings(**changed)


def test_python_has_the_defaults_of_the_record() -> None:
    defaults = {name: each.default for name, each in inspect.signature(rpojax.tune).parameters.items()}
    assert asdict(TuningSettings()).items() <= defaults.items()


@pytest.mark.parametrize(
    ("override", "message"),
    [("camera.model=rendered", "camera.model: found 'rendered'"), ("design.kind=sobol", "design.kind: found 'sobol'")],
)
def test_what_has_no_gradient_is_refused(override: str, message: str) -> None:
    with pytest.raises(RpojaxError, match=message):
        scenario_at_horizon(rpojax.load("inspection", [override]), TuningSettings(("navigation",)))
