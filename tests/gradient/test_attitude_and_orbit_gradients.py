"""Derivatives of quaternions, orbits, frames and integrators in both modes against finite differences."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from gradient_checks import POSITION, TOLERANCE, Kernel, P, Q, V, W, check, check_finite

from rpojax.core import frames, quaternion, vectors
from rpojax.core.numerics import gradient_safe, runge_kutta
from rpojax.core.numerics.exact_difference import Difference
from rpojax.core.numerics.runge_kutta import NODES, Method
from rpojax.core.orbits import (
    clohessy_wiltshire,
    gravity_gradient,
    keplerian_elements,
    sun_moon_ephemeris,
    third_body_gravity,
    zonal_gravity,
)
from rpojax.core.orbits.keplerian_elements import KeplerianElements
from rpojax.core.orbits.zonal_gravity import EARTH_GRAVITY
from rpojax.core.pytree import replace


@jax.jit
def algebra(x: jax.Array, q: jax.Array, p: jax.Array, v: jax.Array) -> Any:
    q, p, v = q + x[:4], p + x[4:8], v + x[8:]
    return quaternion.multiply(q, p), quaternion.rotate(q, v), quaternion.to_matrix(p), quaternion.normalize(q)


@jax.jit
def exponential(x: jax.Array, phi: jax.Array) -> jax.Array:
    return quaternion.exp(phi + x)


@jax.jit
def logarithm(x: jax.Array, phi: jax.Array) -> jax.Array:
    return quaternion.log(quaternion.exp(phi + x))


@jax.jit
def from_matrix(x: jax.Array, phi: jax.Array) -> jax.Array:
    return quaternion.from_matrix(quaternion.to_matrix(quaternion.exp(phi + x)))


@jax.jit
def rotation_between(x: jax.Array, a: jax.Array, b: jax.Array) -> jax.Array:
    """Rotation from `a` to `b`, with `b` rotated by a small rotation vector `x`."""
    return quaternion.rotation_vector_between(a, b + vectors.cross(x, b))


@jax.jit
def propagated(x: jax.Array, q: jax.Array, omega: jax.Array) -> jax.Array:
    return quaternion.propagate(q, omega + x[:3], 0.2 + x[3])


def test_derivatives_of_quaternion_algebra_are_right() -> None:
    check(algebra, 11, Q, P, V)


@pytest.mark.parametrize("angle", [1.5, 0.0, 1e-5, 3.1], ids=["regular", "zero", "tiny", "nearly half a turn"])
@pytest.mark.parametrize("kernel", [exponential, logarithm, from_matrix], ids=["exp", "log", "from_matrix"])
def test_derivatives_between_rotation_vectors_quaternions_and_matrices_are_right(kernel: Kernel, angle: float) -> None:
    check(kernel, 3, angle * V)


def test_derivatives_of_a_propagated_attitude_are_right() -> None:
    check(propagated, 4, Q, V)


def test_derivatives_of_the_rotation_between_directions_are_right() -> None:
    check(rotation_between, 3, V, W)


@pytest.mark.parametrize("direction", [np.array([1.0, 0.0, 0.0]), V], ids=["an axis", "a skew direction"])
def test_the_rotation_between_equal_directions_follows_the_second_one(direction: np.ndarray) -> None:
    found = jax.jacfwd(rotation_between)(np.zeros(3), direction, direction)
    # A small rotation x of the second direction rotates by the component of x perpendicular to it.
    np.testing.assert_allclose(found, np.eye(3) - np.outer(direction, direction), atol=TOLERANCE)


def test_the_rotation_between_opposite_directions_has_a_finite_derivative() -> None:
    check_finite(rotation_between, 3, V, -V)


@jax.jit
def orbit_state(x: jax.Array) -> Any:
    a, e, i, raan, w, nu = jnp.array([7.0e6, 0.0, 1.7, 1.3, 1.5, 0.4]) + x * jnp.array([1e6, 1, 1, 1, 1, 1.0])
    elements = KeplerianElements(
        semi_major_axis=a, eccentricity=e, inclination=i, raan=raan, argument_of_perigee=w, true_anomaly=nu
    )
    r_N, v_N = keplerian_elements.state_from_elements(elements)
    return r_N / 7e6, v_N / 7e3


@jax.jit
def gravities(x: jax.Array, r_N: jax.Array, d_N: jax.Array) -> Any:
    r = Difference(value=r_N + 1e6 * x[:3], change=d_N + 10.0 * x[3:])
    pull = zonal_gravity.gravity(EARTH_GRAVITY, 6, r)
    moon = third_body_gravity.third_body_acceleration(4.9028e12, 3.84e8 * jnp.asarray(W), r)
    gradient = gravity_gradient.gravity_gradient(r.value)
    return pull.value, 1e4 * pull.change, 1e6 * moon.value, 1e11 * moon.change, 1e6 * gradient


@jax.jit
def transition(x: jax.Array) -> Any:
    phi = clohessy_wiltshire.transition_matrix(1e-3 * (1.0 + x[0]), 200.0 * (1.0 + x[1]))
    scale = jnp.repeat(jnp.array([1.0, 1e-2]), np.array([3, 3]), total_repeat_length=6)
    return phi * scale[None, :] / scale[:, None]


@jax.jit
def axes(x: jax.Array, r_N: jax.Array, v_N: jax.Array) -> Any:
    R_HN, omega_N = frames.hill_frame(r_N + 1e6 * x[:3], v_N + 1e3 * x[3:6])
    return R_HN, 1e3 * omega_N, frames.look_at(v_N / 7e3 + x[6:9], r_N / 7e6 + x[9:])


def test_derivatives_of_the_state_from_elements_are_right_on_a_circular_orbit() -> None:
    check(orbit_state, 6)


@pytest.mark.parametrize("distance", [50.0, 0.0], ids=["apart", "at the target"])
@pytest.mark.parametrize("place", [POSITION, np.array([0.0, 0.0, 7e6])], ids=["anywhere", "over the pole"])
def test_derivatives_of_gravity_and_its_differences_are_right(place: np.ndarray, distance: float) -> None:
    check(gravities, 6, place, distance * V)


@jax.jit
def harmonics(x: jax.Array, r_N: jax.Array) -> Any:
    """Gravity less that of a point mass, as a function of position and of the field's constants."""
    field = replace(
        EARTH_GRAVITY,
        radius=EARTH_GRAVITY.radius * (1.0 + 0.1 * x[3]),
        zonals=jnp.asarray(EARTH_GRAVITY.zonals) + 1e-3 * x[4:],
    )
    r = Difference(value=r_N + 1e6 * x[:3], change=50.0 * jnp.asarray(V))
    full, point = (zonal_gravity.gravity(field, degree, r) for degree in (6, 0))
    return 1e2 * (full.value - point.value), 1e6 * (full.change - point.change)


