"""Relative motion near elliptic orbits against two orbits side by side and against its integrated equations."""

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.test_util import check_grads
from numpy_reference import MU
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from rpojax.batching.vmap_last_axis import vmap
from rpojax.core.frames import hill_frame, hill_to_inertial, inertial_to_hill
from rpojax.core.orbits import clohessy_wiltshire, yamanaka_ankersen
from rpojax.core.orbits.keplerian_elements import KeplerianElements, state_from_elements
from rpojax.core.orbits.yamanaka_ankersen import TargetOrbit

ECCENTRICITIES = [0.0, 0.1, 0.7]
PERIGEE = 7.0e6
State = np.ndarray

target_orbit = jax.jit(yamanaka_ankersen.target_orbit)
advanced = jax.jit(yamanaka_ankersen.advanced)
transition_matrix = jax.jit(yamanaka_ankersen.transition_matrix)
mean_argument_of_latitude = jax.jit(yamanaka_ankersen.mean_argument_of_latitude)
constants_of_motion = jax.jit(yamanaka_ankersen.constants_of_motion)
free_motion = jax.jit(yamanaka_ankersen.free_motion)
rate_without_drift = jax.jit(yamanaka_ankersen.rate_without_drift)
frame = jax.jit(hill_frame)


def orbit(e: float, true_anomaly: float = 0.6, perigee_angle: float = 2.1) -> TargetOrbit:
    return TargetOrbit(
        argument_of_latitude=np.float64(perigee_angle + true_anomaly),
        ex=np.float64(e * np.cos(perigee_angle)),
        ey=np.float64(e * np.sin(perigee_angle)),
        semi_major_axis=np.float64(PERIGEE / (1.0 - e)),
    )


def period(e: float) -> float:
    return float(2.0 * np.pi * np.sqrt((PERIGEE / (1.0 - e)) ** 3 / MU))


@jax.jit
def inertial_state(elements: jax.Array) -> tuple[jax.Array, jax.Array]:
    a, e, i, raan, w, nu = elements
    return state_from_elements(
        KeplerianElements(
            semi_major_axis=a, eccentricity=e, inclination=i, raan=raan, argument_of_perigee=w, true_anomaly=nu
        )
    )


def two_body(r: State, v: State, seconds: float) -> State:
    """State (6,) after a time by Kepler's equation, from the eccentric anomaly in the orbit plane."""
    distance, a = np.linalg.norm(r), 1.0 / (2.0 / np.linalg.norm(r) - v @ v / MU)
    n = np.sqrt(MU / a**3)
    e_cos, e_sin = 1.0 - distance / a, r @ v / np.sqrt(MU * a)

    def kepler(change: float) -> float:
        return change - e_cos * np.sin(change) + e_sin * (1.0 - np.cos(change)) - n * seconds

    change = brentq(kepler, n * seconds - 4.0, n * seconds + 4.0, xtol=1e-15, rtol=1e-15)
    for _ in range(2):
        change -= kepler(change) / (1.0 - e_cos * np.cos(change) + e_sin * np.sin(change))
    later = a * (1.0 - e_cos * np.cos(change) + e_sin * np.sin(change))
    f = 1.0 - a / distance * (1.0 - np.cos(change))
    g = seconds - (change - np.sin(change)) / n
    f_dot = -np.sqrt(MU * a) / (later * distance) * np.sin(change)
    g_dot = 1.0 - a / later * (1.0 - np.cos(change))
    return np.concatenate([f * r + g * v, f_dot * r + g_dot * v])


def relative_state_of_two_orbits(r: State, v: State, offset: State, seconds: float) -> State:
    """Relative state (6,) in H after a time, of two orbits with a relative state `offset` at the beginning."""
    r_rel, v_rel = hill_to_inertial(jnp.asarray(offset[:3]), jnp.asarray(offset[3:]), *frame(r, v))
    target = two_body(r, v, seconds)
    servicer = two_body(r + np.asarray(r_rel), v + np.asarray(v_rel), seconds)
    return np.concatenate(
        inertial_to_hill(*jnp.asarray(servicer - target).reshape(2, 3), *frame(*target.reshape(2, 3)))
    )


