"""Range between two servicers, measured by the time that a signal over their radio link takes both ways."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from rpojax.core.declared_numbers import number
from rpojax.core.numerics import gradient_safe
from rpojax.core.pytree import pytree


@pytree
class LinkRange:
    """Errors of the range over a link."""

    noise: Array = number("white noise of a range, 1 sigma", unit="m", at_least=0.0, default=0.1)
    bias_sigma: Array = number(
        "constant bias of each pair of servicers, 1 sigma over the runs", unit="m", at_least=0.0, default=0.05
    )


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
