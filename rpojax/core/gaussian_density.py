"""Normal densities of small vectors without a matrix inverse."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float


def squared_mahalanobis_and_log_determinant(
    P: Float[Array, "n n"], error: Float[Array, " n"]
) -> tuple[Float[Array, ""], Float[Array, ""]]:
    """`e' P^-1 e` and `log det P` of a covariance (n, n), by conditioning on one component after the other."""

    def condition(
        carry: tuple[Array, Array, Array, Array], index: Array
    ) -> tuple[tuple[Array, Array, Array, Array], None]:
        P, e, squared_distance, log_determinant = carry
        column, variance, own = P[index], P[index, index], e[index]
        gain = column / variance
        rest = P - gain[:, None] * column[None, :], e - gain * own
        return (*rest, squared_distance + own * own / variance, log_determinant + jnp.log(variance)), None

    zero = jnp.zeros((), dtype=error.dtype)
    (_, _, total, logarithm), _ = jax.lax.scan(condition, (P, error, zero, zero), jnp.arange(error.shape[0]))
    return total, logarithm
