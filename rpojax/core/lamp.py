"""Lamp of the servicer: which targets it lights so that a camera beside it can see them."""

import math

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from rpojax.core.declared_numbers import number
from rpojax.core.numerics import gradient_safe
from rpojax.core.numerics.trigonometric_series import cos_sin
from rpojax.core.pytree import pytree
from rpojax.value_types import Direction

Scalar = Float[Array, ""]


@pytree
class Lamp:
    """A lamp beside the camera, on whenever the Sun does not suffice: an even beam, and its reach.

    The irradiance of the target falls with the square of the range, and the radiance that the camera sees is in
    proportion to it, whatever the range. So the reach is the root of the lamp's radiant intensity over the irradiance
    that the detector needs.
    """

    boresight: Array = number("middle of the beam, B; any length", form=Direction)
    beam_half_angle: Array = number(
        "half-angle of the beam, outside of which it is dark", unit="deg", above=0.0, at_most=90.0
    )
    reach: Array = number(
        "range up to which the target is lit as brightly as the detector needs; a lamp of four times the radiant "
        "intensity has twice the reach, and 0 is off",
        unit="m",
        at_least=0.0,
    )


def is_in_reach(lamp: Lamp, distance: Scalar, tolerance: Scalar | float = 0.0) -> Bool[Array, ""]:
    """True up to the reach; a `tolerance` [rad] of the direction is one of the distance [m] by its sine."""
    nearer = 1.0 - jnp.sin(jnp.minimum(tolerance, 0.5 * math.pi))
    return distance * nearer <= lamp.reach


def lights(lamp: Lamp, r_TS_B: Float[Array, "3"], tolerance: Scalar | float = 0.0) -> Bool[Array, ""]:
    """Whether the beam meets the middle of a target at `r_TS_B` [m] from the lamp in B, brightly enough.

    `tolerance` [rad] widens the beam and the reach.
    """
    distance = gradient_safe.norm(r_TS_B)
    along = jnp.sum(r_TS_B * gradient_safe.normalize(lamp.boresight), axis=0)
    # Cosines are monotonous between zero and a half circle only.
    widest = jnp.minimum(lamp.beam_half_angle + tolerance, math.pi)
    return is_in_reach(lamp, distance, tolerance) & (along >= distance * cos_sin(widest)[0])
