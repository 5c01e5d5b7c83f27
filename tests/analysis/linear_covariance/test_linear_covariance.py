"""The analysis of a scenario with a synthetic covariance: what it refuses, and what it writes."""

import json
from pathlib import Path

import numpy as np
import pytest
from synthetic_linear_covariance import synthetic_linear_covariance

from rpojax.analysis.linear_covariance import linear_covariance, monte_carlo_agreement
from rpojax.errors import OutputError, RpojaxError
from rpojax.scenario.loading import scenario_loader
from rpojax.scenario.schema import ScenarioFile


@pytest.fixture(scope="module")
def file() -> ScenarioFile:
    return scenario_loader.load("inspection")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"runs": 5}, "runs: found 5, expected 0 or at least 10"),
        ({"members": 1}, "members: found 1, expected at least 2"),
        ({"seed": -1}, "seed: found -1"),
    ],
)
def test_numbers_out_of_range_are_refused(file: ScenarioFile, arguments: dict[str, int], message: str) -> None:
    with pytest.raises(RpojaxError, match=message):
        linear_covariance.linear_covariance(file, progress=False, **arguments)  # pyright: ignore[reportArgumentType]


def test_an_analysis_writes_its_record_and_arrays(
    file: ScenarioFile, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    linear, sample = synthetic_linear_covariance(scale=1.5)
    monkeypatch.setattr(linear_covariance, "propagate_covariance", lambda *_, **__: linear)
    monkeypatch.setattr(monte_carlo_agreement, "simulate_sample", lambda *_: sample)
    found = linear_covariance.linear_covariance(file, runs=400, progress=False)
    found.write(tmp_path / "out")
    content = json.loads((tmp_path / "out" / "lincov.json").read_text())
    assert content == found.to_dict()
    assert content["settings"]["runs"] == 400
    assert any(warning.startswith("rho_H x: off by more than 15 %") for warning in content["warnings"])
    with np.load(tmp_path / "out" / "lincov.npz") as arrays:
        assert set(arrays) == set(found.arrays())
        np.testing.assert_array_equal(arrays["rho_H_sigma"], linear.sigma("rho_H"))
    with pytest.raises(OutputError, match="exists already"):
        found.write(tmp_path / "out")


def test_results_are_labelled_arrays_with_units(file: ScenarioFile) -> None:
    linear, _ = synthetic_linear_covariance()
    found = linear_covariance.LinearCovarianceAnalysis(
        file, 2, 0, linear, linear_covariance.error_budget(linear), None, ()
    )
    labelled, arrays = found.to_xarray(), found.arrays()
    assert labelled["rho_H"].attrs["units"] == "m"
    assert labelled["rho_dot_H_sigma"].attrs["units"] == "m/s"
    for name in ("rho_H_sigma", "delta_v_m_s_sigma", "filter_sigma_H"):
        np.testing.assert_array_equal(labelled[name].to_numpy(), arrays[name])
    np.testing.assert_array_equal(labelled["time"].to_numpy(), arrays["time_s"])
