"""Effect of a servicer's own burns on its motion: displacement from free motion since the start, and its covariance.

A message carries it, so that a receiver that heard nothing for a while knows what the burns in between did, however
many there were: the effect at the message less the propagated effect at the one before it.
"""

import jax.numpy as jnp
from jaxtyping import Array, Float

from rpojax.core.pytree import pytree
from rpojax.flight.cooperation.free_relative_motion import apply, product

Vector = Float[Array, "3"]
Matrix = Float[Array, "3 3"]


@pytree
class BurnEffect:
    """Displacement by burns.

    Attributes:
        change: (6,) of position [m] and velocity [m/s] in N
        covariance: (6, 6) of the burns' execution errors, propagated alike
    """

    change: Array
    covariance: Array


def initial() -> BurnEffect:
    """Before the first burn."""
    return BurnEffect(change=jnp.zeros(6), covariance=jnp.zeros((6, 6)))


def propagate(effect: BurnEffect, transition: Float[Array, "6 6"]) -> BurnEffect:
    """Effect after free motion with this state transition matrix."""
    half = product(transition, effect.covariance)
    return BurnEffect(change=apply(transition, effect.change), covariance=product(transition, half.T))


def burn(effect: BurnEffect, delta_v_N: Vector, covariance: Matrix, dt: float) -> BurnEffect:
    """Effect at the end of `dt` [s] in which the velocity changed by `delta_v_N` [m/s] with that covariance."""
    change = jnp.concatenate([0.5 * dt * delta_v_N, delta_v_N])
    return BurnEffect(
        change=effect.change + change, covariance=effect.covariance + jnp.pad(covariance, ((3, 0), (3, 0)))
    )


def since(now: BurnEffect, before: BurnEffect) -> BurnEffect:
    """Effect of the burns since `before`, which has been propagated to the same time."""
    return BurnEffect(change=now.change - before.change, covariance=now.covariance - before.covariance)
