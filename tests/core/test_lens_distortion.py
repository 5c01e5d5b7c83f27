"""Lens distortion against OpenCV, its inverse, and derivatives."""

import cv2
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from rpojax.core import lens_distortion

LENSES = {
    "barrel": [-0.28, 0.09, 4e-4, -3e-4, -0.012],
    "pincushion": [0.12, 0.03, -6e-4, 5e-4, 0.0],
    "pinhole": [0.0] * 5,
}


@pytest.mark.parametrize("name", LENSES)
def test_places_are_those_of_opencv(name: str) -> None:
    rng = np.random.default_rng(0)
    coefficients, focal = np.array(LENSES[name]), 1400.0
    points = np.stack([*rng.uniform(-0.45, 0.45, (2, 500)), np.ones(500)], axis=1) * rng.uniform(2.0, 60.0, (500, 1))
    matrix = np.array([[focal, 0.0, 384.0], [0.0, focal, 384.0], [0.0, 0.0, 1.0]])
    expected = cv2.projectPoints(points, np.zeros(3), np.zeros(3), matrix, coefficients)[0][:, 0]
    tangents = jnp.asarray((points[:, :2] / points[:, 2:]).T)
    found = 384.0 + focal * np.asarray(lens_distortion.distort(jnp.asarray(coefficients), *tangents)).T
    np.testing.assert_allclose(found, expected, atol=1e-9)


@pytest.mark.parametrize("name", LENSES)
@pytest.mark.parametrize("dtype", [jnp.float32, jnp.float64])
def test_correction_is_the_inverse(name: str, dtype: type) -> None:
    coefficients = jnp.asarray(LENSES[name], dtype)
    tangents = jnp.asarray(np.random.default_rng(1).uniform(-0.42, 0.42, (2, 400)), dtype)
    found = lens_distortion.undistort(coefficients, *lens_distortion.distort(coefficients, *tangents))
    # Of a lens of 1400 px in single precision: a thousandth of a pixel.
    np.testing.assert_allclose(found, tangents, atol=6e-7 if dtype == jnp.float32 else 1e-13)


def test_correction_has_the_derivative_of_the_inverse() -> None:
    coefficients, place = jnp.asarray(LENSES["barrel"]), jnp.array([0.3, -0.2])
    shown = jnp.stack(lens_distortion.distort(coefficients, *place))
    forward = jax.jacobian(lambda at: jnp.stack(lens_distortion.distort(coefficients, *at)))(place)
    back = jax.jacobian(lambda at: jnp.stack(lens_distortion.undistort(coefficients, *at)))(shown)
    np.testing.assert_allclose(back @ forward, np.eye(2), atol=1e-9)


@pytest.mark.parametrize("name", ["barrel", "pincushion"])
def test_what_is_outside_of_the_frame_stays_there(name: str) -> None:
    coefficients = jnp.asarray([-0.3 if name == "barrel" else 0.12, 0.0, 0.0, 0.0, 0.0])
    far = jnp.asarray(np.stack([np.linspace(0.3, 40.0, 400), np.zeros(400)]))
    shown = np.asarray(lens_distortion.distort(coefficients, *far))[0]
    assert (np.diff(shown) > 0.0).all()
    found = lens_distortion.undistort(coefficients, *jnp.asarray(np.stack([shown, 0.0 * shown])))
    np.testing.assert_allclose(found[0], far[0], rtol=1e-5)
