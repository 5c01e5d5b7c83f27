"""Effect of burns on free motion against one that is propagated step by step with the exponential of a matrix."""

import jax
import jax.numpy as jnp
import numpy as np
from numpy_reference import MU, random_covariance
from scipy.linalg import expm

from rpojax.flight.cooperation import burn_effect, free_relative_motion
from rpojax.flight.cooperation.burn_effect import BurnSum

RADIUS = 6.9e6
GRADIENT = MU / RADIUS**3 * (3.0 * np.outer([0.6, 0.0, 0.8], [0.6, 0.0, 0.8]) - np.eye(3))
GENERATOR = np.block([[np.zeros((3, 3)), np.eye(3)], [GRADIENT, np.zeros((3, 3))]])
DT, STEPS, HEARD = 2.0, 40, 15

transition_matrix = jax.jit(free_relative_motion.transition_matrix)


@jax.jit
def sums(delta_v: jax.Array, covariances: jax.Array) -> BurnSum:
    """Sum after each step."""

    def step(burns: BurnSum, burn: tuple[jax.Array, jax.Array]) -> tuple[BurnSum, BurnSum]:
        after = burn_effect.advance(burns, jnp.asarray(GRADIENT), *burn, DT)
        return after, after

    return jax.lax.scan(step, burn_effect.initial(), (delta_v, covariances))[1]


def test_the_transition_is_the_exponential_in_either_sense_of_time() -> None:
    rate = np.sqrt(MU / RADIUS**3)
    scale = np.array([*3 * [1.0], *3 * [rate]])
    for t in (20.0, -20.0, 3.0):
        error = (np.asarray(transition_matrix(GRADIENT, t)) - expm(t * GENERATOR)) * scale[None, :] / scale[:, None]
        angle = rate * abs(t)
        # Of fourth order in the orbit angle, that of the velocity by the position of third order.
        assert np.max(np.abs(error[:3])) < angle**4
        assert np.max(np.abs(error[3:])) < angle**3
    np.testing.assert_array_equal(transition_matrix(GRADIENT, 0.0), np.eye(6))


def test_the_effect_since_a_message_is_that_of_the_burns_after_it() -> None:
    rng = np.random.default_rng(1)
    burning = rng.uniform(size=STEPS) < 0.4
    assert burning[:HEARD].any()
    assert burning[HEARD:].any()
    delta_v = burning[:, None] * rng.normal(0.0, 1e-2, (STEPS, 3))
    covariances = np.stack([on * random_covariance(rng, np.array([1e-4, 3e-4, 2e-4])) for on in burning])
    burns = sums(delta_v, covariances)

    flow, change, covariance = expm(DT * GENERATOR), np.zeros(6), np.zeros((6, 6))
    for k in range(HEARD, STEPS):
        change = flow @ change + np.concatenate([0.5 * DT * delta_v[k], delta_v[k]])
        covariance = flow @ covariance @ flow.T
        covariance[3:, 3:] += covariances[k]
    now, before = (jax.tree.map(lambda leaf, k=k: leaf[k], burns.at_start) for k in (STEPS - 1, HEARD - 1))
    found = burn_effect.since(now, before, burns.from_start[-1], jnp.asarray(DT * STEPS))
    sigma = np.sqrt(np.diag(covariance))
    np.testing.assert_allclose(found.change, change, rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(
        found.covariance / np.outer(sigma, sigma), covariance / np.outer(sigma, sigma), atol=1e-6
    )
    np.testing.assert_array_equal(found.covariance, found.covariance.T)
    np.testing.assert_array_equal(
        burn_effect.change_since(now, before, jnp.asarray(burns.from_start[-1])), found.change
    )
