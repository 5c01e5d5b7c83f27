"""When a visible-light camera can see its target."""

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from rpojax.core.numerics.gradient_safe import normalize
from rpojax.core.numerics.trigonometric_series import cos_sin
from rpojax.core.orbits.eclipse import is_lit

Vector = Float[Array, "3"]
Scalar = Float[Array, ""]


def is_observable(
    r_TN_N: Vector, r_ST_N: Vector, r_sun_N: Vector, phase_limit: Scalar, sun_exclusion: Scalar
) -> Bool[Array, ""]:
    """True where the target is lit, its phase angle small enough, and the Sun far enough from the line of sight.

    Arguments are those of `viewing_conditions`.
    """
    lit, phase, glare = viewing_conditions(r_TN_N, r_ST_N, r_sun_N, phase_limit, sun_exclusion)
    return lit & phase & glare


def light_sources(
    r_TN_N: Vector,
    r_ST_N: Vector,
    r_sun_N: Vector,
    phase_limit: Scalar,
    sun_exclusion: Scalar,
    lamplit: Bool[Array, ""],
) -> tuple[Bool[Array, ""], Bool[Array, ""]]:
    """Whether the target can be seen in the light of the Sun, and whether in that of a lamp beside the camera.

    A lamp needs no Sun, but a Sun near the line of sight blinds the camera where the Earth does not hide it. `lamplit`
    says that the lamp lights the target; the other arguments are those of `viewing_conditions`.
    """
    lit, phase, glare = viewing_conditions(r_TN_N, r_ST_N, r_sun_N, phase_limit, sun_exclusion)
    return lit & phase & glare, lamplit & (glare | ~lit)


def viewing_conditions(
    r_TN_N: Vector, r_ST_N: Vector, r_sun_N: Vector, phase_limit: Scalar, sun_exclusion: Scalar
) -> tuple[Bool[Array, ""], Bool[Array, ""], Bool[Array, ""]]:
    """Whether the target is lit, whether its phase angle is small enough, and whether the Sun is far enough away.

    `r_TN_N` is the target's position and `r_ST_N` the servicer from the target [m]; `phase_limit` is the largest phase
    angle, `sun_exclusion` the least angle between the line of sight and the Sun [rad].
    """
    cos_phase = jnp.sum(normalize(r_ST_N) * normalize(r_sun_N), axis=0)
    return is_lit(r_TN_N, r_sun_N), cos_phase >= cos_sin(phase_limit)[0], -cos_phase <= cos_sin(sun_exclusion)[0]
