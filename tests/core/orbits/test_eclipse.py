"""The Earth's shadow against areas by quadrature, and its borders."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy_reference import RADIUS
from scipy.integrate import quad
from scipy.optimize import brentq

from rpojax.core.orbits import eclipse
from rpojax.simulation import single_precision

SUN_DISTANCE, SUN_RADIUS = 1.496e11, 6.957e8
SUN = np.array([SUN_DISTANCE, 0.0, 0.0])
ORBITS = {"low orbit": 7.0e6, "geostationary": 4.2164e7, "the Moon's distance": 3.84e8, "beyond the umbra": 2.0e9}

illumination = jax.jit(eclipse.illumination)
gradient = jax.jit(jax.grad(eclipse.illumination))
is_lit = jax.jit(eclipse.is_lit)


def place(distance: float, angle: float) -> np.ndarray:
    """Position at an angle [rad] off the axis of the shadow, behind the Earth."""
    return distance * np.array([-np.cos(angle), np.sin(angle), 0.0])


def discs(r: np.ndarray) -> tuple[float, float, float]:
    """Apparent radii of Sun and Earth and the angle between their centres [rad]."""
    to_sun = SUN - r
    across = np.linalg.norm(np.cross(to_sun, -r))
    sun, earth = np.arcsin(SUN_RADIUS / np.linalg.norm(to_sun)), np.arcsin(RADIUS / np.linalg.norm(r))
    return sun, earth, np.arctan2(across, -to_sun @ r)


def border(distance: float, inner: bool) -> float:
    """Angle [rad] off the axis at which the discs touch, from outside or from inside."""

    def gap(angle: float) -> float:
        sun, earth, separation = discs(place(distance, angle))
        return separation - (abs(earth - sun) if inner else earth + sun)

    return brentq(gap, 0.0, np.pi / 2, xtol=1e-15)


def visible_fraction(r: np.ndarray) -> float:
    """Visible fraction of the Sun's disc, by quadrature over rings, each with its arc outside of the Earth's disc."""
    a, b, c = discs(r)
    touch = abs(c - b) / a
    if touch >= 1.0:
        return 1.0 if c > b else 0.0
    full_rings = touch**2 if c < b else 0.0

    def ring(s: float) -> float:
        radius = touch + (1.0 - touch) * s * s  # the arc grows with the square root of the distance from the first ring
        cosine = (radius * radius * a + (c - b) * (c + b) / a) / (2.0 * radius * c)
        arc = 2.0 * np.arccos(np.clip(cosine, -1.0, 1.0))
        return arc * radius * 2.0 * (1.0 - touch) * s

    return 1.0 - full_rings - quad(ring, 0.0, 1.0, epsabs=1e-13, epsrel=1e-13)[0] / np.pi


@pytest.mark.parametrize(
    ("position", "share"),
    [
        ([7.0e6, 0.0, 0.0], 1.0),
        ([0.0, 7.0e6, 0.0], 1.0),
        ([-1.0, 0.0, -7.0e6], 1.0),
        ([-7.0e6, 0.0, 0.0], 0.0),
        ([-4.0e6, 0.0, RADIUS - 40.0e3], 0.0),
        ([-4.0e6, 0.0, RADIUS + 40.0e3], 1.0),
        ([-1.3e9, 0.0, 0.0], 0.0),
    ],
    ids=["noon", "terminator", "just past it", "midnight", "in the umbra", "off the penumbra", "the umbra's far end"],
)
def test_illumination_is_exactly_0_in_the_umbra_and_exactly_1_outside_of_the_shadow(
    position: list[float], share: float
) -> None:
    assert float(illumination(np.array(position), SUN)) == share
    assert bool(is_lit(np.array(position), SUN)) is (share > 0.5)


@pytest.mark.parametrize("distance", ORBITS.values(), ids=ORBITS)
def test_illumination_in_the_penumbra_is_the_visible_fraction_of_the_suns_disc(distance: float) -> None:
    inner, outer = border(distance, inner=True), border(distance, inner=False)
    for way in (1e-6, 1e-3, 0.02, 0.3, 0.5, 0.7, 0.98, 1.0 - 1e-3, 1.0 - 1e-6):
        r = place(distance, inner + way * (outer - inner))
        # Arc cosines next to 1 have half of the digits; the error grows with (Earth's disc / Sun's disc)^2.
        rounding = 5e-9 if 1e-4 < way < 1.0 - 1e-4 else 3e-7
        np.testing.assert_allclose(illumination(r, SUN), visible_fraction(r), atol=rounding)
        assert 0.0 <= illumination(r, SUN) <= 1.0


def test_illumination_is_symmetric_about_the_suns_direction() -> None:
    r = place(7.0e6, 0.5 * (border(7.0e6, inner=True) + border(7.0e6, inner=False)))
    expected = float(illumination(r, SUN))
    assert 0.1 < expected < 0.9
    for angle in (1.0, 2.5, 4.0):
        turned = np.array([r[0], np.cos(angle) * r[1], np.sin(angle) * r[1]])
        np.testing.assert_allclose(illumination(turned, SUN), expected, atol=1e-10)


def test_beyond_the_umbra_a_ring_of_the_sun_remains_visible() -> None:
    sun, earth, _ = discs(place(2.0e9, 0.0))
    assert earth < sun
    for angle in (0.0, 1e-9, 1e-4):  # the Earth's disc moves over the Sun's, and covers the same area
        np.testing.assert_allclose(illumination(place(2.0e9, angle), SUN), 1.0 - (earth / sun) ** 2, atol=1e-6)
    np.testing.assert_allclose(illumination(place(2.0e9, 0.0), SUN), 1.0 - (earth / sun) ** 2, atol=1e-12)


@pytest.mark.parametrize("inner", [True, False], ids=["inner border", "outer border"])
@pytest.mark.parametrize("distance", ORBITS.values(), ids=ORBITS)
def test_illumination_and_its_gradient_are_continuous_across_the_borders_of_the_penumbra(
    distance: float, inner: bool
) -> None:
    edges = border(distance, inner=True), border(distance, inner=False)
    width = edges[1] - edges[0]
    edge, inwards = (edges[0], width) if inner else (edges[1], -width)
    outside = float(illumination(place(distance, edge - 1e-6 * inwards), SUN))
    tangent = np.array([np.sin(edge), np.cos(edge), 0.0])

    def steepness(way: float) -> float:
        """Derivative along the circle over its mean in the penumbra, at a fraction of the penumbra's width."""
        slope = np.asarray(gradient(place(distance, edge + way * inwards), SUN))
        return float(slope @ tangent) * distance * width

    steps = np.array([1e-3, 1e-5, 1e-7])
    jumps = [float(illumination(place(distance, edge + way * inwards), SUN)) - outside for way in (1e-3, 1e-4)]
    background = steepness(-1e-6)  # where a ring is visible the value varies slightly with distance
    slopes = np.array([steepness(way) for way in steps]) - background
    # Near a border the value grows with the power 3/2 of the distance from it, the derivative with the power 1/2.
    np.testing.assert_allclose(np.abs(jumps[0] / jumps[1]), 10.0**1.5, rtol=0.02)
    np.testing.assert_allclose(slopes[:-1] / slopes[1:], 10.0, rtol=0.02)
    assert 0.01 < slopes[0] < 0.1
    assert np.all(np.isfinite(gradient(place(distance, edge), SUN)))


