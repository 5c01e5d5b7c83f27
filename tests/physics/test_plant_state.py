"""Initial truth of a run."""

import jax
import numpy as np
from numpy_reference import random_unit, rotation_matrix

from rpojax.core.frames import hill_frame, inertial_to_hill
from rpojax.core.orbits import keplerian_elements
from rpojax.core.pytree import replace
from rpojax.physics import plant_state
from rpojax.scenario.params import Params

initial_truth = jax.jit(plant_state.initial_truth)


def test_the_initial_truth_has_the_relative_state_of_the_scenario(params: Params) -> None:
    rng = np.random.default_rng(1)
    rho, rho_dot, q = 40.0 * random_unit(rng), 0.02 * random_unit(rng), random_unit(rng, 4)
    truth = initial_truth(params.plant, params.orbit, rho, rho_dot, q)
    R_HN, omega_HN_N = hill_frame(truth.r_TN_N, truth.v_TN_N)
    found = inertial_to_hill(truth.r_ST_N, truth.v_ST_N, R_HN, omega_HN_N)
    np.testing.assert_allclose(found[0], rho, atol=1e-12)
    np.testing.assert_allclose(found[1], rho_dot, atol=1e-14)
    expected = keplerian_elements.state_from_elements(params.orbit)
    np.testing.assert_allclose(truth.r_TN_N, expected[0])
    np.testing.assert_allclose(np.linalg.norm(truth.omega_TN_T), np.deg2rad(1.0))
    np.testing.assert_allclose(truth.omega_BN_B, rotation_matrix(q) @ np.asarray(omega_HN_N), atol=1e-16)
    assert truth.mass == 30.0
    assert truth.delta_v == 0.0


def test_the_true_outline_of_the_target_is_the_nominal_one_by_its_scale(params: Params) -> None:
    larger = replace(params.plant.target, scale=1.25)
    np.testing.assert_allclose(larger.true_hull, 1.25 * np.asarray(params.plant.target.hull), rtol=1e-15)
