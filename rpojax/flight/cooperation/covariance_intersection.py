"""Split covariance intersection: fusion of two estimates whose errors may be correlated in an unknown way.

The covariance of each is split into a part that may be correlated with the other's errors and a part that is not; the
former are divided by the weights. The result is consistent whatever the correlation. Julier and Uhlmann, "A
non-divergent estimation algorithm in the presence of unknown correlations", 1997; "Using covariance intersection for
SLAM", 2007 (split form).
"""

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from rpojax.core import kalman_update
from rpojax.core.kalman_update import MeasurementRows
from rpojax.core.pytree import pytree
from rpojax.core.vectors import cross

Scalar = Float[Array, ""]
Matrix = Float[Array, "3 3"]

_BISECTIONS = 12
"""Halvings of the interval of the weight, after which it is known to 1e-4."""
_LEAST_WEIGHT = 1e-3
"""Estimates of less weight are left out, since they would be divided by it."""


@pytree
class SplitEstimate:
    """Mean with its covariance in two parts.

    Attributes:
        mean: (n,)
        correlated: (n, n) covariance of errors that may be correlated with those of other estimates
        independent: (n, n) of errors that are not
    """

    mean: Array
    correlated: Array
    independent: Array


def fuse(
    own: SplitEstimate, other: SplitEstimate, used: Bool[Array, ""], weight: Scalar
) -> tuple[Float[Array, " n"], Float[Array, "n n"]]:
    """Mean and covariance of the own estimate after another one of its first `m` components.

    `weight` is that of the own estimate, 0 to 1, as by `best_weight`; the own one is returned where the other is not
    `used`.
    """
    used = used & (weight < 1.0 - _LEAST_WEIGHT)
    weight = jnp.where(used, jnp.maximum(weight, _LEAST_WEIGHT), 0.5)
    P = jnp.where(used, own.correlated / weight, own.correlated) + own.independent
    return independent_fusion(own.mean, P, other.mean, other.correlated / (1.0 - weight) + other.independent, used)


def independent_fusion(
    mean: Float[Array, " n"],
    covariance: Float[Array, "n n"],
    other_mean: Float[Array, " m"],
    other_covariance: Float[Array, "m m"],
    used: Bool[Array, ""],
) -> tuple[Float[Array, " n"], Float[Array, "n n"]]:
    """Mean and covariance after another estimate of the first `m` components with independent errors.

    The two are one state, of which it is measured without noise that the components are the same.
    """
    n, m = mean.shape[0], other_mean.shape[0]
    joint = jnp.concatenate(
        [jnp.pad(covariance, ((0, 0), (0, m))), jnp.pad(other_covariance, ((0, 0), (n, 0)))], axis=0
    )
    same = jnp.eye(m, dtype=mean.dtype)
    rows = MeasurementRows(
        residual=other_mean - mean[:m],
        jacobian=jnp.concatenate([same, jnp.zeros((m, n - m), dtype=mean.dtype), -same], axis=1),
        variance=jnp.zeros(m, dtype=mean.dtype),
        weight=jnp.full(m, jnp.where(used, 1.0, 0.0)).astype(mean.dtype),
    )
    result = kalman_update.update(joint, rows, HP=joint[:m] - joint[n:])
    return mean + result.deviation[:n], result.covariance[:n, :n]


def best_weight(own_position: Matrix, other_position: Matrix) -> Scalar:
    """Weight of the first of two covariances of a position that makes the determinant of their intersection least.

    The determinant of the weighted information is a cubic in the weight, whose logarithm is concave.
    """
    A, B = _inverse(own_position), _inverse(other_position)
    # Scaled, so that the determinants stay in the range of single precision.
    scale = 1.0 / (jnp.trace(A) + jnp.trace(B))
    B, C = scale * B, scale * (A - B)
    first = jnp.sum(_adjugate(B).T * C)
    second = jnp.sum(B.T * _adjugate(C))
    third = jnp.sum(C[0] * cross(C[1], C[2]), axis=0)
    low, high = jnp.zeros_like(first), jnp.ones_like(first)
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        rises = first + middle * (2.0 * second + middle * 3.0 * third) > 0.0
        low, high = jnp.where(rises, middle, low), jnp.where(rises, high, middle)
    return jnp.where(high == 1.0, 1.0, jnp.where(low == 0.0, 0.0, 0.5 * (low + high)))


def _adjugate(M: Matrix) -> Matrix:
    """Transposed cofactors of a matrix."""
    return jnp.stack([cross(M[1], M[2]), cross(M[2], M[0]), cross(M[0], M[1])], axis=1)


def _inverse(M: Matrix) -> Matrix:
    """Inverse of a covariance."""
    adjugate = _adjugate(M)
    return adjugate / jnp.sum(M[0] * adjugate[:, 0], axis=0)
