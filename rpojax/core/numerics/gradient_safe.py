"""Primitives with finite derivatives at their singular points, and a step function with a smooth derivative."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

_SMALLEST_SQUARE = 1e-300


def norm(vector: Float[Array, " n"]) -> Float[Array, ""]:
    """Euclidean length of `vector` (n,), with derivative 0 at the zero vector."""
    return sqrt(jnp.sum(vector * vector, axis=0))


def sqrt(x: Float[Array, "*shape"]) -> Float[Array, "*shape"]:
    """Square root of `x` (negative values count as zero), with derivative 0 at and below zero."""
    positive = x > _SMALLEST_SQUARE
    return jnp.where(positive, jnp.sqrt(jnp.where(positive, x, 1.0)), 0.0)


def normalize(vector: Float[Array, " n"]) -> Float[Array, " n"]:
    """Unit vector along `vector` (n,); the zero vector stays zero."""
    square = jnp.sum(vector * vector, axis=0)
    positive = square > _SMALLEST_SQUARE
    return jnp.where(positive, vector / jnp.sqrt(jnp.where(positive, square, 1.0)), 0.0)


def safe_div(numerator: Float[Array, "*shape"], denominator: Float[Array, "*shape"]) -> Float[Array, "*shape"]:
    """Quotient of the arguments, 0 with derivative 0 where the denominator is 0."""
    nonzero = denominator != 0.0
    return jnp.where(nonzero, numerator / jnp.where(nonzero, denominator, 1.0), 0.0)


@jax.custom_jvp
def gate(margin: Float[Array, ""], width: Float[Array, ""]) -> Float[Array, ""]:
    """Step function, 1.0 where `margin` is positive, with the derivative of a logistic step of the given width.

    The value is the hard decision of the flight software; the surrogate derivative lets a gradient see a decision that
    is close. Many widths from the threshold it vanishes, as that of the hard step does.
    """
    del width
    return jnp.where(margin > 0.0, 1.0, 0.0)


@gate.defjvp
def _gate_jvp(primals: tuple[Array, Array], tangents: tuple[Array, Array]) -> tuple[Array, Array]:
    margin, width = primals
    logistic = smooth_gate(margin, width)
    return gate(margin, width), logistic * (1.0 - logistic) / width * tangents[0]


def smooth_gate(margin: Float[Array, ""], width: Float[Array, ""]) -> Float[Array, ""]:
    """The logistic step of which `gate` has the derivative."""
    return jax.nn.sigmoid(margin / width)


def is_finite(tree: object) -> Bool[Array, ""]:
    """True if every number in the pytree is finite."""
    # A sum propagates any inf or nan, with one comparison instead of one per element.
    total = sum(jnp.sum(leaf * 0.0) for leaf in jax.tree.leaves(tree) if jnp.issubdtype(leaf.dtype, jnp.floating))
    return jnp.asarray(total) == 0.0
