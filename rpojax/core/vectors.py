"""Products of 3-vectors and small matrices, written out: under `vmap` they stay loops over the batch."""

import jax.numpy as jnp
from jaxtyping import Array, Float

Vector = Float[Array, "3"]
Matrix = Float[Array, "3 3"]


def cross(a: Vector, b: Vector) -> Vector:
    """Cross product of two 3-vectors."""
    # Slices of one row take half of the operations that scalars do, which counts in compiling: it is used everywhere.
    (ax, ay, az), (bx, by, bz) = ((each[:1], each[1:2], each[2:]) for each in (a, b))
    return jnp.concatenate([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx])


def line_of_sight_rate(r: Vector, v: Vector) -> Vector:
    """Rate [rad/s] at which the direction of a place (3,) [m] turns that moves by `v` (3,) [m/s]."""
    return cross(r, v) / jnp.sum(r * r, axis=0)


def apply(matrix: Float[Array, "m n"], vector: Float[Array, " n"]) -> Float[Array, " m"]:
    """Product of a matrix and a vector."""
    return jnp.sum(matrix * vector[None, :], axis=1)


def apply_transposed(matrix: Matrix, vector: Vector) -> Vector:
    """Product of the transpose of a 3x3 matrix and a 3-vector, such as H components back to N components."""
    return jnp.sum(matrix * vector[:, None], axis=0)


def product(A: Float[Array, "m n"], B: Float[Array, "n k"]) -> Float[Array, "m k"]:
    """Matrix product as an explicit sum over few columns, which the compiler vectorises over a batch."""
    total = A[:, :1] * B[:1]
    for index in range(1, A.shape[1]):
        total = total + A[:, index : index + 1] * B[index : index + 1]
    return total


def across_axes(axis: Vector) -> tuple[Vector, Vector]:
    """Two unit vectors across a unit vector, which follow it smoothly but near -x; of x itself they are y and z.

    Frisvad, Building an Orthonormal Basis from a 3D Unit Vector Without Normalization, 2012.
    """
    x, y, z = axis
    ahead = jnp.maximum(1.0 + x, 1e-6)
    first = jnp.stack([-y, 1.0 - y * y / ahead, -y * z / ahead])
    return first, cross(axis, first)
