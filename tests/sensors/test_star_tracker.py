"""Star tracker statistics."""

import jax
import jax.numpy as jnp
import numpy as np
from reference import random_unit

from rpojax.core import quaternion
from rpojax.core.pytree import replace
from rpojax.sensors import star_tracker
from rpojax.sensors.star_tracker import StarTracker
from rpojax.simulation.params import Params

SAMPLES = 10_000
FOUR_SIGMA = 4.0  # one false alarm in 16000, and the seeds are fixed


@jax.jit
def errors(sensor: StarTracker, q_BN: jax.Array, normals: jax.Array) -> jax.Array:
    """Rotation vectors (n, 3) from the true to the measured attitudes, body axes."""

    def one(normals: jax.Array) -> jax.Array:
        measured = star_tracker.measure(sensor, q_BN, normals)
        return quaternion.log(quaternion.multiply(measured, quaternion.conjugate(q_BN)))

    return jax.vmap(one)(normals)


def test_attitude_errors_have_the_misalignment_as_mean_and_each_body_axis_its_own_noise(params: Params) -> None:
    rng = np.random.default_rng(4)
    misalignment = np.deg2rad([0.02, -0.01, 0.03])
    sensor = replace(params.star_tracker, misalignment=jnp.asarray(misalignment))
    found = np.asarray(errors(sensor, random_unit(rng, 4), rng.normal(size=(SAMPLES, 3))))
    sigma = np.deg2rad([0.01, 0.003, 0.003])
    np.testing.assert_allclose(found.std(axis=0), sigma, rtol=FOUR_SIGMA / np.sqrt(2 * SAMPLES))
    assert np.all(np.abs(found.mean(axis=0) - misalignment) < FOUR_SIGMA * sigma / np.sqrt(SAMPLES))


def test_a_perfect_star_tracker_measures_the_attitude(params: Params) -> None:
    q_BN = random_unit(np.random.default_rng(5), 4)
    np.testing.assert_allclose(errors(params.star_tracker, q_BN, np.zeros((1, 3))), np.zeros((1, 3)), atol=1e-15)
