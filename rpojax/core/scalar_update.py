"""Kalman measurement update, one scalar row at a time in Joseph form: no matrix inverse and no LAPACK."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from rpojax.core.pytree import pytree


@pytree
class Rows:
    """Linearised measurements of one epoch, `m` rows with independent noise.

    Attributes:
        residual: (m,) measured less predicted at zero deviation
        jacobian: (m, n) derivative of the measurement to the state
        variance: (m,) of the noise
        weight: (m,) 1 where the row is used, 0 where it is not
    """

    residual: Array
    jacobian: Array
    variance: Array
    weight: Array


@pytree
class Update:
    """Result of an update.

    Attributes:
        deviation: (n,) correction of the state
        covariance: (n, n) after the update
        innovation: (m,) residual of each row given the rows before it
        innovation_variance: (m,)
        weight: (m,) 1 for the rows that were used, 0 for the others
        log_likelihood: () of the used rows
    """

    deviation: Array
    covariance: Array
    innovation: Array
    innovation_variance: Array
    weight: Array
    log_likelihood: Array


def update(covariance: Float[Array, "n n"], rows: Rows) -> Update:
    """Processes the rows in order; the result equals the joint update (Bierman, Factorization Methods, 1977)."""
    deviation = jnp.zeros_like(rows.jacobian[0])

    def one(carry: tuple[Array, Array, Array], row: Rows) -> tuple[tuple[Array, Array, Array], tuple[Array, Array]]:
        deviation, P, log_likelihood = carry
        h = row.jacobian
        Ph = jnp.sum(P * h[None, :], axis=1)
        s = jnp.sum(Ph * h, axis=0) + row.variance
        innovation = row.residual - jnp.sum(h * deviation, axis=0)
        k = row.weight / s * Ph
        # Joseph form of a rank-one update: symmetric by construction, and right for any gain, also a gated one.
        P = P - k[:, None] * Ph[None, :] - Ph[:, None] * k[None, :] + s * k[:, None] * k[None, :]
        gain = -0.5 * row.weight * (jnp.log(2.0 * jnp.pi * s) + innovation * innovation / s)
        return (deviation + k * innovation, P, log_likelihood + gain), (innovation, s)

    start = (deviation, covariance, jnp.zeros_like(rows.residual[0]))
    (deviation, covariance, log_likelihood), (innovation, variance) = jax.lax.scan(one, start, rows)
    return Update(
        deviation=deviation,
        covariance=covariance,
        innovation=innovation,
        innovation_variance=variance,
        weight=rows.weight,
        log_likelihood=log_likelihood,
    )