@pytest.mark.parametrize("place", [POSITION, np.array([0.0, 0.0, 7e6]), np.array([0.0, -7e6, 0.0])],
                         ids=["anywhere", "over the pole", "over the equator"])  # fmt: skip
def test_derivatives_of_the_zonal_harmonics_are_right(place: np.ndarray) -> None:
    check(harmonics, 9, place)


@jax.jit
def sky(x: jax.Array) -> Any:
    seconds = 8e8 + 1e5 * x[0]
    return sun_moon_ephemeris.sun_position(seconds) / 1e10, sun_moon_ephemeris.moon_position(seconds) / 1e8


def test_derivatives_of_sun_and_moon_positions_are_right() -> None:
    check(sky, 1)


def pendulum_step(x: jax.Array, method: Method) -> Any:
    """A pendulum over one step, forced at the method's nodes."""
    forces = 1.0 + x[2] * jnp.asarray(NODES[method])
    start = (0.5 + x[0], 1.0 + x[1])
    return runge_kutta.step(method, lambda y, u: (y[1], u * (1.0 + x[3]) - jnp.sin(y[0])), start, forces, 0.5)


rk4_pendulum, rk8_pendulum = (jax.jit(lambda x, method=method: pendulum_step(x, method)) for method in ("rk4", "rk8"))


@pytest.mark.parametrize("kernel", [rk4_pendulum, rk8_pendulum], ids=["rk4", "rk8"])
def test_derivatives_through_a_step_of_integration_are_right(kernel: Kernel) -> None:
    check(kernel, 4)


def test_derivatives_of_the_transition_matrix_are_right() -> None:
    check(transition, 2)


def test_derivatives_of_hill_and_camera_axes_are_right() -> None:
    check(axes, 12, POSITION, 7e3 * W)


def test_the_gate_passes_a_derivative_only_near_its_threshold() -> None:
    slope = jax.jit(jax.grad(lambda x: gradient_safe.gate(x, jnp.asarray(0.1))))
    assert float(slope(0.01)) > 1.0
    assert float(slope(-0.01)) > 1.0
    assert float(slope(50.0)) == 0.0
