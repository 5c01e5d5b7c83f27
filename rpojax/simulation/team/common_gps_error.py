"""GPS errors that the receivers of a team have in common: those of ephemerides, clocks of satellites and ionosphere."""

import jax.numpy as jnp
from jaxtyping import Array, Float

Scalar = Float[Array, ""]


def correlate(share: Scalar, normals: Float[Array, "n N"]) -> Float[Array, "n N"]:
    """Standard normal numbers of each receiver with a correlation of `share` between any two of them.

    They are a Cholesky factor of that correlation matrix times independent ones, so that the first receiver keeps its
    own.
    """
    count = normals.shape[-1]
    rows: list[list[Array]] = []
    columns = []
    for i in range(count):
        row: list[Array] = []
        for j in range(i):
            known = sum((row[k] * rows[j][k] for k in range(j)), jnp.zeros_like(share))
            row.append((share - known) / rows[j][j])
        rest = sum((value * value for value in row), jnp.zeros_like(share))
        row.append(jnp.sqrt(1.0 - rest))
        rows.append(row)
        columns.append(sum((row[j] * normals[..., j] for j in range(i)), row[i] * normals[..., i]))
    return jnp.stack(columns, axis=-1)
