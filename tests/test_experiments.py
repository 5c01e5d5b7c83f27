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


def test_a_table_of_variants_changes_what_they_say_and_draws_the_rest_as_declared() -> None:
    module = load_experiment("unseen_missions/mission_campaigns.py")
    variants = {
        "packaged": module.Variant(),
        "heavy": module.Variant({"servicer.mass_kg": 90.0, "formation.desired_position_m": (0.0, -10.0, 0.0)}),
        "fast": module.Variant({"target.tumble_rate_deg_s": 5.0}),
    }
    tables = module.table_scenario(variants, None, runs=400, seed=1)
    columns = {name: np.array(values).reshape(3, 400) for name, values in tables["design"]["values"].items()}
    np.testing.assert_array_equal(columns["formation.desired_position_m[1]"][:, 0], [-30.0, -10.0, -30.0])
    np.testing.assert_array_equal(columns["servicer.mass_kg"][1], 90.0)
    np.testing.assert_allclose(columns["servicer.mass_kg"][[0, 2]].std(axis=1), 0.3, rtol=0.15)
    rates = columns["target.tumble_rate_deg_s"]
    assert np.all(rates[2] == 5.0)
    assert 0.8 <= rates[:2].min() < 0.81 < 1.19 < rates[:2].max() <= 1.2
    left = {each["key"] for each in tables["dispersions"]}
    assert not left & {"servicer.mass_kg", "target.tumble_rate_deg_s"}
    assert "thruster.force_scale" in left
