"""Attitude of the target: prediction against an integration of Euler's equations, errors against differences."""

import functools
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array
from numpy_reference import MU, random_covariance, unit
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from rpojax import nominal_parameters
from rpojax.core import quaternion
from rpojax.core.filter_state_layout import StateLayout
from rpojax.core.pytree import replace
from rpojax.flight.navigation import relative_filter_state, target_attitude_ekf
from rpojax.flight.navigation.relative_filter_state import RelativeEstimate
from rpojax.flight.navigation.target_attitude_ekf import TargetAttitude
from rpojax.scenario.loading import scenario_loader

INERTIA = np.array([[3.2, 0.2, -0.1], [0.2, 4.1, 0.3], [-0.1, 0.3, 2.4]])
RATIOS = np.array([0.1, -0.15])
RATE = np.radians(1.0) * unit(np.array([0.5, -0.7, 0.6]))
ATTITUDE = np.array([0.4, -0.7, 0.5, 0.3]) / np.linalg.norm([0.4, -0.7, 0.5, 0.3])
SURE = jnp.full(3, 1e-4)
"""Variance of an attitude error."""
PLACE = np.array([5.0e6, 3.0e6, 3.7e6])
"""Of the target from the Earth [m]."""


class Known(NamedTuple):
    """What the functions take and give."""

    reference: TargetAttitude
    layout: StateLayout
    slow: dict[str, Array]
    covariance: Array


@functools.cache
def estimate() -> RelativeEstimate:
    """Estimate of `pose_inspection` at hand-over."""
    with jax.ensure_compile_time_eval():
        params = nominal_parameters(scenario_loader.load("pose_inspection"))[1]
        states = relative_filter_state.states_with(["landmarks"])
        r_TS_N, v_TS_N = jnp.array([0.0, 15.0, 0.0]), jnp.zeros(3)
        return relative_filter_state.initial(params.flight.navigation, r_TS_N, v_TS_N, states, params.flight.target)


def known(inertia: np.ndarray = INERTIA, ratios: np.ndarray = RATIOS) -> Known:
    """A tumbling target whose attitude is known."""
    given = estimate()
    assert given.target is not None
    reference = replace(
        given.target, q_TN=jnp.asarray(ATTITUDE), inertia=jnp.asarray(inertia), known=jnp.ones((), dtype=bool)
    )
    slow = {**given.slow, "rate": jnp.asarray(RATE), "inertia_ratio": jnp.asarray(ratios)}
    return Known(reference, given.layout, slow, given.covariance)


@functools.partial(jax.jit, static_argnums=(1, 4))
def predict(
    reference: TargetAttitude, layout: StateLayout, slow: dict[str, Array], P: Array, dt: float
) -> tuple[TargetAttitude, dict[str, Array], Array]:
    return target_attitude_ekf.predict(reference, layout, slow, P, jnp.asarray(PLACE), dt)


turned_by = jax.jit(target_attitude_ekf.turned_by, static_argnums=(1,))


def true_inertia(inertia: np.ndarray, ratios: np.ndarray) -> np.ndarray:
    scale = np.diag(np.exp(0.5 * np.array([*ratios, 0.0])))
    return scale @ inertia @ scale


def test_the_mean_is_that_of_eulers_equations_with_the_gravity_gradient() -> None:
    J, R_TN = true_inertia(INERTIA, RATIOS), np.asarray(quaternion.to_matrix(jnp.asarray(ATTITUDE)))
    outward, pull = unit(PLACE), 3.0 * MU / np.linalg.norm(PLACE) ** 3

    def derivative(_: float, state: np.ndarray) -> np.ndarray:
        R, omega = state[:9].reshape(3, 3), state[9:]
        u = R @ outward
        torque = pull * np.cross(u, J @ u) - np.cross(omega, J @ omega)
        return np.concatenate([-np.cross(omega, R, axisb=0, axisc=0).ravel(), np.linalg.solve(J, torque)])

    start = np.concatenate([R_TN.ravel(), RATE])
    ends = solve_ivp(derivative, (0.0, 60.0), start, method="DOP853", rtol=1e-12, atol=1e-14).y[:, -1]
    reference, layout, slow, P = known()
    for _ in range(60):
        reference, slow, P = predict(reference, layout, slow, P, 1.0)
    turn = np.asarray(quaternion.to_matrix(target_attitude_ekf.attitude(reference, slow))) @ ends[:9].reshape(3, 3).T
    assert np.linalg.norm(Rotation.from_matrix(turn).as_rotvec()) < 1e-8
    np.testing.assert_allclose(slow["rate"], ends[9:], atol=1e-8)
    # Torques have changed the rate by more than that, also that of the gravity gradient alone.
    assert np.linalg.norm(ends[9:] - RATE) > 1e-4
    np.testing.assert_array_equal(slow["attitude"], 0.0)
    np.testing.assert_array_equal(slow["inertia_ratio"], RATIOS)


