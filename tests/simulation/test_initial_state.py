"""Initial state: relative state of the scenario, and standard deviations of the errors."""

import jax
import numpy as np
from short_run import init

from rpojax.scenario.params import Params
from rpojax.scenario.static_settings import Scenario
from rpojax.simulation.noise import run_key
from rpojax.simulation.state import State, true_relative_state


def test_the_initial_relative_state_is_that_of_the_scenario(loop: tuple[Scenario, Params], start: State) -> None:
    rho, rho_dot = true_relative_state(start.truth)
    np.testing.assert_allclose(rho, loop[1].initial.relative_position, atol=1e-12)
    np.testing.assert_allclose(rho_dot, loop[1].initial.relative_velocity, atol=1e-14)


def test_hand_over_and_sensor_errors_have_their_standard_deviations(loop: tuple[Scenario, Params]) -> None:
    scenario, params = loop
    runs = 300

    def errors(run_id: int) -> list[jax.Array]:
        state = init(scenario, params, run_key(3, run_id))
        truth, orbit, sensors = state.truth, state.flight.orbit, state.sensor_errors
        return [
            np.asarray(orbit.servicer.r_SN_N) - truth.r_TN_N - truth.r_ST_N,
            np.asarray(orbit.servicer.v_SN_N) - truth.v_TN_N - truth.v_ST_N,
            np.asarray(orbit.relative.r_TS_N) + truth.r_ST_N,
            np.asarray(orbit.relative.v_TS_N) + truth.v_ST_N,
            sensors.gps_bias_N,
            sensors.gyro_bias_B,
        ]

    tuning = params.flight.navigation
    sigmas = (
        tuning.initial_position_sigma,
        tuning.initial_velocity_sigma,
        tuning.initial_relative_position_sigma,
        tuning.initial_relative_velocity_sigma,
        params.gps.bias_sigma,
        params.gyro.initial_bias_sigma,
    )
    drawn = [errors(run_id) for run_id in range(runs)]
    for values, sigma in zip(zip(*drawn, strict=True), sigmas, strict=True):
        np.testing.assert_allclose(np.std(np.stack(values)), sigma, rtol=4.0 / np.sqrt(2 * 3 * runs))  # four sigma
