"""An orbit over one step of integration: as it is in double precision, about a parabola in single (Encke's method).

The parabola goes on with the position, the velocity and the gravity of the step's beginning, known to twice the digits
of single precision but for the harmonics, which are a thousandth. What is integrated is the deviation from it, 2 mm in
a step of 1 s. Rounding then errs by 4e-10 m/s^2 for a point mass and 3e-9 m/s^2 with harmonics (root mean square; by
3e-8 m/s^2 at worst, near the poles). It errs by 4e-7 m/s^2 where all of gravity is summed up in single precision, and
alike for all runs of a campaign that are on nearly the same orbit, so that no average over runs is rid of it.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import jax.numpy as jnp
from jaxtyping import Array, Float

from rpojax.core.numerics import double_single
from rpojax.core.numerics.double_single import DoubleSingle, LowOrder
from rpojax.core.numerics.exact_difference import Difference
from rpojax.core.orbits import orbital_mechanics
from rpojax.core.orbits.orbital_mechanics import GravityField

Vector = Float[Array, "3"]
Scalar = Float[Array, ""]
Time = Scalar | None


@dataclass(frozen=True)
class EnckeReference:
    """What the position and the velocity that are integrated in a step are counted from.

    Attributes:
        field: gravity
        degree: of its zonal harmonics
        r: (3,) position at the beginning [m]
        v: (3,) velocity there [m/s]
        residue: (2, 3) what both lack; None in double precision
        a: (3,) gravity there [m/s^2]; None in double precision, where position and velocity are counted from zero
    """

    field: GravityField
    degree: int
    r: Vector
    v: Vector
    low: LowOrder
    a: DoubleSingle | None

    @property
    def integration_start(self) -> tuple[Vector, Vector]:
        """Position [m] and velocity [m/s] to integrate from."""
        if self.a is None:
            return self.r, self.v
        return jnp.zeros_like(self.r), jnp.zeros_like(self.v)

    def node_times(self, nodes: Sequence[float], dt: float | Scalar) -> Float[Array, " nodes"] | None:
        """Times [s] at which a method with these nodes asks for derivatives, as far as they matter."""
        return None if self.a is None else dt * jnp.asarray(nodes, dtype=self.r.dtype)

    def full_state(self, time: Time, r: Vector, v: Vector) -> tuple[Vector, Vector]:
        """Position [m] and velocity [m/s] in full, of those that are integrated."""
        if self.a is None:
            return r, v
        assert time is not None
        return self.r + self._displacement(time, r), self.v + (time * self.a.high + v)

    def gravity(self, time: Time, r: Vector, r_other: Vector) -> Difference:
        """Acceleration [m/s^2] to integrate at a position as it is integrated [m], as the value.

        The change is the acceleration of another craft, so far from there [m], less that of this one.
        """
        if self.a is None:
            return orbital_mechanics.gravity(self.field, self.degree, Difference(value=r, change=r_other))
        assert time is not None
        displacement = self._displacement(time, r)
        from_start = orbital_mechanics.gravity(self.field, self.degree, Difference(value=self.r, change=displacement))
        here = orbital_mechanics.gravity(
            self.field, self.degree, Difference(value=self.r + displacement, change=r_other)
        )
        return Difference(value=from_start.change, change=here.change)

    def final_state(
        self, dt: float | Scalar, increment_r: Vector, increment_v: Vector
    ) -> tuple[Vector, Vector, LowOrder]:
        """Position [m], velocity [m/s] and what they lack after a step of `dt` [s] with the changes of both.

        In single precision `dt` is a number of Python's, of which more digits are known.
        """
        if self.a is None:
            return self.r + increment_r, self.v + increment_v, None
        assert self.low is not None
        assert isinstance(dt, float)
        duration = double_single.from_float(dt)
        v_start = DoubleSingle(high=self.v, low=self.low[1])
        half_acceleration_term = double_single.from_single(0.5 * dt * dt * self.a.high)
        r = (
            DoubleSingle(high=self.r, low=self.low[0])
            + v_start * duration
            + half_acceleration_term
            + double_single.from_single(increment_r)
        )
        v = v_start + self.a * duration + double_single.from_single(increment_v)
        return r.high, v.high, jnp.stack([r.low, v.low])

    def _displacement(self, time: Scalar, deviation: Vector) -> Vector:
        assert self.a is not None
        return time * (self.v + 0.5 * time * self.a.high) + deviation


def reference_orbit(field: GravityField, degree: int, r: Vector, v: Vector, low: LowOrder) -> EnckeReference:
    """Course of a step from a position [m] and a velocity [m/s] with what they lack in single precision."""
    return EnckeReference(
        field, degree, r, v, low, None if low is None else _gravity_at_start(field, degree, r, low[0])
    )


def _gravity_at_start(field: GravityField, degree: int, r: Vector, low: Vector) -> DoubleSingle:
    zonal = orbital_mechanics.zonal_acceleration(field, degree, Difference(value=r, change=jnp.zeros_like(r)))
    return _two_body(field, DoubleSingle(high=r, low=low)) + double_single.from_single(zonal.value)


def _two_body(field: GravityField, r: DoubleSingle) -> DoubleSingle:
    """Gravity of a point mass [m/s^2], right to 1e-12 m/s^2 but for the rounding of `mu`, the same for all orbits."""
    squares = r * r
    inverse = double_single.inverse_sqrt(squares[0] + squares[1] + squares[2])
    mu = double_single.from_single(-jnp.asarray(field.mu, dtype=r.high.dtype))
    strength = inverse * inverse * inverse * mu
    return DoubleSingle(high=strength.high[None], low=strength.low[None]) * r
