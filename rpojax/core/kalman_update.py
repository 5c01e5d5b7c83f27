"""Kalman measurement update, one scalar row at a time: no matrix inverse and no LAPACK."""

from collections.abc import Callable
from dataclasses import dataclass

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


@dataclass(frozen=True)
class SequentialGains:
    """Rows processed in order, before the covariance is reduced by them; lists have an entry of each row.

    Attributes:
        deviation: (n,) correction of the state
        vectors: (n,) product of covariance and row, given the rows before it
        factors: () by which the outer product of a vector is taken from the covariance
        innovation: () residual given the rows before it
        innovation_variance: ()
        log_likelihood: () of the used rows
    """

    deviation: Array
    vectors: list[Array]
    factors: list[Array]
    innovation: list[Array]
    innovation_variance: list[Array]
    log_likelihood: Array


def sequential_gains(rows: MeasurementRows, product: Callable[[int], Array]) -> SequentialGains:
    """Correction by rows in order, for callers that keep the covariance in parts.

    `product` of the number of a row is the covariance before all of them times that row (n,).
    """
    deviation, log_likelihood = jnp.zeros_like(rows.jacobian[0]), jnp.zeros_like(rows.residual[0])
    vectors: list[Array] = []
    factors: list[Array] = []
    innovations: list[Array] = []
    variances: list[Array] = []
    for index in range(rows.residual.shape[0]):
        h, weight = rows.jacobian[index], rows.weight[index]
        Ph = product(index)
        for factor, before in zip(factors, vectors, strict=True):
            Ph = Ph - factor * jnp.sum(before * h, axis=0) * before
        s = jnp.sum(Ph * h, axis=0) + rows.variance[index]
        innovation = rows.residual[index] - jnp.sum(h * deviation, axis=0)
        deviation = deviation + weight / s * innovation * Ph
        log_likelihood = log_likelihood - 0.5 * weight * (jnp.log(2.0 * jnp.pi * s) + innovation * innovation / s)
        # The factor of Joseph's form for a weighted gain: 1 / s for a row that is used, with the same derivative.
        factors.append((2.0 - weight) * weight / s)
        vectors.append(Ph)
        innovations.append(innovation)
        variances.append(s)
    return SequentialGains(deviation, vectors, factors, innovations, variances, log_likelihood)


def reduced_by_rows(
    covariance: Float[Array, "n n"], rows: MeasurementRows
) -> tuple[SequentialGains, Float[Array, "n n"]]:
    """Gains of rows, and the covariance after them."""
    gains = sequential_gains(rows, lambda index: jnp.sum(covariance * rows.jacobian[index][None, :], axis=1))
    for factor, vector in zip(gains.factors, gains.vectors, strict=True):
        covariance = covariance - factor * (vector[:, None] * vector[None, :])
    return gains, covariance


def part_after(
    part: Float[Array, "n n"],
    rows: MeasurementRows,
    gains: SequentialGains,
    noise_variance: Float[Array, " m"] | None = None,
) -> Float[Array, "n n"]:
    """Part of a covariance that comes from some sources of error, after the rows.

    Of the rows' noise `noise_variance` (m,) comes from these sources, by default nothing.
    """
    for index, (s, vector) in enumerate(zip(gains.innovation_variance, gains.vectors, strict=True)):
        h, gain = rows.jacobian[index], rows.weight[index] / s * vector
        product = jnp.sum(part * h[None, :], axis=1)
        mixed = gain[:, None] * product[None, :]
        variance = jnp.sum(product * h, axis=0) + (0.0 if noise_variance is None else noise_variance[index])
        part = part - (mixed + mixed.T) + variance * (gain[:, None] * gain[None, :])
    return part


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

    def product(index: int) -> Array:
        h = rows.jacobian[index]
        Ph = jnp.sum(covariance * h[None, :], axis=1) if HP is None else HP[index]
        return Ph + process_variance * h

    gains = sequential_gains(rows, product)
    covariance = covariance + jnp.eye(size, dtype=covariance.dtype) * (process_variance + inflation_variance)[:, None]
    for factor, Ph in zip(gains.factors, gains.vectors, strict=True):
        covariance = covariance - factor * (Ph[:, None] * Ph[None, :])
    return KalmanUpdate(
        deviation=gains.deviation,
        covariance=covariance,
        innovation=jnp.stack(gains.innovation),
        innovation_variance=jnp.stack(gains.innovation_variance),
        used=rows.weight > 0.5,
        log_likelihood=gains.log_likelihood,
    )