def transition(given: Known, dt: float) -> np.ndarray:
    """Change of attitude error, rate and ratios (8, 8), read from covariances with one element each."""
    numbers = numbers_of(given.layout)
    single = np.zeros((8, given.layout.size, given.layout.size))
    single[np.arange(8), numbers, 0] = 1.0
    after = jax.vmap(lambda P: predict(given.reference, given.layout, given.slow, P, dt)[2])(jnp.asarray(single))
    return np.asarray(after)[:, numbers, 0].T


def numbers_of(layout: StateLayout) -> list[int]:
    return [number for name in ("attitude", "rate", "inertia_ratio") for number in layout.places(name)]


def differences(given: Known, dt: float) -> np.ndarray:
    """The same by central differences of the nonlinear prediction of the mean."""
    step, columns = 1e-5, []

    def after(name: str, axis: int, sign: float) -> tuple[Array, np.ndarray]:
        moved = {**given.slow, name: given.slow[name].at[axis].add(sign * step)}
        reference, slow, _ = predict(given.reference, given.layout, moved, given.covariance, dt)
        rest = np.concatenate([slow["rate"], slow["inertia_ratio"]])
        return target_attitude_ekf.attitude(reference, slow), rest

    for name, size in (("attitude", 3), ("rate", 3), ("inertia_ratio", 2)):
        for axis in range(size):
            (q_more, more), (q_less, less) = after(name, axis, 1.0), after(name, axis, -1.0)
            turn = np.asarray(quaternion.log(quaternion.multiply(q_more, quaternion.conjugate(q_less))))
            columns.append(np.concatenate([turn, more - less]) / (2.0 * step))
    return np.stack(columns, axis=1)


def test_the_transition_of_errors_is_that_of_the_nonlinear_prediction() -> None:
    # What is left out is of the second order in the step: a torque changes the rate by 3e-6 rad/s and the turn by half
    # of that times the step, 2e-7; gyroscopic terms are 9e-5 of the attitude by the rate, 2e-6 of the rate by itself.
    dt, given = 0.1, known()
    found, expected = transition(given, dt), differences(given, dt)
    np.testing.assert_allclose(found[:3, :3], expected[:3, :3], atol=3e-7)
    np.testing.assert_allclose(found[:3, 3:6], expected[:3, 3:6], atol=1e-4)
    np.testing.assert_allclose(found[3:6, 3:6], expected[3:6, 3:6], atol=5e-6)
    np.testing.assert_allclose(found[3:6, 6:], expected[3:6, 6:], atol=5e-8)
    # Ten times of each tolerance are there to be found.
    assert np.abs(expected[3:6, 3:6] - np.eye(3)).max() > 5e-5
    assert np.abs(expected[3:6, 6:]).max() > 5e-7
    np.testing.assert_array_equal(found[6:], np.eye(8)[6:])


def test_what_a_rate_turns_within_a_step_counts() -> None:
    # Of a sphere no gyroscopic torque hides the second-order term of the kinematics.
    given = known(3.0 * np.eye(3), np.zeros(2))
    np.testing.assert_allclose(transition(given, 1.0)[:3, 3:6], differences(given, 1.0)[:3, 3:6], atol=1e-4)
    assert np.abs(differences(given, 1.0)[:3, 3:6] + np.eye(3)).max() > 3e-3


def test_the_covariance_is_changed_by_that_transition() -> None:
    given = known()
    P = random_covariance(np.random.default_rng(1), np.full(given.layout.size, 0.1))
    F, numbers = np.eye(given.layout.size), numbers_of(given.layout)
    F[np.ix_(numbers, numbers)] = transition(given, 1.0)
    found = predict(given.reference, given.layout, given.slow, jnp.asarray(P), 1.0)[2]
    np.testing.assert_allclose(found, F @ P @ F.T, rtol=1e-12, atol=1e-14)


def test_an_attitude_that_is_not_known_does_not_turn() -> None:
    reference, layout, slow, P = known()
    lost = replace(reference, known=jnp.zeros((), dtype=bool))
    after, moved, _ = predict(lost, layout, slow, P, 1.0)
    np.testing.assert_array_equal(after.q_TN, reference.q_TN)
    np.testing.assert_array_equal(moved["rate"], slow["rate"])


