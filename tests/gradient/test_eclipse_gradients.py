"""Derivatives of the Sun's visible fraction in both modes against finite differences, also at its borders."""

import jax
import pytest
from gradient_checks import check, check_finite
from penumbra_geometry import SUN_N, behind, touching

from rpojax.core.orbits import eclipse


@jax.jit
def illumination(x: jax.Array, r_N: jax.Array) -> jax.Array:
    """Illumination near `r_N`; 1 in each coordinate is the width of the penumbra in low orbit."""
    return eclipse.illumination(
        r_N + 3e4 * x[:3], SUN_N * (1.0 + 0.01 * x[3]), 6378137.0 + 3e4 * x[4], 7e8 + 1e7 * x[5]
    )


@pytest.mark.parametrize(
    "way",
    [-0.1, 0.05, 0.3, 0.5, 0.8, 0.95, 1.1],
    ids=["umbra", "just inside", "a third", "half", "most of it", "almost outside", "light"],
)
@pytest.mark.parametrize("distance", [7.0e6, 4.2e7], ids=["low orbit", "geostationary"])
def test_derivatives_of_illumination_are_right_in_and_beside_the_penumbra(distance: float, way: float) -> None:
    inner, outer = touching(distance, True), touching(distance, False)
    check(illumination, 6, behind(distance, inner + way * (outer - inner)))


@pytest.mark.parametrize("off_axis", [1e-3, 4e-3, 7e-3], ids=["ring", "partial", "light"])
def test_derivatives_of_illumination_are_right_beyond_the_end_of_the_umbra(off_axis: float) -> None:
    check(illumination, 6, behind(3e9, off_axis))


@pytest.mark.parametrize("inner", [True, False], ids=["inner border", "outer border"])
@pytest.mark.parametrize("distance", [7.0e6, 3e9], ids=["low orbit", "beyond the umbra"])
def test_illumination_has_finite_derivatives_on_the_borders_of_the_penumbra(distance: float, inner: bool) -> None:
    edge = touching(distance, inner)
    for off in (0.0, 1e-15, -1e-15, 1e-12, -1e-12):
        check_finite(illumination, 6, behind(distance, edge + off))


@pytest.mark.parametrize("distance", [7.0e6, 1.3e9, 3e9], ids=["umbra", "its far end", "ring"])
@pytest.mark.parametrize("side", [1.0, -1.0], ids=["night", "day"])
def test_illumination_has_finite_derivatives_on_the_axis_of_the_shadow(distance: float, side: float) -> None:
    check_finite(illumination, 6, side * behind(distance, 0.0))
