"""Hand-over errors: as the filter is told, or as the scenario says of the truth."""

from functools import partial

import jax
import numpy as np
import pytest

from rpojax.core.frames import hill_frame
from rpojax.scenario import params
from rpojax.scenario.dispersed_numbers import dispersed_values
from rpojax.scenario.loading import scenario_loader
from rpojax.scenario.static_settings import static_settings
from rpojax.simulation import initial_state
from rpojax.simulation.noise import run_key
from rpojax.simulation.state import State

RUNS = 4000
SECTION = "initial.handover"
FULL = np.diag([4.0, 1.0, 9.0, 1e-4, 4e-4, 1e-4, 1.0, 16.0, 0.0, 1e-4, 1e-4, 9e-4])
FULL[1, 7] = FULL[7, 1] = 3.0
FULL[0, 10] = FULL[10, 0] = -0.015


random_keys = jax.jit(jax.vmap(partial(run_key, 0)))
init = jax.jit(initial_state.init, static_argnums=0)
init_all = jax.jit(jax.vmap(initial_state.init, in_axes=(None, None, 0)), static_argnums=0)


def states(*overrides: str) -> State:
    """Initial states of runs without dispersions, runs first."""
    file = scenario_loader.load("inspection", ["dispersions=[]", *overrides])
    static = static_settings(file)
    nominal = params.build_params(file.model_dump(), static.width_px, static.height_px)
    return jax.device_get(init_all(static, nominal, random_keys(np.arange(RUNS))))


def errors_H(found: State) -> np.ndarray:
    """(runs, 12) errors of position and inertial velocity in H, of the servicer, then of it from the target."""
    truth, orbit = found.truth, found.flight.orbit
    R_HN = np.asarray(jax.jit(hill_frame)(truth.r_TN_N[0], truth.v_TN_N[0])[0])
    parts = (
        orbit.servicer.r_SN_N - truth.r_TN_N - truth.r_ST_N,
        orbit.servicer.v_SN_N - truth.v_TN_N - truth.v_ST_N,
        -orbit.relative.r_TS_N - truth.r_ST_N,
        -orbit.relative.v_TS_N - truth.v_ST_N,
    )
    return np.concatenate([part @ R_HN.T for part in parts], axis=1)


def assert_covariance(errors: np.ndarray, expected: np.ndarray) -> None:
    """Asserts a sample covariance within five sigma of its sampling error, and rounding of 7000 km."""
    sampled, variance = np.cov(errors.T), np.diag(expected)
    sigma = np.sqrt((np.outer(variance, variance) + expected**2) / RUNS)
    assert np.all(np.abs(sampled - expected) < 5.0 * sigma + 1e-15)


def test_a_hand_over_as_told_has_the_same_numbers_to_the_last_bit() -> None:
    told = scenario_loader.load("inspection").navigation
    same = [
        f"{SECTION}.{name}={getattr(told, f'initial_{name}')}"
        for name in (
            "position_sigma_m",
            "velocity_sigma_m_s",
            "relative_position_sigma_m",
            "relative_velocity_sigma_m_s",
        )
    ]
    absent = states()
    for other in (states(*same), states(f"{SECTION}={{}}")):
        for one, two in zip(jax.tree.leaves(absent), jax.tree.leaves(other), strict=True):
            np.testing.assert_array_equal(one, two)


def test_sigmas_along_the_axes_of_H_are_the_truth_and_what_the_filter_is_told_stays() -> None:
    told = states()
    found = states(
        f"{SECTION}.position_sigma_m=[1.0, 5.0, 2.0]",
        f"{SECTION}.relative_position_sigma_m=[3.0, 10.0, 0.0]",
        f"{SECTION}.relative_velocity_sigma_m_s=0.05",
    )
    expected = np.diag(np.square([1.0, 5.0, 2.0, 0.02, 0.02, 0.02, 3.0, 10.0, 0.0, 0.05, 0.05, 0.05]))
    assert_covariance(errors_H(found), expected)
    for name in ("servicer", "relative"):
        one, two = (getattr(each.flight.orbit, name).covariance[:, :6, :6] for each in (told, found))
        np.testing.assert_array_equal(one, two)


def test_a_full_covariance_has_the_correlations_of_servicer_and_relative_orbit() -> None:
    found = states(f"{SECTION}.covariance={FULL.tolist()}")
    assert_covariance(errors_H(found), FULL)


def test_a_sigma_of_the_hand_over_can_be_dispersed() -> None:
    key = f"{SECTION}.relative_position_sigma_m"
    file = scenario_loader.load(
        "inspection", [f"{key}=3.0", f"dispersions.{key}={{kind='uniform', low=2.0, high=4.0}}"]
    )
    static = static_settings(file)
    nominal = params.build_params(file.model_dump(), static.width_px, static.height_px)
    values = dispersed_values.draw(file, run_key(0, 1), {})
    assert 2.0 <= float(values[key]) <= 4.0
    run = dispersed_values.apply_to_params(nominal, values)
    assert run.handover is not None
    assert run.handover.relative_position_sigma == values[key]


@pytest.mark.parametrize("name", ["navigation", "attitude_filter", "formation", "pointing", "attitude_control"])
def test_beliefs_do_not_change_the_truth(name: str) -> None:
    """With a hand-over of its own the true start and the sensors' parameters depend on no belief."""
    file = scenario_loader.load("inspection", [f"{SECTION}.covariance={FULL.tolist()}"])
    static = static_settings(file)
    nominal = params.build_params(file.model_dump(), static.width_px, static.height_px)
    path = ("flight", name)
    doubled = jax.tree.map(lambda value: 2.0 * np.asarray(value), params.get_leaf(nominal, path))
    other = params.replace_leaf(nominal, path, doubled)
    key = run_key(0, 0)
    one, two = (init(static, each, key) for each in (nominal, other))
    for before, after in zip(
        jax.tree.leaves((one.truth, one.sensor_errors)), jax.tree.leaves((two.truth, two.sensor_errors)), strict=True
    ):
        np.testing.assert_array_equal(before, after)
    np.testing.assert_array_equal(one.flight.orbit.relative.r_TS_N, two.flight.orbit.relative.r_TS_N)
