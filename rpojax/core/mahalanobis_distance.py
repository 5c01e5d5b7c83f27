"""Mahalanobis distance and log-determinant of small covariances, without a matrix inverse."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from rpojax.core.numerics.short_scan import short_scan


def squared_mahalanobis_and_log_determinant(
    P: Float[Array, "n n"], error: Float[Array, " n"]
) -> tuple[Float[Array, ""], Float[Array, ""]]:
    """`e' P^-1 e` and `log det P` of an error (n,) and a covariance (n, n), conditioning on one component at a time."""

    def condition(
        carry: tuple[Array, Array, Array, Array], index: Array
    ) -> tuple[tuple[Array, Array, Array, Array], None]:
        P, e, squared_distance, log_determinant = carry
        column, variance, component = P[index], P[index, index], e[index]
        gain = column / variance
        conditioned = P - gain[:, None] * column[None, :], e - gain * component
        return (
            *conditioned,
            squared_distance + component * component / variance,
            log_determinant + jnp.log(variance),
        ), None

    zero = jnp.zeros((), dtype=error.dtype)
    initial = (P, error, zero, zero)
    _, _, squared_distance, log_determinant = short_scan(condition, initial, jnp.arange(error.shape[0]))
    return squared_distance, log_determinant
