"""Thruster: force, execution errors, mass flow, and the exact impulse in a step."""

import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import quad

from rpojax.core.numerics.runge_kutta import NODES, Method
from rpojax.core.pytree import replace
from rpojax.physics.thruster import (
    BurnError,
    Thruster,
    ValveCommand,
    center_of_mass_shift,
    draw_burn_error,
    thrust_over_step,
)
from rpojax.scenario.params import Params

EXACT = 1e-14  # a few roundings of numbers near one
STEP = 0.2
METHODS: tuple[Method, ...] = ("rk4", "rk8")
thrust = jax.jit(thrust_over_step, static_argnums=(2, 3, 4))
compiled_shift = jax.jit(center_of_mass_shift)
NO_ERROR = BurnError(magnitude=jnp.zeros(()), direction=jnp.zeros(3))


def burn(ignition: float, cutoff: float, error: BurnError = NO_ERROR) -> ValveCommand:
    return ValveCommand(ignition=jnp.float64(ignition), cutoff=jnp.float64(cutoff), burn_error=error)


def test_the_force_of_an_aligned_thruster_has_its_direction_and_true_size(params: Params) -> None:
    thruster = replace(params.plant.thruster, direction=jnp.array([0.0, 3.0, 4.0]), force_scale=jnp.float64(1.1))
    found = thrust(thruster, burn(0.0, 1.0), "rk4", False, STEP)
    np.testing.assert_allclose(found.force_B, 0.033 * np.array([0.0, 0.6, 0.8]), rtol=EXACT)
    np.testing.assert_array_equal(found.position_B, [-0.25, 0.0, 0.0])


def test_misalignment_and_burn_error_rotate_and_scale_the_force(params: Params) -> None:
    thruster = replace(params.plant.thruster, misalignment=jnp.array([0.0, 0.0, 0.02]))
    error = BurnError(magnitude=jnp.float64(-0.1), direction=jnp.array([0.0, 0.0, 0.03]))
    force = thrust(thruster, burn(0.0, 1.0, error), "rk4", False, STEP).force_B
    np.testing.assert_allclose(force, 0.027 * np.array([np.cos(0.05), np.sin(0.05), 0.0]), atol=EXACT)


def test_burn_errors_have_the_thrusters_standard_deviations(params: Params) -> None:
    error = draw_burn_error(params.plant.thruster, jnp.array([1.0, -1.0, 2.0, 0.0]))
    np.testing.assert_allclose(error.magnitude, 0.01)
    np.testing.assert_allclose(error.direction, np.deg2rad([-0.2, 0.4, 0.0]))


def test_the_mass_flow_is_force_over_exhaust_speed(params: Params) -> None:
    thruster = replace(params.plant.thruster, force=jnp.float64(0.04), force_scale=jnp.float64(1.25))
    flow = thrust(thruster, burn(0.0, 1.0), "rk4", False, STEP).mass_flow
    np.testing.assert_allclose(flow, 0.05 / (70.0 * 9.80665), rtol=EXACT)


def test_the_centre_of_mass_moves_away_from_an_emptying_tank(params: Params) -> None:
    # 28 kg are left of 30; the tank was at -0.1 m along x: 28 c = -2 (-0.1).
    found = compiled_shift(params.plant.thruster, np.float64(2.0), np.float64(28.0))
    np.testing.assert_allclose(found, [0.2 / 28.0, 0.0, 0.0], rtol=EXACT)


def opening_moments(
    thruster: Thruster, begin: float, end: float, method: Method, ramps: bool, steps: int = 1
) -> np.ndarray:
    """Moments of the thrust profile over steps from 0, up to the degree of the method's nodes."""
    nodes = np.array(NODES[method])
    powers = np.arange(nodes.size)
    weights = np.linalg.solve(nodes[None, :] ** powers[:, None], 1.0 / (powers + 1.0))
    moments = np.zeros(nodes.size)
    for k in range(steps):
        found = np.asarray(thrust(thruster, burn(begin - k * STEP, end - k * STEP), method, ramps, STEP).node_factors)
        times = (k + nodes) * STEP
        moments += STEP * (weights * found) @ times[:, None] ** powers[None, :]
    return moments


