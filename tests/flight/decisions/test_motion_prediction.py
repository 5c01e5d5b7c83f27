"""Relative motion up to a burn against two orbits, each integrated on its own."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import rendezvous_scene
from numpy_reference import MU, random_covariance, unit
from scipy.integrate import solve_ivp

from rpojax.core.pytree import replace
from rpojax.flight.decisions.motion_prediction import Prediction, predict_to_burn
from rpojax.flight.flight_records import FlightParams
from rpojax.flight.navigation.combined_orbit_filter import OrbitEstimate

SIGMAS = np.array([*3 * [0.5], *3 * [2e-3]])


@jax.jit
def prediction(flight: FlightParams, estimate: OrbitEstimate, after: jax.Array) -> Prediction:
    return predict_to_burn(flight, estimate, after)


def coasted(state: np.ndarray, seconds: float) -> np.ndarray:
    """Position and velocity [m, m/s] in N of a spacecraft after free motion."""
    return solve_ivp(
        lambda _, y: np.concatenate([y[3:], -MU * y[:3] / np.linalg.norm(y[:3]) ** 3]),
        (0.0, seconds),
        state,
        method="DOP853",
        rtol=1e-13,
        atol=1e-7,
    ).y[:, -1]


def hill_axes(target: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Axes of H, one a row, and its rate in N [rad/s]."""
    momentum = np.cross(target[:3], target[3:])
    radial, normal = unit(target[:3]), unit(momentum)
    return np.stack([radial, np.cross(normal, radial), normal]), momentum / (target[:3] @ target[:3])


def relative_in_hill(servicer: np.ndarray, target: np.ndarray) -> np.ndarray:
    axes, rate = hill_axes(target)
    r, v = servicer[:3] - target[:3], servicer[3:] - target[3:]
    return np.concatenate([axes @ r, axes @ (v - np.cross(rate, r))])


@pytest.mark.parametrize("after", [0.0, 900.0])
def test_the_state_at_a_burn_and_its_covariance_are_those_of_two_free_orbits(
    flight: FlightParams, after: float
) -> None:
    estimate = rendezvous_scene.estimate(flight)
    P = np.zeros((12, 12))
    P[:6, :6] = random_covariance(np.random.default_rng(0), SIGMAS)
    estimate = replace(estimate, relative=replace(estimate.relative, covariance=jnp.asarray(P)))
    found = prediction(flight, estimate, jnp.asarray(after))

    lead = float(flight.formation.lead) + after
    servicer = np.concatenate([estimate.servicer.r_SN_N, estimate.servicer.v_SN_N])
    to_target = np.concatenate([estimate.relative.r_TS_N, estimate.relative.v_TS_N])
    target = servicer + to_target
    target_then = coasted(target, lead)
    np.testing.assert_allclose(found.state_H, relative_in_hill(servicer, target), rtol=1e-6, atol=1e-6)
    then = relative_in_hill(coasted(servicer, lead), target_then)
    # Linear in the distance of 30 m: what is left out grows with its square over the radius.
    np.testing.assert_allclose(found.burn_state_H[:3], then[:3], atol=2e-3)
    np.testing.assert_allclose(found.burn_state_H[3:], then[3:], atol=2e-6)
    np.testing.assert_allclose(found.R_CN, hill_axes(target_then)[0], atol=1e-9)

    now, later = np.zeros((6, 6)), np.zeros((6, 6))
    for column, step in enumerate(np.diag([*3 * [10.0], *3 * [1e-2]])):
        moved = servicer - step  # The target stays where it is; the servicer moves the other way.
        size = step[column]
        now[:, column] = (relative_in_hill(moved, target) - relative_in_hill(servicer, target)) / size
        later[:, column] = (relative_in_hill(coasted(moved, lead), target_then) - then) / size
    for covariance, jacobian in ((found.covariance_H, now), (found.burn_covariance_H, later)):
        expected = jacobian @ P[:6, :6] @ jacobian.T
        sigma = np.sqrt(np.diag(expected))
        np.testing.assert_allclose(covariance / np.outer(sigma, sigma), expected / np.outer(sigma, sigma), atol=1e-3)
    assert np.sqrt(found.burn_covariance_H[1, 1]) > (1.0 if after > 0.0 else 0.0)
