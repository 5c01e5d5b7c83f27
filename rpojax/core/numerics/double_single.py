"""Numbers as the sum of two singles, so that what rounding takes away from 7000 km and 7 km/s is not lost.

For float32 alone, and for numbers whose products and their halves stay within its range, 1e-30 to 1e38.
"""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from rpojax.core.pytree import pytree

Singles = Float[Array, "..."]
Vector = Float[Array, "3"]
LowOrder = Float[Array, "2 3"] | None
"""What is missing from a position [m] and a velocity [m/s]; None in double precision, which needs none."""


@pytree
class DoubleSingle:
    """A number or an array of them.

    Attributes:
        value: the nearest single
        rest: what it lacks
    """

    high: Array
    low: Array

    def __add__(self, other: "DoubleSingle") -> "DoubleSingle":
        # Knuth, The Art of Computer Programming, volume 2, section 4.2.2, theorem B: exact whichever is larger.
        total = self.high + other.high
        addend = total - self.high
        error = (self.high - (total - addend)) + (other.high - addend)
        return _fast_two_sum(total, error + self.low + other.low)

    def __mul__(self, other: "DoubleSingle") -> "DoubleSingle":
        leading = two_product(self.high, other.high)
        return _fast_two_sum(leading.high, leading.low + (self.high * other.low + self.low * other.high))

    def __getitem__(self, index: int) -> "DoubleSingle":
        return DoubleSingle(high=self.high[index], low=self.low[index])


def from_single(value: Singles) -> DoubleSingle:
    """Singles that lack nothing."""
    return DoubleSingle(high=value, low=jnp.zeros_like(value))


def from_float(value: float) -> DoubleSingle:
    """A number known to more digits than a single has."""
    nearest = np.float32(value)
    return DoubleSingle(high=jnp.asarray(nearest), low=jnp.asarray(np.float32(value - float(nearest))))


def two_product(a: Singles, b: Singles) -> DoubleSingle:
    """Product of singles to twice their digits: halves of 12 digits, whose products are exact (Dekker, 1971).

    No compiler can spoil it by fusing a product with a sum, as only exact products are summed up.
    """
    (a_top, a_low), (b_top, b_low) = _split(a), _split(b)
    top, middle = a_top * b_top, a_top * b_low + a_low * b_top
    value = top + middle
    return DoubleSingle(high=value, low=(middle - (value - top)) + a_low * b_low)


def inverse_sqrt(square: DoubleSingle) -> DoubleSingle:
    """One over the square root, by a Newton step from that of the value alone."""
    rough = 1.0 / jnp.sqrt(square.high)
    again = two_product(rough, rough)
    found = two_product(square.high, again.high)
    error = ((1.0 - found.high) - found.low) - square.high * again.low - square.low * again.high
    return DoubleSingle(high=rough, low=0.5 * rough * error)


def add(high: Singles, low: Singles, term: Singles) -> tuple[Singles, Singles]:
    """`total` with its residue and a part added, as the nearest numbers and their own residue."""
    summed = DoubleSingle(high=high, low=low) + from_single(term)
    return summed.high, summed.low


def add_to_state(
    r: Vector, v: Vector, low: LowOrder, change_r: Vector, change_v: Vector
) -> tuple[Vector, Vector, LowOrder]:
    """Position [m] and velocity [m/s] after a change, and what they lack then."""
    if low is None:
        return r + change_r, v + change_v, None
    r, low_r = add(r, low[0], change_r)
    v, low_v = add(v, low[1], change_v)
    return r, v, jnp.stack([low_r, low_v])


def subtract(r: Vector, low: Vector | None, other: Vector, other_low: Vector | None) -> Vector:
    """`r` less `other`, with what both of them lack."""
    difference = r - other
    if low is not None:
        difference = difference + low
    return difference if other_low is None else difference - other_low


def _fast_two_sum(high: Singles, low: Singles) -> DoubleSingle:
    total = high + low
    return DoubleSingle(high=total, low=low - (total - high))


def _split(value: Singles) -> tuple[Singles, Singles]:
    top = jax.lax.reduce_precision(value, exponent_bits=8, mantissa_bits=11)
    return top, value - top