def true_moments(thruster: Thruster, begin: float, end: float, count: int, ramps: bool, steps: int = 1) -> np.ndarray:
    """The same by quadrature of the true profile, piece by piece."""
    rise, fall = (float(thruster.rise_time), float(thruster.fall_time)) if ramps else (0.0, 0.0)
    peak = min((end - begin) / rise, 1.0) if rise > 0.0 else 1.0
    corners = [begin, begin + peak * rise, end, end + fall]
    pieces = np.unique(np.clip([0.0, *corners, steps * STEP], 0.0, steps * STEP))
    levels = {"xp": corners, "fp": [0.0, peak, peak, 0.0]}
    if not ramps:
        levels = {"xp": [begin, end], "fp": [1.0, 1.0], "left": 0.0, "right": 0.0}
    total = np.zeros(count)
    for low, high in itertools.pairwise(pieces):
        for power in range(count):
            total[power] += quad(lambda t, p=power: t**p * np.interp(t, **levels), low, high, epsabs=1e-16)[0]
    return total


def ready(params: Params, rise: float = 0.05, fall: float = 0.08) -> Thruster:
    """The thruster without a minimum on-time."""
    return replace(
        params.plant.thruster,
        minimum_on_time=jnp.zeros(()),
        rise_time=jnp.float64(rise),
        fall_time=jnp.float64(fall),
    )


@pytest.mark.parametrize("ramps", [False, True], ids=["on or off", "ramps"])
@pytest.mark.parametrize("method", METHODS)
@given(st.floats(-0.5, 0.3), st.floats(0.001, 0.5))
def test_the_thrust_of_a_step_has_the_impulse_and_the_moments_of_the_true_profile(
    params: Params, method: Method, ramps: bool, ignition: float, on_time: float
) -> None:
    thruster = ready(params)
    found = opening_moments(thruster, ignition, ignition + on_time, method, ramps)
    expected = true_moments(thruster, ignition, ignition + on_time, found.size, ramps)
    np.testing.assert_allclose(found, expected, atol=1e-15)


@pytest.mark.parametrize(("rise", "fall"), [(0.05, 0.08), (0.5, 0.7), (0.0, 0.0), (0.0, 0.3)])
@pytest.mark.parametrize("method", METHODS)
@given(st.floats(0.0, 0.4), st.floats(0.01, 1.0))
def test_the_moments_over_several_steps_are_exact_for_any_ramp_length(
    params: Params, method: Method, rise: float, fall: float, ignition: float, on_time: float
) -> None:
    thruster, steps = ready(params, rise, fall), 12
    found = opening_moments(thruster, ignition, ignition + on_time, method, True, steps)
    expected = true_moments(thruster, ignition, ignition + on_time, found.size, True, steps)
    # A ramp of zero duration is replaced by 1e-9 of a step.
    np.testing.assert_allclose(found, expected, atol=1e-14 if rise and fall else 1e-9)


@pytest.mark.parametrize("method", METHODS)
@given(st.floats(0.0, 1.0), st.floats(0.05, 1.0))
def test_the_impulse_is_on_time_plus_half_of_fall_less_rise(
    params: Params, method: Method, ignition: float, on_time: float
) -> None:
    impulse = opening_moments(ready(params), ignition, ignition + on_time, method, True, steps=12)[0]
    np.testing.assert_allclose(impulse, on_time + 0.5 * (0.08 - 0.05), atol=1e-14)


