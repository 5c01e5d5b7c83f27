"""Inputs of `basilisk_mission` for the dispersed runs of a scenario: keys of a reference file, and some more."""

from typing import Any

import jax
import numpy as np
from jaxtyping import Array

from rpojax.campaign import single_run
from rpojax.core import quaternion
from rpojax.physics.plant_state import PlantParams, Truth
from rpojax.scenario.dispersed_numbers import dispersed_values
from rpojax.scenario.schema import ScenarioFile
from rpojax.simulation import initial_state
from rpojax.simulation.noise import run_key

SEED = 0
"""Seed of the campaign whose runs both simulators simulate."""


def dispersed_inputs(file: ScenarioFile, runs: int) -> list[dict[str, Any]]:
    """Inputs of the first runs of a campaign, as lists for JSON."""
    scenario, nominal = single_run.nominal_parameters(file)

    @jax.jit
    def draw_run(run_id: Array) -> tuple[PlantParams, Truth, Array]:
        key = run_key(SEED, run_id)
        dispersed = dispersed_values.apply_to_params(nominal, dispersed_values.draw(file, key, {}))
        thruster = dispersed.plant.thruster
        force_direction = quaternion.rotate(
            quaternion.exp(thruster.misalignment), quaternion.normalize(thruster.direction)
        )
        return dispersed.plant, initial_state.init(scenario, dispersed, key).truth, force_direction

    nominal_inputs = {
        "F_nominal": nominal.plant.thruster.force,
        "m_nominal": nominal.plant.servicer.mass,
        "desired_position": np.array(file.formation.desired_position_m),
        "desired_elements": desired_elements(file),
    }
    drawn = (jax.tree.map(np.asarray, draw_run(np.int32(run_id))) for run_id in range(runs))
    return [
        _to_lists({**nominal_inputs, **_plant_inputs(plant), **_initial_state(truth), "thr_dir": force_direction[None]})
        for plant, truth, force_direction in drawn
    ]


def desired_elements(file: ScenarioFile) -> np.ndarray:
    """(6,) differences of a/a, e, i, node, perigee and mean anomaly at the desired place behind or ahead."""
    return np.array([0.0, 0.0, 0.0, 0.0, 0.0, file.formation.desired_position_m[1] / file.orbit.semi_major_axis_m])


def _plant_inputs(plant: PlantParams) -> dict[str, Any]:
    thruster = plant.thruster
    return {
        "mu": plant.gravity.mu,
        "Re": plant.gravity.radius,
        "J": np.asarray(plant.gravity.zonals)[:1],
        "m": plant.servicer.mass,
        "I": plant.servicer.inertia,
        "m_target": plant.target.mass,
        "I_target": plant.target.inertia,
        "gs": plant.wheels.axes,
        "Js": plant.wheels.inertia,
        "u_max": plant.wheels.torque_limit,
        "F_max": thruster.force * thruster.force_scale,
        "Isp": thruster.specific_impulse,
        "minimum_on_s": thruster.minimum_on_time,
        "thr_loc": np.asarray(thruster.position)[None],
    }


def _initial_state(truth: Truth) -> dict[str, Any]:
    return {
        "r0_target": truth.r_TN_N,
        "v0_target": truth.v_TN_N,
        "r0_chaser": truth.r_TN_N + truth.r_ST_N,
        "v0_chaser": truth.v_TN_N + truth.v_ST_N,
        "sigma0": modified_rodrigues_parameters(np.asarray(truth.q_BN)),
        "omega0": truth.omega_BN_B,
        "sigma0_target": modified_rodrigues_parameters(np.asarray(truth.q_TN)),
        "omega0_target": truth.omega_TN_T,
        "Omega0": truth.wheel_speed,
    }


def modified_rodrigues_parameters(q_BN: np.ndarray) -> np.ndarray:
    """(3,) modified Rodrigues parameters, as Basilisk defines them, of a unit quaternion (4,)."""
    vector = -q_BN[1:] if q_BN[0] >= 0.0 else q_BN[1:]
    return vector / (1.0 + abs(q_BN[0]))


def _to_lists(values: dict[str, Any]) -> dict[str, Any]:
    return {key: np.asarray(value).tolist() for key, value in values.items()}
