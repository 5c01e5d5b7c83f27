"""Discrete Lyapunov equation."""

import jax
from jaxtyping import Array, Float

_DOUBLINGS = 24


def solve_lyapunov(F: Float[Array, "n n"], S: Float[Array, "n n"]) -> Float[Array, "n n"]:
    """Solution X of `X = F'XF + S` for a stable F, by doubling (Smith, 1968)."""

    def double(carry: tuple[Array, Array], _: None) -> tuple[tuple[Array, Array], None]:
        X, F = carry
        return (X + F.T @ X @ F, F @ F), None

    return jax.lax.scan(double, (S, F), None, length=_DOUBLINGS)[0][0]
