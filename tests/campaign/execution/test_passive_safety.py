"""Metrics of free drifts of a batch: from records, in rounds, for each run by its own parameters."""

from typing import Any

import jax
import numpy as np
import pytest

from rpojax.campaign.execution import passive_safety
from rpojax.campaign.execution.passive_safety import PassiveSafety
from rpojax.campaign.single_run import nominal_parameters
from rpojax.scenario.loading import scenario_loader
from rpojax.simulation import initial_state
from rpojax.simulation.noise import run_key

TICKS = 400
RUNS = 3
RADII = np.array([10.0, 500.0, 20.0])
BOUND = {"bound": "at least", "limit": 1.0, "probability": 0.9, "consumer_risk": 0.1}


@pytest.fixture(scope="module")
def inputs() -> tuple[PassiveSafety, dict[str, np.ndarray], dict[str, np.ndarray]]:
    """Runs at rest 50 m behind the target, with their own keep-out spheres, and one burn in the second."""
    file = scenario_loader.load(
        "inspection", [f"duration_s={TICKS}", "safety.horizons=['1_h', '1_orbit', '24_h']", "safety.spacing_s=50"]
    )
    scenario, nominal = nominal_parameters(file)
    truth = jax.jit(initial_state.init, static_argnums=0)(scenario, nominal, run_key(0, 0)).truth
    place = np.ones((TICKS, 1, RUNS))
    delta_v = np.zeros((TICKS, RUNS))
    delta_v[:, 1] = 1e-3 * np.clip(np.arange(TICKS) - 120, 0, 5)
    records = {
        "r_ST_N": place * np.asarray(truth.r_ST_N)[None, :, None],
        "v_ST_N": place * np.asarray(truth.v_ST_N)[None, :, None],
        "mass_kg": np.full((TICKS, RUNS), 30.0),
        "delta_v_m_s": delta_v,
        "running": np.ones((TICKS, RUNS), bool),
    }
    # At the start alone these are states of rest in the Hill frame: all instants but the first are left out.
    records["running"][1:, [0, 2]] = False
    nominal = jax.tree.map(np.asarray, nominal)
    evaluator = PassiveSafety(file, scenario, nominal, RUNS, jax.devices()[:1])
    return evaluator, {"limits.keep_out_m": RADII}, records


def test_each_run_is_judged_by_its_own_keep_out_sphere(inputs: Any) -> None:
    evaluator, drawn, records = inputs
    found = evaluator.evaluate(drawn, records)
    assert set(found) == {
        "passive_range_1_h_m", "passive_range_1_orbit_m", "passive_range_24_h_m", "passive_unsafe_fraction",
        "stuck_on_range_24_h_m", "passive_range_m", "final_drift_range_24_h_m",
    }  # fmt: skip
    # At rest on an orbit of eccentricity 1e-3 the range stays: 50 m to a few per cent.
    np.testing.assert_allclose(found["passive_range_1_orbit_m"][[0, 2]], 50.0, rtol=0.1)
    np.testing.assert_array_equal(found["passive_range_m"], found["passive_range_1_orbit_m"])
    np.testing.assert_array_equal(found["passive_unsafe_fraction"], [0.0, 1.0, 0.0])
    assert np.isfinite(found["stuck_on_range_24_h_m"]).tolist() == [False, True, False]
    assert np.all(found["passive_range_24_h_m"] <= found["passive_range_1_orbit_m"])


def test_drifts_in_several_rounds_have_the_same_ranges(inputs: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    evaluator, drawn, records = inputs
    expected = evaluator.evaluate(drawn, records)
    monkeypatch.setattr(passive_safety, "_DRIFTS_AT_ONCE", 2)
    monkeypatch.setattr(passive_safety, "_MOST_RUNS_ON_CORE", 2)
    again = PassiveSafety(evaluator.file, evaluator.scenario, evaluator.nominal, RUNS, jax.devices()[:1])
    assert (again.drifts_at_once, again.runs_at_once) == (2, 2)
    found = again.evaluate(drawn, records)
    for name, values in expected.items():
        # Two programs of other sizes round differently.
        np.testing.assert_allclose(found[name], values, rtol=1e-9, err_msg=name)


def test_ranges_in_windows_are_those_of_the_drifts_that_begin_there(inputs: Any) -> None:
    evaluator, drawn, records = inputs
    ranges = ("passive_range_1_h_m", "passive_range_24_h_m", "stuck_on_range_24_h_m")
    tables = evaluator.file.model_dump()
    tables["requirements"] = [
        {"metric": name, **BOUND, **times} for name in ranges for times in ({"to_s": 149.0}, {"from_s": 150.0})
    ]
    file = scenario_loader.validate(tables)
    found = PassiveSafety(file, evaluator.scenario, evaluator.nominal, RUNS, jax.devices()[:1]).evaluate(drawn, records)
    whole = evaluator.evaluate(drawn, records)
    for name in ranges:
        parts = found[f"{name}@0-149"], found[f"{name}@150-end"]
        # Only the second run lasts; it burns in the first window.
        assert np.isnan(np.stack(parts))[:, [0, 2]].all()
        assert np.isfinite(parts[0][1])
        assert np.isfinite(parts[1][1]) == (name != "stuck_on_range_24_h_m")
        assert np.fmin(*parts)[1] == found[name][1]
        # A coast that is divided goes on from a recorded state.
        np.testing.assert_allclose(found[name][[0, 2]], whole[name][[0, 2]], rtol=1e-9)


def test_the_final_drift_is_that_after_the_last_burn(inputs: Any) -> None:
    evaluator, drawn, records = inputs
    approaching = records["v_ST_N"].copy()
    # Slower along the track, it falls below the target and overtakes it.
    approaching[:122, :, 1] += 0.005 * records["r_ST_N"][0, :, 1] / np.linalg.norm(records["r_ST_N"][0, :, 1])
    tables = evaluator.file.model_dump()
    tables["requirements"] = [
        {"metric": "passive_range_24_h_m", "from_s": 126.0, **BOUND},
        {"metric": "final_drift_range_24_h_m", "to_s": 100.0, **BOUND},
    ]
    file = scenario_loader.validate(tables)
    again = PassiveSafety(file, evaluator.scenario, evaluator.nominal, RUNS, jax.devices()[:1])
    found = again.evaluate(drawn, {**records, "v_ST_N": approaching})
    final = found["final_drift_range_24_h_m"]
    assert final[1] > 1.5 * found["passive_range_24_h_m"][1]
    np.testing.assert_allclose(final[1], found["passive_range_24_h_m@126-end"][1], rtol=1e-9)
    # In a window it is that of the last drift which begins there, and without a burn that of the only one.
    np.testing.assert_allclose(found["final_drift_range_24_h_m@0-100"][1], found["passive_range_24_h_m"][1], rtol=1e-3)
    np.testing.assert_array_equal(final[[0, 2]], found["passive_range_24_h_m"][[0, 2]])
