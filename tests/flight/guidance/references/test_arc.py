"""Arcs about the target: their ends, their velocity, and how near they come."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from relative_motion_cases import advanced, entry, orbit

from rpojax.flight.guidance.references import arc
from rpojax.flight.guidance.references.arc import Arc

state = jax.jit(arc.state)
END, DURATION = np.array([0.0, 0.0, 8.0]), 300.0
STARTS = {
    "aside": [7.0, 4.0, -1.0, 0.0, 0.0, 0.0],
    "turning": [7.0, 4.0, -1.0, -0.06, 0.1, -0.02],
    "opposite": [0.0, 0.0, -9.0, 0.0, 0.0, 0.0],
    "there": [0.0, 0.0, 8.0, 0.0, 0.0, 0.0],
    "on the axis of its turn": [0.0, 0.0, 8.0, 0.1, 0.0, 0.0],
}


def flown(start: list[float], elapsed: float) -> np.ndarray:
    reference = Arc(position=jnp.asarray(END), duration=jnp.asarray(DURATION))
    seconds = jnp.asarray(elapsed)
    return np.asarray(state(reference, entry(*start), advanced(orbit(0.1), seconds), seconds))


@pytest.mark.parametrize("name", STARTS)
def test_it_begins_at_the_entry_and_ends_at_rest_at_its_place(name: str) -> None:
    start = np.array(STARTS[name])
    outward = start[:3] / np.linalg.norm(start[:3])
    begun = flown(STARTS[name], 0.0)
    np.testing.assert_allclose(begun[:3], start[:3], atol=1e-9)
    # Of the velocity at the entry it has the part across the line to the target.
    np.testing.assert_allclose(begun[3:], start[3:] - (start[3:] @ outward) * outward, atol=1e-9)
    for elapsed in (DURATION, DURATION + 50.0):
        np.testing.assert_allclose(flown(STARTS[name], elapsed), [*END, 0.0, 0.0, 0.0], atol=1e-9)


@pytest.mark.parametrize("name", STARTS)
def test_the_velocity_is_the_derivative_of_the_position(name: str) -> None:
    for elapsed in (5.0, 60.0, 150.0, 290.0):
        before, after = (flown(STARTS[name], elapsed + step)[:3] for step in (-1e-3, 1e-3))
        np.testing.assert_allclose(flown(STARTS[name], elapsed)[3:], (after - before) / 2e-3, atol=1e-6)


@pytest.mark.parametrize("name", STARTS)
def test_it_comes_no_nearer_than_its_ends(name: str) -> None:
    ends = [np.linalg.norm(STARTS[name][:3]), np.linalg.norm(END)]
    distances = [np.linalg.norm(flown(STARTS[name], elapsed)[:3]) for elapsed in np.linspace(0.0, DURATION, 61)]
    assert min(distances) >= min(ends) - 1e-9
    assert max(distances) <= max(ends) + 1e-9


def test_a_derivative_to_the_place_is_that_of_the_arc() -> None:
    def x(place: jax.Array) -> jax.Array:
        reference = Arc(position=place, duration=jnp.asarray(DURATION))
        return state(reference, entry(*STARTS["turning"]), orbit(0.1), jnp.asarray(120.0))[0]

    found = jax.grad(x)(jnp.asarray(END))
    for axis, step in enumerate(1e-5 * np.eye(3)):
        expected = (x(jnp.asarray(END + step)) - x(jnp.asarray(END - step))) / 2e-5
        np.testing.assert_allclose(found[axis], expected, atol=1e-7)
