"""Orbits in single precision: what rounding takes away from 7000 km and 7 km/s is carried beside them."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from rpojax.core import integrate

Numbers = Float[Array, "..."]
Vector = Float[Array, "3"]
Residue = Float[Array, "2 3"] | None
"""What is missing from a position [m] and a velocity [m/s]; None in double precision, which needs none."""


def add(total: Numbers, residue: Numbers, part: Numbers) -> tuple[Numbers, Numbers]:
    """`total` with its residue and a part added, as the nearest numbers and their own residue.

    Knuth, The Art of Computer Programming, volume 2, section 4.2.2, theorem B: exact whichever of the two is larger.
    """
    rough = total + part
    given = rough - total
    missing = (total - (rough - given)) + (part - given) + residue
    after = rough + missing
    return after, missing - (after - rough)


def moved(r: Vector, v: Vector, residue: Residue, change_r: Vector, change_v: Vector) -> tuple[Vector, Vector, Residue]:
    """Position [m] and velocity [m/s] after a change, and what they lack then."""
    if residue is None:
        return r + change_r, v + change_v, None
    r, missing_r = add(r, residue[0], change_r)
    v, missing_v = add(v, residue[1], change_v)
    return r, v, jnp.stack([missing_r, missing_v])


def drifted(
    r: Vector, v: Vector, residue: Residue, change_r: Vector, change_v: Vector, dt: float
) -> tuple[Vector, Vector, Residue]:
    """The same after an `integrate.change` over `dt` [s], which knows of no residue and has rounded weights."""
    if residue is not None:
        short = integrate.lengthening(dt) * jnp.stack([change_r, change_v])
        residue = residue + short + jnp.stack([dt * residue[1], jnp.zeros_like(residue[1])])
    return moved(r, v, residue, change_r, change_v)


def apart(r: Vector, residue: Vector | None, other: Vector, other_residue: Vector | None) -> Vector:
    """`r` less `other`, with what both of them lack."""
    difference = r - other
    if residue is not None:
        difference = difference + residue
    return difference if other_residue is None else difference - other_residue
