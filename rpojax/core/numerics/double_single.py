"""Double-single arithmetic: numbers as the unevaluated sum of two float32, for orbits in single precision.

For numbers whose products, and the parts that these are split into, stay in the range of float32, 1e-30 to 1e38.
"""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from rpojax.core.pytree import pytree

Singles = Float[Array, "..."]
Vector = Float[Array, "3"]
LowOrder = Float[Array, "2 3"] | None
"""Low-order parts of a position [m] and a velocity [m/s]; None in double precision."""


@pytree
class DoubleSingle:
    """A number, or an array of them, as `high + low`.

    Attributes:
        high: nearest float32
        low: remainder
    """

    high: Array
    low: Array

    def __add__(self, other: "DoubleSingle") -> "DoubleSingle":
        # Knuth, The Art of Computer Programming, volume 2, section 4.2.2, theorem B: exact for any order of magnitudes.
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
    """Float32 numbers with low-order parts of zero."""
    return DoubleSingle(high=value, low=jnp.zeros_like(value))


def from_float(value: float) -> DoubleSingle:
    """A Python number, rounded to two float32."""
    nearest = np.float32(value)
    return DoubleSingle(high=jnp.asarray(nearest), low=jnp.asarray(np.float32(value - float(nearest))))


def two_product(a: Singles, b: Singles) -> DoubleSingle:
    """Product of float32 numbers to twice their precision, from exact products of 12-bit halves (Dekker, 1971).

    Contraction of a product and a sum to one rounding does no harm, since only exact products are summed.
    """
    (a_high, a_low), (b_high, b_low) = _split(a), _split(b)
    leading, middle = a_high * b_high, a_high * b_low + a_low * b_high
    high = leading + middle
    return DoubleSingle(high=high, low=(middle - (high - leading)) + a_low * b_low)


def inverse_sqrt(square: DoubleSingle) -> DoubleSingle:
    """One over the square root, by a Newton step from that of the high-order part."""
    estimate = 1.0 / jnp.sqrt(square.high)
    squared = two_product(estimate, estimate)
    one = two_product(square.high, squared.high)
    error = ((1.0 - one.high) - one.low) - square.high * squared.low - square.low * squared.high
    return DoubleSingle(high=estimate, low=0.5 * estimate * error)


def add(high: Singles, low: Singles, term: Singles) -> tuple[Singles, Singles]:
    """Sum of `high + low` and a float32 `term`, as its high- and low-order parts."""
    summed = DoubleSingle(high=high, low=low) + from_single(term)
    return summed.high, summed.low


def add_to_state(
    r: Vector, v: Vector, low: LowOrder, change_r: Vector, change_v: Vector
) -> tuple[Vector, Vector, LowOrder]:
    """Position [m] and velocity [m/s] after a change, and their new low-order parts."""
    if low is None:
        return r + change_r, v + change_v, None
    r, low_r = add(r, low[0], change_r)
    v, low_v = add(v, low[1], change_v)
    return r, v, jnp.stack([low_r, low_v])


def subtract(r: Vector, low: Vector | None, other: Vector, other_low: Vector | None) -> Vector:
    """Difference of `r` and `other`, low-order parts included."""
    difference = r - other
    if low is not None:
        difference = difference + low
    return difference if other_low is None else difference - other_low


def _fast_two_sum(high: Singles, low: Singles) -> DoubleSingle:
    """Renormalised sum of two numbers, the first of the larger magnitude (Dekker, 1971)."""
    total = high + low
    return DoubleSingle(high=total, low=low - (total - high))


def _split(value: Singles) -> tuple[Singles, Singles]:
    high = jax.lax.reduce_precision(value, exponent_bits=8, mantissa_bits=11)
    return high, value - high
