"""The loss of the landmark network."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from rpojax.training.pose.landmark_loss import negative_log_likelihood


def _random(seed: int, scale: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Places, roots and true places that are `scale` from them."""
    rng = np.random.default_rng(seed)
    places = rng.uniform(0.0, 96.0, (2, 3, 2))
    roots = np.tril(rng.normal(size=(2, 3, 2, 2)))
    roots[..., [0, 1], [0, 1]] = rng.uniform(0.3, 3.0, (2, 3, 2))
    return places, roots, places + scale * rng.normal(size=places.shape)


def test_small_errors_cost_what_a_normal_density_says() -> None:
    places, roots, true = _random(0, 0.1)
    from scipy.stats import multivariate_normal

    covariance = roots @ roots.transpose(0, 1, 3, 2)
    expected = [
        -multivariate_normal.logpdf(true[i, j], places[i, j], covariance[i, j]) - np.log(2.0 * np.pi)
        for i in range(2)
        for j in range(3)
    ]
    found = negative_log_likelihood(*(jnp.asarray(each) for each in (places, roots, true)))
    np.testing.assert_allclose(np.asarray(found).ravel(), expected, rtol=1e-6)


@pytest.mark.parametrize("scale", [0.1, 30.0])
def test_its_gradient_is_that_of_differences(scale: float) -> None:
    places, roots, true = _random(1, scale)

    def total(places: jax.Array, roots: jax.Array) -> jax.Array:
        return jnp.sum(negative_log_likelihood(places, jnp.tril(roots), jnp.asarray(true)))

    slopes = jax.grad(total, (0, 1))(jnp.asarray(places), jnp.asarray(roots))
    for number, values in enumerate((places, roots)):
        for index in np.ndindex(values.shape):
            if number == 1 and index[-2:] == (0, 1):
                continue  # above the diagonal
            arguments = [[np.array(each) for each in (places, roots)] for _ in range(2)]
            arguments[0][number][index] += 1e-6
            arguments[1][number][index] -= 1e-6
            high, low = (float(total(*(jnp.asarray(each) for each in given))) for given in arguments)
            assert abs(float(slopes[number][index]) - (high - low) / 2e-6) < 1e-4 * (1.0 + abs(high - low) / 2e-6)


def test_far_errors_pull_no_harder_than_near_ones() -> None:
    places, roots, _ = _random(2, 0.0)

    def slope(distance: float) -> float:
        given = jnp.asarray(places), jnp.asarray(np.broadcast_to(np.eye(2), roots.shape))
        true = given[0] + jnp.array([distance, 0.0])[None, None]
        return float(jax.grad(lambda at: jnp.sum(negative_log_likelihood(at, given[1], true)))(given[0])[0, 0, 0])

    assert abs(slope(50.0)) == pytest.approx(abs(slope(5.0)))
    assert abs(slope(50.0)) == pytest.approx(2.0 * abs(slope(2.0)))
