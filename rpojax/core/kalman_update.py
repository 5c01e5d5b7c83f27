"""Kalman measurement update, one scalar row at a time: no matrix inverse and no LAPACK."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from rpojax.core.pytree import pytree


@pytree
class MeasurementRows:
    """Linearised measurements of one epoch, `m` rows with independent noise.

    Attributes:
        residual: (m,) measured less predicted at zero deviation
        jacobian: (m, n) derivative of the measurement with respect to the state
        variance: (m,) of the noise
        weight: (m,) 1 where the row is used, 0 where it is not; a number, so that a decision can have a derivative
    """

    residual: Array
    jacobian: Array
    variance: Array
    weight: Array


@pytree
class KalmanUpdate:
    """Result of a measurement update.

    Attributes:
        deviation: (n,) correction of the state
        covariance: (n, n) after the update
        innovation: (m,) residual of each row given the rows before it
        innovation_variance: (m,)
        used: (m,) bool, rows that were used
        log_likelihood: () of the used rows
    """

    deviation: Array
    covariance: Array
    innovation: Array
    innovation_variance: Array
    used: Array
    log_likelihood: Array


def update(
    covariance: Float[Array, "n n"],
    rows: MeasurementRows,
    HP: Float[Array, "m n"] | None = None,
    process_variance: Float[Array, " n"] | None = None,
    inflation_variance: Float[Array, " n"] | None = None,
) -> KalmanUpdate:
    """Processes the rows in order; the result equals the joint update (Bierman, Factorization Methods, 1977).

    `HP` is the product of Jacobian and `covariance`, for callers that have a shorter way to compute it.
    `process_variance` is added to the diagonal of the covariance before the rows, `inflation_variance` after them.
    Between rows only the vectors `P h` are updated; the covariance matrix is updated once, after the last row.
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
        # The factor of Joseph's form for a weighted gain: 1 / s for a row that is used, with the same derivative.
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
        used=rows.weight > 0.5,
        log_likelihood=log_likelihood,
    )