@pytest.mark.parametrize("e", ECCENTRICITIES)
@pytest.mark.parametrize("share", [-0.4, 0.01, 0.37, 1.63])
def test_the_motion_is_the_limit_of_two_orbits_side_by_side(e: float, share: float) -> None:
    """Half the difference of two opposite separations of 20 m is wrong by squares of their ratio to the radius."""
    r, v = map(np.asarray, inertial_state(np.array([PERIGEE / (1.0 - e), e, 0.9, 0.4, 2.1, 0.6])))
    seconds = share * period(e)
    scale = np.array([20.0] * 3 + [20.0 / period(e)] * 3)
    found = np.asarray(transition_matrix(target_orbit(r, v), np.float64(seconds))) * scale[None, :] / scale[:, None]
    expected = np.empty((6, 6))
    for column, offset in enumerate(np.diag(scale)):
        above, below = (relative_state_of_two_orbits(r, v, sign * offset, seconds) for sign in (1.0, -1.0))
        expected[:, column] = 0.5 * (above - below) / scale
    assert np.max(np.abs(found - expected)) < 1e-6 * np.max(np.abs(expected))


def linear_motion(e: float) -> Callable[[float, State], State]:
    """Equations of relative motion linear in the separation, with the true anomaly as seventh state (Tschauner)."""
    h = np.sqrt(MU * PERIGEE * (1.0 + e))

    def rates(_: float, state: State) -> State:
        x, y, z, u, v, w, nu = state
        r = PERIGEE * (1.0 + e) / (1.0 + e * np.cos(nu))
        rate, gravity = h / r**2, MU / r**3
        change = -2.0 * rate * (MU / h) * e * np.sin(nu) / r
        return np.array(
            [
                u,
                v,
                w,
                (rate**2 + 2.0 * gravity) * x + change * y + 2.0 * rate * v,
                (rate**2 - gravity) * y - change * x - 2.0 * rate * u,
                -gravity * z,
                rate,
            ]
        )

    return rates


@pytest.mark.parametrize("e", [*ECCENTRICITIES, 0.9])
def test_the_motion_solves_the_linear_equations_of_relative_motion(e: float) -> None:
    scale = np.array([1.0] * 3 + [1e-3] * 3)
    seconds = 1.3 * period(e)
    for offset in np.diag(scale):
        solution = solve_ivp(linear_motion(e), (0.0, seconds), [*offset, 0.6], method="DOP853", rtol=1e-12, atol=1e-13)
        found = np.asarray(transition_matrix(orbit(e), np.float64(seconds))) @ offset
        size = np.max(np.abs(solution.y[:6]), axis=1)
        np.testing.assert_allclose(found / scale, solution.y[:6, -1] / scale, atol=1e-7 * np.max(size / scale))
        np.testing.assert_allclose(advanced(orbit(e), np.float64(seconds)).argument_of_latitude,
                                   2.1 + solution.y[6, -1], atol=1e-9)  # fmt: skip


@pytest.mark.parametrize("seconds", [1.0, 200.0, 3000.0, 20000.0])
def test_on_a_circular_orbit_it_is_the_motion_of_clohessy_and_wiltshire(seconds: float) -> None:
    n = np.sqrt(MU / PERIGEE**3)
    scale = np.array([1.0] * 3 + [1.0 / n] * 3)
    expected = np.asarray(clohessy_wiltshire.transition_matrix(jnp.asarray(n), jnp.asarray(seconds)))
    found = np.asarray(transition_matrix(orbit(0.0), np.float64(seconds)))
    difference = (found - expected) * scale[:, None] / scale[None, :]
    assert np.max(np.abs(difference)) < 1e-14 * np.max(np.abs(expected * scale[:, None] / scale[None, :]))


@pytest.mark.parametrize("e", [*ECCENTRICITIES, 0.9])
def test_two_steps_are_one_and_a_step_back_is_the_inverse(e: float) -> None:
    scale = np.array([1.0] * 3 + [period(e) / 6.3] * 3)
    first, second = np.float64(0.23 * period(e)), np.float64(0.95 * period(e))
    start = orbit(e)
    between = advanced(start, first)
    whole = np.asarray(transition_matrix(start, first + second)) * scale[:, None] / scale[None, :]
    steps = [np.asarray(transition_matrix(at, dt)) for at, dt in ((between, second), (start, first))]
    product = steps[0] @ steps[1] * scale[:, None] / scale[None, :]
    np.testing.assert_allclose(product, whole, atol=1e-12 * np.max(np.abs(whole)))
    back = np.asarray(transition_matrix(between, -first)) * scale[:, None] / scale[None, :]
    forth = steps[1] * scale[:, None] / scale[None, :]
    rounding = 1e-14 * np.max(np.abs(back)) * np.max(np.abs(forth))
    np.testing.assert_allclose(back @ forth, np.eye(6), atol=rounding)


