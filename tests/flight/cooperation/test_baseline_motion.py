"""Motion of a peer relative to this servicer against two orbits, each integrated on its own."""

import jax
import numpy as np
import rendezvous_scene
from numpy_reference import MU
from scipy.integrate import solve_ivp

from rpojax.core.pytree import replace
from rpojax.flight.cooperation import baseline_motion
from rpojax.flight.cooperation.baseline_motion import TickMotion
from rpojax.flight.flight_records import FlightParams

DT = 5.0
propagate = jax.jit(baseline_motion.propagate, static_argnums=(0, 3))


def coasted(r: np.ndarray, v: np.ndarray) -> np.ndarray:
    def derivative(_: float, y: np.ndarray) -> np.ndarray:
        return np.concatenate([y[3:], -MU * y[:3] / np.linalg.norm(y[:3]) ** 3])

    begin = np.concatenate([r, v])
    return solve_ivp(derivative, (0.0, DT), begin, method="DOP853", rtol=1e-13, atol=1e-9).y[:, -1]


def test_a_baseline_moves_as_two_orbits_do_less_the_own_burn() -> None:
    r, v = rendezvous_scene.R_SN_N, rendezvous_scene.V_SN_N
    baseline, delta_v = np.array([2000.0, -3000.0, 1000.0, 1.0, 2.0, -3.0]), np.array([0.02, -0.05, 0.03])
    own, peer = coasted(r, v), coasted(r + baseline[:3], v + baseline[3:])
    motion = TickMotion(
        r_before_N=r, r_after_N=own[:3], delta_v_N=delta_v, burn_covariance=np.zeros((3, 3)), reopened=np.array(False)
    )
    found = np.asarray(propagate(0, baseline, motion, DT))
    # The burn is spread over the step.
    expected = peer - own - np.concatenate([0.5 * DT * delta_v, delta_v])
    np.testing.assert_allclose(found[:3], expected[:3], atol=1e-5)
    np.testing.assert_allclose(found[3:], expected[3:], atol=1e-6)
    # Without any motion the gradient of gravity changes it by centimetres.
    assert np.max(np.abs(found[:3] - baseline[:3] - DT * baseline[3:] + 0.5 * DT * delta_v)) > 0.01


def test_a_baseline_at_hand_over_is_as_uncertain_as_both_orbits(flight: FlightParams) -> None:
    own = replace(flight.navigation, initial_position_sigma=np.array(3.0), initial_velocity_sigma=np.array(0.2))
    peer = replace(flight.navigation, initial_position_sigma=np.array(4.0), initial_velocity_sigma=np.array(0.1))
    np.testing.assert_allclose(baseline_motion.initial_variance(own, peer), [*3 * [25.0], *3 * [0.05]], rtol=1e-12)
