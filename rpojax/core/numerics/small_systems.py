"""Symmetric positive definite systems of a few unknowns, written out, without LAPACK; further axes hold others."""

import jax.numpy as jnp
from jaxtyping import Array, Float

Matrices = Float[Array, "n n *systems"]
Vectors = Float[Array, "n *systems"]


def _cholesky_rows(matrix: Matrices) -> list[list[Array]]:
    """Rows of the lower Cholesky factor, with the inverse of each element of the diagonal in its place.

    A pivot that is not positive counts as infinite: what it belongs to is solved as zero.
    """
    rows: list[list[Array]] = []
    for i in range(matrix.shape[0]):
        row: list[Array] = []
        for j in range(i + 1):
            rest = matrix[i, j]
            for k in range(j):
                rest = rest - row[k] * (row[k] if i == j else rows[j][k])
            if j < i:
                row.append(rest * rows[j][j])
            else:
                positive = rest > 0.0
                row.append(jnp.where(positive, 1.0 / jnp.sqrt(jnp.where(positive, rest, 1.0)), 0.0))
        rows.append(row)
    return rows


def _solve_with_rows(rows: list[list[Array]], right: list[Array]) -> list[Array]:
    """Solution of the system of `_cholesky_rows` for a right side, element by element."""
    count = len(rows)
    half: list[Array] = []
    for i in range(count):
        rest = right[i]
        for k in range(i):
            rest = rest - rows[i][k] * half[k]
        half.append(rest * rows[i][i])
    found: list[Array] = [half[-1]] * count
    for i in reversed(range(count)):
        rest = half[i]
        for k in range(i + 1, count):
            rest = rest - rows[k][i] * found[k]
        found[i] = rest * rows[i][i]
    return found


def solve_positive_definite(matrix: Matrices, right: Vectors) -> Vectors:
    """Solution of `matrix x = right`."""
    return jnp.stack(_solve_with_rows(_cholesky_rows(matrix), [right[i] for i in range(matrix.shape[0])]))


def inverse_positive_definite(matrix: Matrices) -> Matrices:
    """Inverse of a symmetric positive definite matrix."""
    count = matrix.shape[0]
    # Rows of the identity, for all columns of the inverse at once.
    identity = jnp.eye(count, dtype=matrix.dtype).reshape(count, count, *[1] * (matrix.ndim - 2))
    right = [jnp.broadcast_to(row, matrix.shape[1:]) for row in identity]
    rows = [[each[None] for each in row] for row in _cholesky_rows(matrix)]
    return jnp.stack(_solve_with_rows(rows, right))
