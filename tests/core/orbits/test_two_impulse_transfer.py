"""Free motion between two positions, by the transition matrix itself."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from rpojax.core.constants import MU_EARTH
from rpojax.core.orbits import clohessy_wiltshire, two_impulse_transfer, yamanaka_ankersen
from rpojax.core.orbits.yamanaka_ankersen import TargetOrbit

RATE = 1.1e-3  # mean motion at 500 km
START, END = np.array([40.0, -300.0, 12.0]), np.array([5.0, -100.0, -30.0])
transition_matrix = jax.jit(clohessy_wiltshire.transition_matrix)
departure_velocity = jax.jit(two_impulse_transfer.departure_velocity)


def velocity(seconds: float) -> np.ndarray:
    dt = jnp.asarray(seconds)
    return np.asarray(departure_velocity(transition_matrix(jnp.asarray(RATE), dt), START, END, dt, RATE * dt))


@pytest.mark.parametrize("seconds", [10.0, 200.0, 2500.0, 4000.0, 15000.0])
def test_the_motion_ends_at_the_position(seconds: float) -> None:
    matrix = np.asarray(transition_matrix(jnp.asarray(RATE), jnp.asarray(seconds)))
    found = matrix @ np.concatenate([START, velocity(seconds)])
    np.testing.assert_allclose(found[:3], END, atol=1e-9)


def test_a_short_transfer_is_nearly_straight() -> None:
    np.testing.assert_allclose(velocity(1.0), END - START, rtol=0.02, atol=0.5)


@jax.jit
@jax.value_and_grad
def speed(seconds: jax.Array) -> jax.Array:
    matrix = clohessy_wiltshire.transition_matrix(jnp.asarray(RATE), seconds)
    return jnp.sum(
        two_impulse_transfer.departure_velocity(matrix, jnp.asarray(START), jnp.asarray(END), seconds, RATE * seconds)
    )


@pytest.mark.parametrize("turns", [0.5, 1.0, 1.5])
def test_at_times_without_a_solution_velocity_and_derivative_are_finite(turns: float) -> None:
    value, slope = speed(turns * 2.0 * np.pi / RATE)
    assert np.isfinite(value) and np.isfinite(slope)


SEMI_MAJOR_AXIS = 6.9e6
PERIOD = 2.0 * np.pi * np.sqrt(SEMI_MAJOR_AXIS**3 / MU_EARTH)
AT_REST = [0.0, -60.0, 0.0, 0.0, 0.0, 0.0]
ON_AN_ELLIPSE = [5.0, 45.0, 28.0, 0.02, 0.01, 0.01]
WAYS = {
    "along the track": (AT_REST, [0.0, -30.0, 0.0]),
    "to another height": (AT_REST, [10.0, -30.0, 0.0]),
    "from an ellipse": (ON_AN_ELLIPSE, [0.0, 40.0, 0.0]),
    "from far": ([0.0, -1000.0, 0.0, 0.0, 0.0, 0.0], [0.0, -250.0, 0.0]),
}


def orbit(e: float, u: float = 1.7) -> TargetOrbit:
    numbers = [u, e * np.cos(0.8), e * np.sin(0.8), SEMI_MAJOR_AXIS]
    return TargetOrbit(**dict(zip(TargetOrbit.__annotations__, map(jnp.float64, numbers), strict=True)))


@jax.jit
def flown(at: TargetOrbit, before: jax.Array, end: jax.Array, dt: jax.Array) -> tuple[jax.Array, ...]:
    """State after the departure, impulse on the way and its time, state at the arrival, and all impulses together."""
    arc = two_impulse_transfer.transfer_arc(at, before, end, dt)
    first = two_impulse_transfer.state_on_arc(arc, at, 0.0 * dt)
    last = two_impulse_transfer.state_on_arc(arc, at, dt)
    changes = jnp.stack([first[3:] - before[3:], arc.delta_v, last[3:]])
    total = jnp.sum(jnp.sqrt(jnp.sum(changes**2, axis=1) + 1e-30))
    return first, arc.delta_v, arc.impulse_after, last, total


slopes_of_total = jax.jit(jax.grad(lambda *arguments: flown(*arguments)[4], argnums=(0, 1, 2, 3)))
totals_flown = jax.jit(jax.vmap(lambda *arguments: flown(*arguments)[4], in_axes=(None, None, None, 0)))
advanced = jax.jit(yamanaka_ankersen.advanced)


def totals(way: str, e: float, times: np.ndarray) -> np.ndarray:
    before, end = map(np.asarray, WAYS[way])
    return np.asarray(totals_flown(orbit(e), before, end, times))


def two_body_difference(e: float, state: np.ndarray, seconds: float, at: float) -> np.ndarray:
    """Relative state in H after a time, from two Keplerian orbits in space, integrated side by side."""
    p = SEMI_MAJOR_AXIS * (1.0 - e * e)

    def frame(r: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        h = np.cross(r, v)
        axes = np.stack([r / np.linalg.norm(r), np.cross(h, r) / np.linalg.norm(np.cross(h, r)), h / np.linalg.norm(h)])
        return axes, np.array([0.0, 0.0, np.linalg.norm(h) / (r @ r)])

    nu = at - 0.8
    r_pqw = p / (1.0 + e * np.cos(nu)) * np.array([np.cos(nu), np.sin(nu), 0.0])
    v_pqw = np.sqrt(MU_EARTH / p) * np.array([-np.sin(nu), e + np.cos(nu), 0.0])
    axes, omega = frame(r_pqw, v_pqw)
    other = [r_pqw + axes.T @ state[:3], v_pqw + axes.T @ (state[3:] + np.cross(omega, state[:3]))]

    def rates(_: float, now: np.ndarray) -> np.ndarray:
        r, s = now[:3], now[6:9]
        return np.concatenate(
            [now[3:6], -MU_EARTH * r / np.linalg.norm(r) ** 3, now[9:], -MU_EARTH * s / np.linalg.norm(s) ** 3]
        )

    start = np.concatenate([r_pqw, v_pqw, *other])
    now = solve_ivp(rates, (0.0, seconds), start, method="DOP853", rtol=1e-13, atol=1e-7).y[:, -1]
    axes, omega = frame(now[:3], now[3:6])
    rho = axes @ (now[6:9] - now[:3])
    return np.concatenate([rho, axes @ (now[9:] - now[3:6]) - np.cross(omega, rho)])


@pytest.mark.parametrize("e", [0.0, 0.3])
@pytest.mark.parametrize("turns", [0.3, 0.5, 0.53, 0.98, 1.0, 1.405, 2.0])
def test_it_leads_to_its_end_in_space_at_every_time(turns: float, e: float) -> None:
    """Two orbits, integrated; what linear motion neglects, 60 m squared over the radius, drifts by centimetres."""
    for before, end in (WAYS["to another height"], WAYS["from an ellipse"]):
        seconds = turns * PERIOD
        first, impulse, after, _, _ = map(
            np.asarray, flown(orbit(e), jnp.asarray(before), jnp.asarray(end), jnp.asarray(seconds))
        )
        here = float(advanced(orbit(e), after).argument_of_latitude)
        middle = two_body_difference(e, first, float(after), 1.7)
        middle[3:] += impulse
        np.testing.assert_allclose(two_body_difference(e, middle, seconds - float(after), here)[:3], end, atol=0.1)


@pytest.mark.parametrize("way", WAYS)
def test_what_it_takes_is_bounded_and_continuous_over_all_times(way: str) -> None:
    """Without the third impulse it grows beyond all bounds at half turns across the track, and near whole orbits."""
    n = 2.0 * np.pi / PERIOD
    start, end = (np.array(each) for each in WAYS[way])
    # The way and the motion at the start, at three times the orbital rate. The times are six seconds apart.
    size = np.linalg.norm(end - start[:3]) + np.linalg.norm(start[3:]) / n + 0.2 * np.linalg.norm(start[:3])
    times = PERIOD * np.arange(0.3, 2.6, 0.001)
    found = totals(way, 0.0, times)
    assert np.max(found) < 3.0 * n * size
    assert np.max(np.abs(np.diff(found))) < 0.06 * n * size


def test_whole_orbits_along_the_track_take_two_small_impulses() -> None:
    """The drift of 3 times the impulse in each period: 30 m in one, 750 m in two (22 mm/s)."""
    one, two = (
        totals("along the track", 0.0, PERIOD * np.array([1.0])),
        totals("from far", 0.0, PERIOD * np.array([2.0])),
    )
    np.testing.assert_allclose(one, 2.0 * 30.0 / (3.0 * PERIOD), rtol=0.01)
    np.testing.assert_allclose(two, 2.0 * 750.0 / (6.0 * PERIOD), rtol=0.01)


def test_half_an_orbit_from_an_ellipse_takes_no_more_than_its_cross_track_motion() -> None:
    """At a node one impulse would stop the motion across the track; near half an orbit two impulses take any number."""
    n, across = 2.0 * np.pi / PERIOD, np.hypot(28.0, 0.01 * PERIOD / (2.0 * np.pi))
    for turns in (0.49, 0.5, 0.51):
        first, impulse, _, last, _ = flown(
            orbit(0.0), jnp.asarray(ON_AN_ELLIPSE), jnp.array([0.0, 40.0, 0.0]), jnp.asarray(turns * PERIOD)
        )
        found = abs(float(first[5]) - 0.01) + abs(float(impulse[2])) + abs(float(last[5]))
        assert found < 2.2 * n * across


@pytest.mark.parametrize("e", [0.0, 1e-9, 0.7, 0.9])
@pytest.mark.parametrize("turns", [0.2, 0.5, 1.0, 1.5, 2.0])
def test_derivatives_of_an_arc_are_finite_at_all_times(turns: float, e: float) -> None:
    before, end = map(np.asarray, WAYS["from an ellipse"])
    slopes = slopes_of_total(orbit(e), before, end, np.float64(turns * PERIOD))
    assert all(np.all(np.isfinite(each)) for each in jax.tree.leaves(slopes))


def test_an_arc_does_not_depend_on_how_the_argument_of_latitude_counts_turns() -> None:
    before, end = map(jnp.asarray, WAYS["from an ellipse"])
    for e, u in ((0.0, np.pi), (0.3, -np.pi), (0.3, 3.0)):
        one, other = (flown(orbit(e, u + turn), before, end, jnp.asarray(0.52 * PERIOD)) for turn in (0.0, 2.0 * np.pi))
        for a, b in zip(one, other, strict=True):
            np.testing.assert_allclose(a, b, rtol=1e-9, atol=1e-9)