@pytest.mark.parametrize("e", [0.0, 0.1, 0.7, 0.9])
def test_keplers_equation_is_solved_to_rounding_everywhere_on_the_orbit(e: float) -> None:
    nu, seconds = np.meshgrid(np.linspace(-3.1, 3.1, 63), period(e) * np.linspace(-1.2, 1.2, 97))
    places = jax.vmap(lambda anomaly: orbit_at(e, anomaly))(nu.ravel())
    after = jax.jit(jax.vmap(yamanaka_ankersen.advanced))(places, seconds.ravel())
    expected = mean_anomaly(e, nu.ravel()) + 2.0 * np.pi * seconds.ravel() / period(e)
    found = mean_anomaly(e, np.asarray(after.argument_of_latitude) - 2.1)
    # The mean anomaly changes by up to (1 + e)^2 / (1 - e^2)^1.5 = 44 for a change of the true anomaly at e = 0.9.
    np.testing.assert_allclose(found, expected, atol=2e-13)


@pytest.mark.parametrize("e", [*ECCENTRICITIES, 0.9])
def test_the_mean_argument_of_latitude_is_perigee_plus_mean_anomaly(e: float) -> None:
    for nu in (-2.9, 0.6, 3.4):
        np.testing.assert_allclose(
            mean_argument_of_latitude(orbit(e, nu)), 2.1 + mean_anomaly(e, np.float64(nu)), atol=1e-12
        )


def orbit_at(e: float, anomaly: jax.Array) -> TargetOrbit:
    start = orbit(e)
    return TargetOrbit(
        argument_of_latitude=2.1 + anomaly,
        ex=jnp.asarray(start.ex),
        ey=jnp.asarray(start.ey),
        semi_major_axis=jnp.asarray(start.semi_major_axis),
    )


def mean_anomaly(e: float, nu: np.ndarray) -> np.ndarray:
    eccentric = nu - 2.0 * np.arctan2(e * np.sin(nu), 1.0 + np.sqrt(1.0 - e * e) + e * np.cos(nu))
    return eccentric - e * np.sin(eccentric)


@pytest.mark.parametrize("e", ECCENTRICITIES)
def test_the_orbit_of_a_state_has_its_elements(e: float) -> None:
    found = target_orbit(*inertial_state(np.array([PERIGEE / (1.0 - e), e, 0.9, 0.4, 2.1, 0.6])))
    expected = orbit(e)
    np.testing.assert_allclose(found.argument_of_latitude, expected.argument_of_latitude, atol=1e-12)
    np.testing.assert_allclose([found.ex, found.ey], [expected.ex, expected.ey], atol=1e-14)
    np.testing.assert_allclose(found.semi_major_axis, expected.semi_major_axis, rtol=1e-13)


@pytest.mark.parametrize("inclination", [0.0, 1e-4, np.pi])
def test_an_equatorial_orbit_counts_from_the_x_axis(inclination: float) -> None:
    r, v = inertial_state(np.array([4.2e7, 0.02, inclination, 0.3, 0.5, 0.7]))
    found = target_orbit(r, v)
    np.testing.assert_allclose(found.argument_of_latitude, np.arctan2(r[1], r[0]) * np.cos(inclination), atol=1e-8)
    perigee = 0.5 + 0.3 * np.cos(inclination)
    np.testing.assert_allclose([found.ex, found.ey], 0.02 * np.array([np.cos(perigee), np.sin(perigee)]), atol=1e-9)


def test_an_orbit_slightly_inclined_counts_from_its_node() -> None:
    found = target_orbit(*inertial_state(np.array([4.2e7, 0.02, 2e-3, 0.3, 0.5, 0.7])))
    np.testing.assert_allclose(found.argument_of_latitude, 1.2, atol=1e-9)


