"""Star tracker statistics and Sun exclusion."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from numpy_reference import SEEDS, axis_angle_quaternion, random_unit, rotation_matrix

from rpojax.core import quaternion
from rpojax.core.pytree import replace
from rpojax.scenario.params import Params
from rpojax.sensors import star_tracker
from rpojax.sensors.star_tracker import StarTracker

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


sees_stars = jax.jit(star_tracker.is_available)


@pytest.mark.parametrize(("off_sun_deg", "sees"), [(0.0, False), (29.9, False), (30.1, True), (180.0, True)])
def test_a_star_tracker_is_not_available_within_its_exclusion_angle_of_the_sun(
    params: Params, off_sun_deg: float, sees: bool
) -> None:
    # Its boresight is body +x; the body is rotated about its z axis.
    q_BN = axis_angle_quaternion(np.array([0.0, 0.0, 1.0]), np.deg2rad(off_sun_deg))
    assert bool(sees_stars(params.star_tracker, q_BN, np.array([1.5e11, 0.0, 0.0]))) is sees


@given(SEEDS)
def test_the_angle_to_the_sun_is_that_of_the_boresight_in_inertial_axes(params: Params, seed: int) -> None:
    rng = np.random.default_rng(seed)
    boresight, q_BN, sun = 3.0 * random_unit(rng), random_unit(rng, 4), 1.5e11 * random_unit(rng)
    cosine = (rotation_matrix(q_BN).T @ boresight / 3.0) @ sun / 1.5e11
    angle = np.arccos(cosine)
    for exclusion in (0.99 * angle, min(1.01 * angle, np.pi)):
        sensor = replace(params.star_tracker, boresight=jnp.asarray(boresight), sun_exclusion=jnp.float64(exclusion))
        assert bool(sees_stars(sensor, q_BN, sun)) is bool(angle > exclusion)
