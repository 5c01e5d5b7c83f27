"""Effect of a servicer's own burns on its motion: displacement from free motion since the start, and its covariance.

A message carries both, so that a receiver without a message for a while knows what the burns in between did, whatever
their number. Both are mapped back to the start: so they are sums that only grow, and the difference of two of them is
what the burns in between added, negative by rounding alone. If each side propagated the effect for itself, the
difference of two large covariances, each in the gravity gradient of another place, would exceed the effect of the
burns.
"""

import jax.numpy as jnp
from jaxtyping import Array, Float

from rpojax.core.numerics.fusion_barrier import fusion_barrier
from rpojax.core.pytree import pytree
from rpojax.core.vectors import apply, product
from rpojax.flight.cooperation.baseline_motion import transition_matrix

Vector = Float[Array, "3"]
Matrix = Float[Array, "3 3"]


@pytree
class BurnEffect:
    """Displacement by burns.

    Attributes:
        change: (6,) of position [m] and velocity [m/s] in N
        covariance: (6, 6) of the burns' execution errors
    """

    change: Array
    covariance: Array


@pytree
class BurnSum:
    """Sum of the effects of all burns, and the transitions between the start and now.

    Attributes:
        at_start: effect of all burns, mapped back to the start
        from_start: (6, 6) state transition matrix from the start to now
        to_start: (6, 6) state transition matrix from now to the start
    """

    at_start: BurnEffect
    from_start: Array
    to_start: Array


def none() -> BurnEffect:
    """Effect of no burns."""
    return BurnEffect(change=jnp.zeros(6), covariance=jnp.zeros((6, 6)))


def initial() -> BurnSum:
    """Sum at the start: no burns."""
    return BurnSum(at_start=none(), from_start=jnp.eye(6), to_start=jnp.eye(6))


def advance(burns: BurnSum, gravity_gradient: Matrix, delta_v_N: Vector, covariance: Matrix, dt: float) -> BurnSum:
    """Sum `dt` [s] later, in which the velocity changed by `delta_v_N` [m/s] with that covariance."""
    to_start = product(burns.to_start, transition_matrix(gravity_gradient, -dt))
    change = jnp.concatenate([0.5 * dt * delta_v_N, delta_v_N])
    half = product(to_start[:, 3:], covariance)
    added = product(half, to_start[:, 3:].T)
    at_start = BurnEffect(
        change=burns.at_start.change + apply(to_start, change),
        covariance=burns.at_start.covariance + 0.5 * (added + added.T),
    )
    from_start = product(transition_matrix(gravity_gradient, dt), burns.from_start)
    return BurnSum(at_start=at_start, from_start=from_start, to_start=to_start)


def since(now: BurnEffect, before: BurnEffect, from_start: Float[Array, "6 6"], time: Array) -> BurnEffect:
    """Effect of the burns between two sums, at the time to which `from_start` leads.

    That is `time` [s] since the start, equal in all runs.
    """
    # Fused into the second product, the first one would be repeated for every element of it.
    half = fusion_barrier(product(from_start, now.covariance - before.covariance), time)
    covariance = product(half, from_start.T)
    return BurnEffect(
        change=apply(from_start, now.change - before.change), covariance=0.5 * (covariance + covariance.T)
    )


def change_since(now: BurnEffect, before: BurnEffect, from_start: Float[Array, "6 6"]) -> Float[Array, "6"]:
    """The displacement alone of `since`."""
    return apply(from_start, now.change - before.change)
