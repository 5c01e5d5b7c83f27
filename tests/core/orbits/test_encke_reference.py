"""Encke's method in single precision against orbits in double precision."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from rpojax.core.numerics import runge_kutta
from rpojax.core.orbits import encke_reference
from rpojax.core.orbits.zonal_gravity import EARTH_GRAVITY, GravityField
from rpojax.simulation import single_precision

DEGREE = 2


def starts() -> tuple[np.ndarray, np.ndarray]:
    """Positions [m] and velocities [m/s] of eight low orbits in all directions."""
    rng = np.random.default_rng(3)
    r = rng.normal(size=(8, 3))
    r *= rng.uniform(6.7e6, 7.4e6, (8, 1)) / np.linalg.norm(r, axis=1, keepdims=True)
    v = np.cross(r, rng.normal(size=(8, 3)))
    return r, v * np.sqrt(EARTH_GRAVITY.mu / np.linalg.norm(r, axis=1, keepdims=True)) / np.linalg.norm(
        v, axis=1, keepdims=True
    )


ROUNDED = GravityField(mu=float(np.float32(EARTH_GRAVITY.mu)), radius=EARTH_GRAVITY.radius, zonals=EARTH_GRAVITY.zonals)
"""Gravity with `mu` rounded to float32."""


def step(r: jax.Array, v: jax.Array, low: jax.Array | None, dt: float) -> tuple[jax.Array, ...]:
    """Position, velocity and their low-order parts after `dt` [s]."""
    reference = encke_reference.reference_orbit(ROUNDED, DEGREE, r, v, low)

    def derivative(y: tuple[jax.Array, jax.Array], time: jax.Array | None) -> tuple[jax.Array, jax.Array]:
        return y[1], reference.gravity(time, y[0], jnp.zeros(3)).value

    change = runge_kutta.increment(
        "rk4", derivative, reference.integration_start, reference.node_times(runge_kutta.NODES["rk4"], dt), dt
    )
    return reference.final_state(dt, *change)


def propagate(r: np.ndarray, v: np.ndarray, dt: float, single: bool) -> tuple[np.ndarray, np.ndarray]:
    """Position [m] and velocity [m/s] after 500 s in steps of `dt` [s]."""

    def whole(r: jax.Array, v: jax.Array, low: jax.Array | None) -> tuple[jax.Array, ...]:
        return jax.lax.scan(lambda y, _: (step(*y, dt), None), (r, v, low), None, length=round(500 / dt))[0]

    if not single:
        after = jax.jit(jax.vmap(lambda r, v: whole(r, v, None)))(r, v)
        return np.asarray(after[0]), np.asarray(after[1])
    near = r.astype(np.float32), v.astype(np.float32)
    low = np.stack([r - near[0], v - near[1]], axis=1).astype(np.float32)
    with single_precision.tracing_in_single():
        found = [np.asarray(each, dtype=np.float64) for each in jax.jit(jax.vmap(whole))(*near, low)]
    return found[0] + found[2][:, 0], found[1] + found[2][:, 1]


@pytest.fixture(scope="module")
def final_states() -> dict[tuple[float, bool], tuple[np.ndarray, np.ndarray]]:
    """Final states by step [s] and by whether they are in single precision."""
    r, v = starts()
    return {(dt, single): propagate(r, v, dt, single) for dt in (0.2, 1.0) for single in (False, True)}


def test_steps_of_a_plant_and_of_a_filter_differ_by_far_less_than_the_filters_accuracy(
    final_states: dict[tuple[float, bool], tuple[np.ndarray, np.ndarray]],
) -> None:
    for number, bound in enumerate((5e-4, 1e-6)):  # [m], [m/s]
        double, single = (final_states[1.0, kind][number] - final_states[0.2, kind][number] for kind in (False, True))
        assert np.max(np.abs(single - double)) < bound


def test_orbits_in_single_precision_equal_those_in_double_precision(
    final_states: dict[tuple[float, bool], tuple[np.ndarray, np.ndarray]],
) -> None:
    for dt in (0.2, 1.0):
        for number, bound in enumerate((1e-3, 4e-6)):  # [m], [m/s]
            assert np.max(np.abs(final_states[dt, True][number] - final_states[dt, False][number])) < bound


def test_state_and_gravity_in_the_middle_of_a_step() -> None:
    r, v = (each[0] for each in starts())
    near = r.astype(np.float32), v.astype(np.float32)
    with single_precision.tracing_in_single():
        single = encke_reference.reference_orbit(
            EARTH_GRAVITY, DEGREE, *map(jnp.asarray, near), jnp.zeros((2, 3), jnp.float32)
        )
        half = jnp.float32(0.5)
        place, speed = single.full_state(half, *single.integration_start)
        other = single.gravity(half, single.integration_start[0], jnp.asarray([3.0, -40.0, 5.0], dtype=jnp.float32))
    double = encke_reference.reference_orbit(EARTH_GRAVITY, DEGREE, jnp.asarray(r), jnp.asarray(v), None)
    begin, then = (double.gravity(None, jnp.asarray(at), jnp.array([3.0, -40.0, 5.0])) for at in (r, r + 0.5 * v))
    np.testing.assert_allclose(place, r + 0.5 * v + 0.125 * np.asarray(begin.value), atol=0.6)
    np.testing.assert_allclose(speed, v + 0.5 * np.asarray(begin.value), atol=2e-3)
    np.testing.assert_allclose(other.value, then.value - begin.value, atol=3e-6)
    np.testing.assert_allclose(other.change, then.change, rtol=1e-5, atol=1e-11)