@pytest.mark.parametrize("e", ECCENTRICITIES)
def test_constants_and_motion_are_inverse_and_the_constants_mean_what_they_say(e: float) -> None:
    start = orbit(e)
    constants = np.array([3.0, -20.0, 5.0, 0.4, 7.0, -11.0])
    state = free_motion(start, np.float64(0.0), constants)
    np.testing.assert_allclose(constants_of_motion(start, state), constants, atol=1e-12)
    later = advanced(start, np.float64(period(e)))
    drift = np.asarray(free_motion(later, np.float64(period(e)), constants)) - np.asarray(state)
    # In a period the servicer moves along the target's velocity (-kappa', kappa) and nowhere else.
    kappa, slope = 1.0 + e * np.cos(0.6), -e * np.sin(0.6)
    expected = 6.0 * np.pi * 0.4 / (1.0 - e * e) ** 1.5 * np.array([-slope, kappa, 0.0])
    np.testing.assert_allclose(drift[:3], expected, atol=1e-10)


@pytest.mark.parametrize("e", ECCENTRICITIES)
def test_derivatives_agree_with_differences(e: float) -> None:
    @jax.jit
    def position(elements: jax.Array, share: jax.Array) -> jax.Array:
        u, ex, ey, megametres = elements
        start = TargetOrbit(argument_of_latitude=u, ex=ex, ey=ey, semi_major_axis=1e6 * megametres)
        phi = yamanaka_ankersen.transition_matrix(start, share * period(e))
        return phi[:3] @ (jnp.array([1.0, 2.0, 3.0, 1e-3, 1e-3, 1e-3]))

    start = orbit(e)
    elements = jnp.array([2.7, start.ex, start.ey, 1e-6 * start.semi_major_axis])
    check_grads(position, (elements, jnp.asarray(0.3)), order=1, modes=["fwd", "rev"], eps=1e-6, rtol=1e-5)


def test_derivatives_of_an_equatorial_circular_orbit_are_finite() -> None:
    r, v = jnp.array([7.0e6, 0.0, 0.0]), jnp.array([0.0, np.sqrt(MU / 7.0e6), 0.0])

    @jax.jit
    def later(r: jax.Array, v: jax.Array) -> TargetOrbit:
        return yamanaka_ankersen.advanced(yamanaka_ankersen.target_orbit(r, v), jnp.asarray(100.0))

    slopes = jax.jacfwd(later, argnums=(0, 1))(r, v)
    assert all(bool(jnp.all(jnp.isfinite(leaf))) for leaf in jax.tree.leaves(slopes))


@pytest.mark.parametrize("e", ECCENTRICITIES)
def test_a_batch_in_single_precision_agrees_with_double(e: float) -> None:
    shares = np.linspace(0.01, 0.9, 7)
    starts = jax.vmap(lambda anomaly: orbit_at(e, anomaly))(np.linspace(-3.0, 3.0, 7))
    batched = jax.jit(vmap(yamanaka_ankersen.transition_matrix, in_axes=-1, out_axes=-1))
    double = np.asarray(batched(starts, jnp.asarray(shares * period(e))))
    single = batched(*jax.tree.map(lambda x: x.astype(jnp.float32), (starts, jnp.asarray(shares * period(e)))))
    assert single.dtype == jnp.float32
    scale = np.array([1.0] * 3 + [period(e) / 6.3] * 3)
    ratio = (scale[:, None] / scale[None, :])[:, :, None]
    # Thirty roundings of 6e-8, and up to forty times the angle's near the perigee of the eccentric orbit.
    allowed = 1e-4 * np.max(np.abs(double * ratio), axis=(0, 1))
    assert np.all(np.max(np.abs((np.asarray(single) - double) * ratio), axis=(0, 1)) < allowed)


@pytest.mark.parametrize("e", ECCENTRICITIES)
@pytest.mark.parametrize("place", [(0.0, -30.0, 0.0), (5.0, 20.0, -3.0)])
def test_a_motion_without_drift_comes_back_after_an_orbit(e: float, place: tuple[float, float, float]) -> None:
    at = orbit(e)
    start = np.concatenate([place, np.asarray(rate_without_drift(at, jnp.array(place)))])
    after = transition_matrix(at, jnp.asarray(period(e))) @ start
    np.testing.assert_allclose(after[:3], place, atol=1e-6)
