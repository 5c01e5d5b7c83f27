"""The scripts of the experiments say by their exit status whether their figures hold."""

import sys
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest
from experiment_modules import load_experiment


@pytest.fixture
def measure() -> ModuleType:
    """The script of the inspection campaign, freshly loaded."""
    return load_experiment("inspection_campaign/measure.py")


@pytest.mark.parametrize(("peak_s", "status"), [(100.0, 0), (111.0, 1)])
def test_a_row_that_does_not_hold_makes_the_exit_status_1(
    measure: ModuleType, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], peak_s: float, status: int
) -> None:
    metrics = {"look_away_peak_s": np.array([90.0, peak_s]), "wheel_speed_peak_fraction": np.array([0.3, 0.4])}
    monkeypatch.setattr(measure, "campaign", lambda *_: SimpleNamespace(metrics=metrics))
    for part in ("errors", "consistency", "outliers"):
        monkeypatch.setattr(measure, part, lambda *_: None)
    monkeypatch.setattr(sys, "argv", ["measure.py", "--out", "nowhere"])
    assert measure.main() == status
    assert capsys.readouterr().out.count("**no**") == status
