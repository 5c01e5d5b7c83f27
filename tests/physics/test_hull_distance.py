"""Distance from a convex hull against a search over it."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import minimize

from rpojax.physics import hull_distance

distance = jax.jit(hull_distance.distance_from_hull)
BOX = np.array([[x, y, z] for x in (-0.25, 0.25) for y in (-0.8, 0.8) for z in (-0.3, 0.3)])


def random_hull(seed: int) -> np.ndarray:
    return np.random.default_rng(seed).normal(size=(12, 3)) * [0.5, 1.0, 0.3]


def by_search(vertices: np.ndarray, point: np.ndarray) -> float:
    """Distance from the nearest mean of the vertices."""

    def square(weights: np.ndarray) -> tuple[float, np.ndarray]:
        away = weights @ vertices - point
        return float(away @ away), 2.0 * vertices @ away

    count = len(vertices)
    found = minimize(
        square,
        np.full(count, 1.0 / count),
        jac=True,
        method="SLSQP",
        bounds=[(0.0, 1.0)] * count,
        constraints=[{"type": "eq", "fun": lambda weights: weights.sum() - 1.0}],
        options={"ftol": 1e-14, "maxiter": 500},
    )
    return float(np.sqrt(found.fun))


@pytest.mark.parametrize("seed", range(4))
def test_outside_it_is_that_of_the_nearest_place(seed: int) -> None:
    vertices, random = random_hull(seed), np.random.default_rng(100 + seed)
    faces = hull_distance.faces_of(vertices)
    for direction in random.normal(size=(12, 3)):
        point = (2.0 + random.uniform(0.0, 6.0)) * direction / np.linalg.norm(direction)
        found = float(distance(vertices, faces, jnp.asarray(point)))
        np.testing.assert_allclose(found, by_search(vertices, point), atol=2e-6)


@pytest.mark.parametrize(
    ("point", "expected"),
    [
        ([0.0, 0.0, 1.5], 1.2),
        ([1.25, 0.0, 0.0], 1.0),
        ([1.25, 1.8, 0.0], np.sqrt(2.0)),
        ([1.25, 1.8, 1.3], np.sqrt(3.0)),
        ([0.25, 0.8, 0.3], 0.0),
        ([0.0, 0.0, 0.0], -0.25),
        ([0.0, 0.0, 0.2], -0.1),
    ],
)
def test_of_a_box(point: list[float], expected: float) -> None:
    found = float(distance(BOX, hull_distance.faces_of(BOX), jnp.array(point)))
    np.testing.assert_allclose(found, expected, atol=1e-12)


def test_the_derivative_is_the_direction_away() -> None:
    faces, point = hull_distance.faces_of(BOX), jnp.array([1.25, 1.8, 1.3])
    away = np.ones(3) / np.sqrt(3.0)
    np.testing.assert_allclose(jax.grad(distance, argnums=2)(jnp.asarray(BOX), faces, point), away, atol=1e-9)
