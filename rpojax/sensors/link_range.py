"""Range between two servicers, measured by the time that a signal over their radio link takes both ways."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from rpojax.core.numerics import gradient_safe
from rpojax.core.pytree import pytree


@pytree
class LinkRange:
    """Errors of the range over a link.

    Attributes:
        noise: () white noise, 1 sigma [m]
        bias_sigma: () constant bias of each pair of servicers, 1 sigma over runs [m]
    """

    noise: Array
    bias_sigma: Array


def bias(link_range: LinkRange, normals: Float[Array, "N N"]) -> Float[Array, "N N"]:
    """Biases [m] of all pairs from standard normal numbers: the same both ways, since it is that of both radios."""
    upper = jnp.triu(normals, 1)
    return link_range.bias_sigma * (upper + upper.T)


def measure(
    link_range: LinkRange, r_N: Float[Array, "3 N"], biases: Float[Array, "N N"], normals: Float[Array, "N N"]
) -> Float[Array, "N N"]:
    """Ranges [m] that each servicer (row) measures to each other one, at positions `r_N` [m]."""
    rows = []
    for i in range(r_N.shape[1]):
        ranges = [gradient_safe.norm(r_N[:, j] - r_N[:, i]) for j in range(r_N.shape[1])]
        rows.append(jnp.stack(ranges))
    return jnp.stack(rows) + biases + link_range.noise * normals