@pytest.mark.parametrize("angle", [0.0, 0.5, 2.0, np.pi], ids=["midnight", "umbra", "day", "noon"])
def test_the_gradient_of_illumination_is_zero_in_the_umbra_and_outside_of_the_shadow(angle: float) -> None:
    # In the penumbra it is a few 1e-5 per metre; outside only rounding remains.
    np.testing.assert_allclose(gradient(place(7.0e6, angle), SUN), np.zeros(3), atol=1e-24)


@pytest.mark.parametrize(("distance", "tolerance"), [(7.0e6, 1e-10), (4.2164e7, 1e-9), (3.84e8, 1e-6)])
def test_a_position_is_lit_if_more_than_half_of_the_disc_is_visible(distance: float, tolerance: float) -> None:
    inner, outer = border(distance, inner=True), border(distance, inner=False)
    half = brentq(lambda angle: visible_fraction(place(distance, angle)) - 0.5, inner, outer, xtol=1e-14)
    assert not bool(is_lit(place(distance, half - tolerance), SUN))
    assert bool(is_lit(place(distance, half + tolerance), SUN))


def test_illumination_in_single_precision_is_accurate_to_1e_minus_4() -> None:
    angles = np.arcsin(6378137.0 / 7.0e6) + np.linspace(-0.008, 0.008, 401)
    places = 7.0e6 * np.stack([-np.cos(angles), np.sin(angles), np.zeros_like(angles)], axis=1)
    shares = jax.jit(jax.vmap(lambda r_N: eclipse.illumination(r_N, jnp.asarray(SUN, r_N.dtype))))
    double = np.asarray(shares(jnp.asarray(places)))
    with single_precision.tracing_in_single():
        found = np.asarray(shares(jnp.asarray(places, jnp.float32)))
    assert found.dtype == np.float32
    assert ((double > 0.01) & (double < 0.99)).sum() > 50
    np.testing.assert_allclose(found, double, atol=1e-4)


def test_discs_that_cover_each_other_exactly_still_do_so_where_both_grow() -> None:
    # Both have the sine of 1/2: radii 1 and 2 at distances 2 and 4.
    r, sun = jnp.array([-2.0, 0.0, 0.0]), jnp.array([2.0, 0.0, 0.0])

    def visible(growth: jax.Array) -> jax.Array:
        return eclipse.illumination(r, sun, growth, 2.0 * growth)

    value, slope = jax.jvp(visible, (jnp.asarray(1.0),), (jnp.asarray(1.0),))
    np.testing.assert_allclose([value, slope], [0.0, 0.0], atol=1e-15)
