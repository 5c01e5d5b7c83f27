"""Settings and scenarios that cannot be tuned."""

from typing import Any

import pytest

import rpojax
from rpojax.analysis.gradients.tuning.tuning_settings import TuningSettings, scenario_at_horizon
from rpojax.errors import RpojaxError


def test_runs_are_as_long_as_the_horizon_and_no_longer_than_the_scenario() -> None:
    file = rpojax.load("inspection", ["duration_s=1000.0"])
    settings = TuningSettings(("navigation",), horizon_s=400.0)
    assert scenario_at_horizon(file, settings).duration_s == 400.0
    assert scenario_at_horizon(file, TuningSettings(("navigation",))).duration_s == 1000.0


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
def test_settings_out_of_range_are_refused(changed: dict[str, Any], message: str) -> None:
    with pytest.raises(RpojaxError, match=message):
        scenario_at_horizon(rpojax.load("inspection"), TuningSettings(**{"parameters": ("navigation",), **changed}))


@pytest.mark.parametrize(
    ("override", "message"),
    [("camera.model=rendered", "camera.model: found 'rendered'"), ("design.kind=sobol", "design.kind: found 'sobol'")],
)
def test_what_has_no_gradient_is_refused(override: str, message: str) -> None:
    with pytest.raises(RpojaxError, match=message):
        scenario_at_horizon(rpojax.load("inspection", [override]), TuningSettings(("navigation",)))
