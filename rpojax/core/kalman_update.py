"""Kalman measurement update, one scalar row at a time: no matrix inverse and no LAPACK."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from rpojax.core.pytree import pytree


@pytree
class MeasurementRows:
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
class KalmanUpdate:
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


def update(
    covariance: Float[Array, "n n"],
    rows: MeasurementRows,
    HP: Float[Array, "m n"] | None = None,
    process_variance: Float[Array, " n"] | None = None,
    inflation_variance: Float[Array, " n"] | None = None,
) -> KalmanUpdate:
    """Processes the rows in order; the result equals the joint update (Bierman, Factorization Methods, 1977).

    `crossed` is the product of Jacobian and `covariance`, where the caller knows a shorter way to it; `gained` are
    variances that the state gets before the rows, `added` those that it gets after them. What each row leaves of the
    covariance is worked out on the few vectors that the rows need, and on the matrix once.
    """
    size = rows.jacobian.shape[1]
    none = jnp.zeros(size, dtype=covariance.dtype)
    process_variance, inflation_variance = (
        none if process_variance is None else process_variance,
        none if inflation_variance is None else inflation_variance,
    )
    deviation, log_likelihood = jnp.zeros_like(rows.jacobian[0]), jnp.zeros_like(rows.residual[0])
    processed: list[tuple[Array, Array]] = []
    innovations, variances = [], []
    for index in range(rows.residual.shape[0]):
        h, weight = rows.jacobian[index], rows.weight[index]
        Ph = (jnp.sum(covariance * h[None, :], axis=1) if HP is None else HP[index]) + process_variance * h
        for factor, before in processed:
            Ph = Ph - factor * jnp.sum(before * h, axis=0) * before
        s = jnp.sum(Ph * h, axis=0) + rows.variance[index]
        innovation = rows.residual[index] - jnp.sum(h * deviation, axis=0)
        deviation = deviation + weight / s * innovation * Ph
        log_likelihood = log_likelihood - 0.5 * weight * (jnp.log(2.0 * jnp.pi * s) + innovation * innovation / s)
        # The factor of Joseph's form for a weighted gain: 1 / s for a row that is used, and with that form's slope.
        processed.append(((2.0 - weight) * weight / s, Ph))
        innovations.append(innovation)
        variances.append(s)
    covariance = covariance + jnp.eye(size, dtype=covariance.dtype) * (process_variance + inflation_variance)[:, None]
    for factor, Ph in processed:
        covariance = covariance - factor * (Ph[:, None] * Ph[None, :])
    return KalmanUpdate(
        deviation=deviation,
        covariance=covariance,
        innovation=jnp.stack(innovations),
        innovation_variance=jnp.stack(variances),
        weight=rows.weight,
        log_likelihood=log_likelihood,
    )
