"""The Earth's shadow: how much of the Sun is visible from a position."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from rpojax.core.constants import RADIUS_EARTH, RADIUS_SUN
from rpojax.core.numerics import gradient_safe
from rpojax.core.numerics.trigonometric_series import arctan2

Vector = Float[Array, "3"]
Scalar = Float[Array, ""]


def illumination(
    r_N: Vector, r_sun_N: Vector, radius: float | Scalar = RADIUS_EARTH, radius_sun: float | Scalar = RADIUS_SUN
) -> Scalar:
    """Visible fraction of the Sun's disc [-] at an inertial position [m].

    0 in the umbra, 1 in sunlight; in the penumbra from the overlap of the apparent discs (Montenbruck and Gill,
    Satellite Orbits, section 3.4.2). The value and its gradient are continuous.
    """
    sun_sine, earth_sine, cosine = _disc_geometry(r_N, r_sun_N, radius, radius_sun)
    # jnp.arctan2, not the series: half of the result's digits depend on its last ones (see `_lens_as_published`).
    sun_angle = jnp.arctan2(sun_sine, _complementary_sine(sun_sine))
    earth_angle = jnp.arctan2(earth_sine, _complementary_sine(earth_sine))
    separation = jnp.arctan2(_complementary_sine(cosine), cosine)
    return 1.0 - _disc_overlap_area(sun_angle, earth_angle, separation) / (jnp.pi * sun_angle * sun_angle)


def _disc_geometry(
    r_N: Vector, r_sun_N: Vector, radius: float | Scalar, radius_sun: float | Scalar
) -> tuple[Scalar, Scalar, Scalar]:
    """Sines of the apparent radii of Sun and Earth, and the cosine of the angle between their centres."""
    to_sun = r_sun_N - r_N
    sun_distance, distance = jnp.sqrt(jnp.sum(to_sun * to_sun, axis=0)), jnp.sqrt(jnp.sum(r_N * r_N, axis=0))
    cosine = -jnp.sum(r_N * to_sun, axis=0) / (distance * sun_distance)
    return radius_sun / sun_distance, jnp.minimum(radius / distance, 1.0), cosine


def _complementary_sine(sine: Scalar) -> Scalar:
    """Cosine of an angle from its sine, or sine from cosine, where the result is not negative."""
    return gradient_safe.sqrt((1.0 - sine) * (1.0 + sine))


def _arc_cosine(cosine: Scalar) -> Scalar:
    return arctan2(_complementary_sine(cosine), cosine)


@jax.custom_jvp
def _disc_overlap_area(a: Scalar, b: Scalar, c: Scalar) -> Scalar:
    """Common area of two discs with radii `a`, `b` and centres `c` apart."""
    crossing = (c < a + b) & (c > jnp.abs(a - b))
    least = jnp.minimum(a, b)
    whole = jnp.pi * least * least
    lens = _lens_from_chord(a, b, c) if a.dtype == jnp.float32 else _lens_as_published(a, b, c, crossing)
    return jnp.where(crossing, jnp.clip(lens, 0.0, whole), jnp.where(c >= a + b, 0.0, whole))


def _lens_as_published(a: Scalar, b: Scalar, c: Scalar, crossing: Bool[Array, ""]) -> Scalar:
    # The published formula with arc cosines, which lose half of their digits next to 1: the visible fraction is good
    # to 5e-9 (3e-7 at the borders of the penumbra). Other simulators use the same operations in the same order, so that
    # values agree to 1e-13.
    x = (c * c + a * a - b * b) / (2.0 * jnp.where(crossing, c, 1.0))
    angle_a, angle_b = _arc_cosine(jnp.clip(x / a, -1.0, 1.0)), _arc_cosine(jnp.clip((c - x) / b, -1.0, 1.0))
    return a * a * angle_a + b * b * angle_b - c * gradient_safe.sqrt(a * a - x * x)


def _lens_from_chord(a: Scalar, b: Scalar, c: Scalar) -> Scalar:
    """Area of the lens without arc cosines, for single precision."""
    half_chord, angle_a, angle_b = _common_chord(a, b, c)
    return a * a * angle_a + b * b * angle_b - c * half_chord


@_disc_overlap_area.defjvp
def _overlap_jvp(primals: tuple[Array, ...], tangents: tuple[Array, ...]) -> tuple[Array, Array]:
    """Derivative to each radius: that disc's arc inside the other; to the distance: minus the common chord."""
    a, b, c = primals
    half_chord, angle_a, angle_b = _common_chord(a, b, c)
    inside = c <= jnp.abs(a - b)
    slope_a = 2.0 * a * jnp.where(inside, jnp.where(a <= b, jnp.pi, 0.0), angle_a)
    slope_b = 2.0 * b * jnp.where(inside, jnp.where(a <= b, 0.0, jnp.pi), angle_b)
    slope = slope_a * tangents[0] + slope_b * tangents[1] - 2.0 * half_chord * tangents[2]
    return _disc_overlap_area(a, b, c), slope


def _common_chord(a: Scalar, b: Scalar, c: Scalar) -> tuple[Scalar, Scalar, Scalar]:
    """Half the common chord of two circles and the half angles it subtends at their centres; 0 if they do not cross."""
    crossing = (c < a + b) & (c > jnp.abs(a - b))
    x = (c * c + (a - b) * (a + b)) / (2.0 * jnp.where(crossing, c, 1.0))
    half_chord = jnp.where(crossing, gradient_safe.sqrt((a - x) * (a + x)), 0.0)
    # From sine and cosine: an arc cosine loses the derivative near the borders of the penumbra.
    angle_a, angle_b = arctan2(half_chord, x), arctan2(half_chord, c - x)
    return half_chord, jnp.where(crossing, angle_a, 0.0), jnp.where(crossing, angle_b, 0.0)


def is_lit(r_N: Vector, r_sun_N: Vector) -> Bool[Array, ""]:
    """True while more than half of the Sun's disc is visible.

    Because the limb is curved, half of the Sun is covered when its centre is `sun^2 / (6 earth)` inside of the Earth's
    disc, in terms of the apparent radii: to 1e-9 rad up to geostationary orbit, to 1e-6 rad up to the Moon's. Not valid
    where the apparent disc of the Earth is smaller than that of the Sun.
    """
    sun_sine, earth_sine, cosine = _disc_geometry(r_N, r_sun_N, RADIUS_EARTH, RADIUS_SUN)
    earth_cosine = _complementary_sine(earth_sine)
    half_covered_angle = sun_sine * sun_sine / (6.0 * arctan2(earth_sine, earth_cosine))
    return cosine < earth_cosine + earth_sine * half_covered_angle