def test_forward_and_back_is_the_same_estimate() -> None:
    reference, layout, slow, _ = known()
    slow = {**slow, "attitude": jnp.array([0.02, -0.01, 0.03])}
    P = jnp.asarray(random_covariance(np.random.default_rng(2), np.full(layout.size, 0.02)))
    before = target_attitude_ekf.attitude(reference, slow)
    there = turned_by(reference, layout, slow, P, jnp.asarray(-1.3))
    back, again, P_again = turned_by(there[0], layout, there[1], there[2], jnp.asarray(1.3))
    np.testing.assert_allclose(target_attitude_ekf.attitude(back, again), before, atol=1e-14)
    np.testing.assert_allclose(P_again, P, atol=1e-9)
    np.testing.assert_array_equal(again["rate"], slow["rate"])
    # In between the attitude is that of then.
    turned = Rotation.from_matrix(
        np.asarray(quaternion.to_matrix(target_attitude_ekf.attitude(there[0], there[1])))
        @ np.asarray(quaternion.to_matrix(before)).T
    )
    np.testing.assert_allclose(turned.as_rotvec(), 1.3 * RATE, atol=1e-12)


@pytest.mark.parametrize(("agreed_s", "contradicted_s", "lost"), [(4, 5, False), (4, 6, True), (20, 9, False)])
def test_an_attitude_is_given_up_after_ten_seconds_more_of_contradiction(
    agreed_s: int, contradicted_s: int, lost: bool
) -> None:
    reference, yes, no = known().reference, jnp.asarray(True), jnp.asarray(False)
    was_lost = no
    # Pictures without landmarks do not count.
    sequence = [(no, yes)] * 8 + [(yes, no)] * agreed_s + [(no, no)] * 20 + [(no, yes)] * contradicted_s
    for used, contradicted in sequence:
        assert not bool(was_lost)
        reference, was_lost = target_attitude_ekf.given_up(reference, SURE, used, contradicted, 1.0)
    assert bool(was_lost) is lost
    assert bool(reference.known) is not lost
    if lost:  # and another one gets its own ten seconds
        again, was_lost = target_attitude_ekf.given_up(replace(reference, known=yes), SURE, no, yes, 1.0)
        assert bool(again.known) and not bool(was_lost)


def test_an_attitude_that_is_not_known_cannot_be_lost() -> None:
    reference = replace(known().reference, known=jnp.asarray(False))
    assert not bool(target_attitude_ekf.given_up(reference, SURE, jnp.asarray(False), jnp.asarray(True), 11.0)[1])


@pytest.mark.parametrize(("sigma", "lost"), [(0.19, False), (0.21, True)])
def test_an_attitude_too_uncertain_for_a_linear_filter_is_given_up(sigma: float, lost: bool) -> None:
    variance = jnp.array([1e-4, sigma**2, 1e-4])
    after, was_lost = target_attitude_ekf.given_up(
        known().reference, variance, jnp.asarray(True), jnp.asarray(False), 1.0
    )
    assert bool(was_lost) is lost
    assert bool(after.known) is not lost


def test_larger_ratios_are_larger_moments_about_their_axes() -> None:
    found = target_attitude_ekf.inertia_of(jnp.diag(jnp.array([3.0, 4.0, 5.0])), jnp.log(jnp.array([1.2, 0.9])))
    np.testing.assert_allclose(found, np.diag([3.6, 3.6, 5.0]), rtol=1e-14)


def test_pictures_of_a_network_count_by_what_is_new_in_them() -> None:
    given = estimate()
    assert given.target is not None
    yes, no, tenth = jnp.ones((), dtype=bool), jnp.zeros((), dtype=bool), jnp.asarray(0.1)
    reference = replace(given.target, known=yes, agreed=jnp.zeros(()))
    ticks = 0
    while not bool(reference.certain):
        reference = target_attitude_ekf.agreed_after(reference, yes, tenth)
        ticks += 1
    assert ticks == 30
    # One that is not certain is given up after ten seconds, a certain one after three pictures of their own.
    for start, seconds in ((replace(reference, agreed=jnp.zeros(())), 10), (reference, 30)):
        contradicted, lost, ticks = start, no, 0
        while not bool(lost):
            contradicted, lost = target_attitude_ekf.given_up(contradicted, SURE, no, yes, 1.0, tenth)
            ticks += 1
        assert ticks == seconds
        assert not bool(contradicted.certain)
        assert float(target_attitude_ekf.agreed_after(contradicted, no, tenth).agreed) == 0.0
    # Pictures that agree count as those that contradict: of four in five against it, 18 more in 30 are needed.
    mixed, lost, ticks = reference, no, 0
    while not bool(lost):
        agrees = jnp.asarray(ticks % 5 == 4)
        mixed, lost = target_attitude_ekf.given_up(mixed, SURE, agrees, ~agrees, 1.0, tenth)
        ticks += 1
    assert 40 < ticks < 52
    # Where the view stays, nothing is new.
    still, lost = target_attitude_ekf.given_up(reference, SURE, no, yes, 1.0, jnp.zeros(()))
    assert not bool(lost)
    assert float(still.unexplained_s) == 0.0
    assert target_attitude_ekf.agreed_after(given.target, yes, None) is given.target
