"""Numbers as the sum of two singles, so that what rounding takes away from 7000 km and 7 km/s is not lost.

For float32 alone, and for numbers whose products and their halves stay within its range, 1e-30 to 1e38.
"""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from rpojax.core.pytree import pytree

Numbers = Float[Array, "..."]
Vector = Float[Array, "3"]
Residue = Float[Array, "2 3"] | None
"""What is missing from a position [m] and a velocity [m/s]; None in double precision, which needs none."""


@pytree
class TwoPart:
    """A number or an array of them.

    Attributes:
        value: the nearest single
        rest: what it lacks
    """

    value: Array
    rest: Array

    def __add__(self, other: "TwoPart") -> "TwoPart":
        # Knuth, The Art of Computer Programming, volume 2, section 4.2.2, theorem B: exact whichever is larger.
        rough = self.value + other.value
        given = rough - self.value
        missing = (self.value - (rough - given)) + (other.value - given)
        return _normalised(rough, missing + self.rest + other.rest)

    def __mul__(self, other: "TwoPart") -> "TwoPart":
        top = product(self.value, other.value)
        return _normalised(top.value, top.rest + (self.value * other.rest + self.rest * other.value))

    def __getitem__(self, index: int) -> "TwoPart":
        return TwoPart(value=self.value[index], rest=self.rest[index])


def whole(value: Numbers) -> TwoPart:
    """Singles that lack nothing."""
    return TwoPart(value=value, rest=jnp.zeros_like(value))


def constant(value: float) -> TwoPart:
    """A number known to more digits than a single has."""
    nearest = np.float32(value)
    return TwoPart(value=jnp.asarray(nearest), rest=jnp.asarray(np.float32(value - float(nearest))))


def product(a: Numbers, b: Numbers) -> TwoPart:
    """Product of singles to twice their digits: halves of 12 digits, whose products are exact (Dekker, 1971).

    No compiler can spoil it by fusing a product with a sum, as only exact products are summed up.
    """
    (a_top, a_low), (b_top, b_low) = _halves(a), _halves(b)
    top, middle = a_top * b_top, a_top * b_low + a_low * b_top
    value = top + middle
    return TwoPart(value=value, rest=(middle - (value - top)) + a_low * b_low)


def inverse_root(square: TwoPart) -> TwoPart:
    """One over the square root, by a Newton step from that of the value alone."""
    rough = 1.0 / jnp.sqrt(square.value)
    again = product(rough, rough)
    found = product(square.value, again.value)
    error = ((1.0 - found.value) - found.rest) - square.value * again.rest - square.rest * again.value
    return TwoPart(value=rough, rest=0.5 * rough * error)


def add(total: Numbers, residue: Numbers, part: Numbers) -> tuple[Numbers, Numbers]:
    """`total` with its residue and a part added, as the nearest numbers and their own residue."""
    after = TwoPart(value=total, rest=residue) + whole(part)
    return after.value, after.rest


def moved(r: Vector, v: Vector, residue: Residue, change_r: Vector, change_v: Vector) -> tuple[Vector, Vector, Residue]:
    """Position [m] and velocity [m/s] after a change, and what they lack then."""
    if residue is None:
        return r + change_r, v + change_v, None
    r, missing_r = add(r, residue[0], change_r)
    v, missing_v = add(v, residue[1], change_v)
    return r, v, jnp.stack([missing_r, missing_v])


def apart(r: Vector, residue: Vector | None, other: Vector, other_residue: Vector | None) -> Vector:
    """`r` less `other`, with what both of them lack."""
    difference = r - other
    if residue is not None:
        difference = difference + residue
    return difference if other_residue is None else difference - other_residue


def _normalised(value: Numbers, rest: Numbers) -> TwoPart:
    after = value + rest
    return TwoPart(value=after, rest=rest - (after - value))


def _halves(value: Numbers) -> tuple[Numbers, Numbers]:
    top = jax.lax.reduce_precision(value, exponent_bits=8, mantissa_bits=11)
    return top, value - top
