"""Encke's method over one integration step, for orbits in single precision.

The reference is a parabola from the position, velocity and gravity at the start of the step, in double-single numbers
(zonal harmonics, a thousandth of gravity, in single ones). The integrated deviation from it is 2 mm in a step of 1 s.
The rounding error is 4e-10 m/s^2 for a point mass and 3e-9 m/s^2 with harmonics (root mean square; at worst 3e-8 m/s^2,
near the poles), against 4e-7 m/s^2 for all of gravity in single precision. The latter is equal for all runs of a
campaign on nearly the same orbit, so that averages over runs do not remove it.

In double precision there is no reference: position and velocity themselves are integrated.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import jax.numpy as jnp
from jaxtyping import Array, Float

from rpojax.core.numerics import double_single
from rpojax.core.numerics.double_single import DoubleSingle, LowOrder
from rpojax.core.numerics.exact_difference import Difference
from rpojax.core.orbits import zonal_gravity
from rpojax.core.orbits.zonal_gravity import GravityField

Vector = Float[Array, "3"]
Scalar = Float[Array, ""]
Time = Scalar | None


@dataclass(frozen=True)
class EnckeReference:
    """Reference orbit of one step, from which the integrated position and velocity deviate.

    Attributes:
        field: gravity
        degree: of its zonal harmonics
        r: (3,) position at the start of the step [m]
        v: (3,) velocity at the start [m/s]
        low: (2, 3) low-order parts of both; None in double precision
        a: (3,) gravity at the start [m/s^2]; None in double precision, without a reference
    """

    field: GravityField
    degree: int
    r: Vector
    v: Vector
    low: LowOrder
    a: DoubleSingle | None

    @property
    def integration_start(self) -> tuple[Vector, Vector]:
        """Initial position [m] and velocity [m/s] of the integration: zero deviations in single precision."""
        if self.a is None:
            return self.r, self.v
        return jnp.zeros_like(self.r), jnp.zeros_like(self.v)

    def node_times(self, nodes: Sequence[float], dt: float | Scalar) -> Float[Array, " nodes"] | None:
        """Times [s] in the step at the nodes of a method; None in double precision, where they are not needed."""
        return None if self.a is None else dt * jnp.asarray(nodes, dtype=self.r.dtype)

    def full_state(self, time: Time, r: Vector, v: Vector) -> tuple[Vector, Vector]:
        """Position [m] and velocity [m/s] from the integrated ones."""
        if self.a is None:
            return r, v
        assert time is not None
        return self.r + self._displacement(time, r), self.v + (time * self.a.high + v)

    def gravity(self, time: Time, r: Vector, r_other: Vector) -> Difference:
        """Acceleration [m/s^2] to integrate, at an integrated position [m], as the value.

        The change is the gravity of another spacecraft at the relative position `r_other` [m], less that of this one.
        """
        if self.a is None:
            return zonal_gravity.gravity(self.field, self.degree, Difference(value=r, change=r_other))
        assert time is not None
        displacement = self._displacement(time, r)
        from_start = zonal_gravity.gravity(self.field, self.degree, Difference(value=self.r, change=displacement))
        here = zonal_gravity.gravity(self.field, self.degree, Difference(value=self.r + displacement, change=r_other))
        return Difference(value=from_start.change, change=here.change)

    def final_state(
        self, dt: float | Scalar, increment_r: Vector, increment_v: Vector
    ) -> tuple[Vector, Vector, LowOrder]:
        """Position [m], velocity [m/s] and their low-order parts after a step of `dt` [s], from their increments.

        In single precision `dt` must be a Python number, which has the digits of double precision.
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
    """Reference of a step from a position [m] and a velocity [m/s] with their low-order parts in single precision."""
    return EnckeReference(
        field, degree, r, v, low, None if low is None else _gravity_at_start(field, degree, r, low[0])
    )


def _gravity_at_start(field: GravityField, degree: int, r: Vector, low: Vector) -> DoubleSingle:
    zonal = zonal_gravity.zonal_acceleration(field, degree, Difference(value=r, change=jnp.zeros_like(r)))
    return _two_body(field, DoubleSingle(high=r, low=low)) + double_single.from_single(zonal.value)


def _two_body(field: GravityField, r: DoubleSingle) -> DoubleSingle:
    """Gravity of a point mass [m/s^2] to 1e-12 m/s^2, but for the rounding of `mu`, equal for all orbits."""
    squares = r * r
    inverse = double_single.inverse_sqrt(squares[0] + squares[1] + squares[2])
    mu = double_single.from_single(-jnp.asarray(field.mu, dtype=r.high.dtype))
    strength = inverse * inverse * inverse * mu
    return DoubleSingle(high=strength.high[None], low=strength.low[None]) * r