@pytest.mark.parametrize("method", METHODS)
def test_a_burn_cut_during_the_rise_falls_from_the_force_reached(params: Params, method: Method) -> None:
    # 20 of 50 ms: a peak of 0.4, half of it over 20 ms up and over 80 ms down.
    impulse = opening_moments(ready(params), 0.03, 0.05, method, True, steps=2)[0]
    np.testing.assert_allclose(impulse, 0.4 * 0.5 * (0.02 + 0.08), atol=1e-14)


@pytest.mark.parametrize("ramps", [False, True], ids=["on or off", "ramps"])
@pytest.mark.parametrize(("ignition", "cutoff"), [(-2.0, -1.0), (STEP, 1.0), (0.3, 0.9), (0.1, 0.1), (0.15, 0.05)])
def test_a_burn_outside_of_the_step_or_without_duration_gives_no_thrust(
    params: Params, ignition: float, cutoff: float, ramps: bool
) -> None:
    found = thrust(params.plant.thruster, burn(ignition, cutoff), "rk4", ramps, STEP)
    np.testing.assert_array_equal(found.node_factors, [0.0, 0.0, 0.0])
    # Without a minimum on-time only the rounding of two cancelling moments remains.
    found = thrust(ready(params), burn(ignition, cutoff), "rk4", ramps, STEP)
    np.testing.assert_allclose(found.node_factors, [0.0, 0.0, 0.0], atol=1e-15)


@pytest.mark.parametrize("ramps", [False, True], ids=["on or off", "ramps"])
def test_a_burn_below_the_minimum_on_time_gives_nothing(params: Params, ramps: bool) -> None:
    thruster = params.plant.thruster
    for begin in (-0.3, 0.0, 0.1):
        short, long = (thrust(thruster, burn(begin, begin + t), "rk4", ramps, STEP) for t in (0.499, 0.501))
        np.testing.assert_array_equal(short.node_factors, [0.0, 0.0, 0.0])
        assert np.max(long.node_factors) > 0.5


@jax.jit
def _impulse(thruster: Thruster, ignition: jax.Array, on_time: jax.Array) -> jax.Array:
    """Impulse [N s] over twelve steps with ramps."""

    def part(begin: jax.Array) -> jax.Array:
        cut = ValveCommand(ignition=ignition - begin, cutoff=ignition + on_time - begin, burn_error=NO_ERROR)
        found = thrust_over_step(thruster, cut, "rk4", True, STEP)
        return STEP / 6.0 * (found.node_factors @ jnp.array([1.0, 4.0, 1.0])) * found.force_B[0]

    return jnp.sum(jax.vmap(part)(STEP * jnp.arange(12, dtype=jnp.float64)))


_impulse_derivatives = jax.jit(jax.grad(_impulse, argnums=(1, 2)))


@pytest.mark.parametrize("on_time", [0.07, 0.513, 1.3])
def test_the_derivative_of_the_impulse_is_the_force_for_on_time_and_zero_for_ignition(
    params: Params, on_time: float
) -> None:
    to_ignition, to_on_time = _impulse_derivatives(ready(params), jnp.float64(0.31), jnp.float64(on_time))
    np.testing.assert_allclose(to_ignition, 0.0, atol=1e-15)
    np.testing.assert_allclose(to_on_time, 0.03, atol=1e-15)


@pytest.mark.parametrize(("on_time", "fraction"), [(1e-6, 1.0), (0.0, 0.5)], ids=["a microsecond", "no time"])
def test_the_derivative_of_the_shortest_burns_is_finite(params: Params, on_time: float, fraction: float) -> None:
    to_ignition, to_on_time = _impulse_derivatives(ready(params), jnp.float64(0.31), jnp.float64(on_time))
    # Impulse t / 0.05 (t + 0.08) / 2 of the full force: derivative 0.8 at zero, where it meets 0 of no burn.
    np.testing.assert_allclose(to_on_time, fraction * 0.03 * 0.8, rtol=1e-4)
    np.testing.assert_allclose(to_ignition, 0.0, atol=1e-12)
