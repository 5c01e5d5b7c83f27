"""The Earth rotation angle against published values."""

import jax
import jax.numpy as jnp
import numpy as np

from rpojax.core.orbits import earth_rotation

earth_rotation_angle = jax.jit(earth_rotation.earth_rotation_angle)


def test_the_angle_at_the_epoch_j2000_is_280_degrees() -> None:
    np.testing.assert_allclose(np.rad2deg(earth_rotation_angle(jnp.float64(0.0))), 280.46061837504, rtol=1e-12)


def test_the_earth_turns_once_in_a_stellar_day() -> None:
    start, end = (float(earth_rotation_angle(jnp.float64(seconds))) for seconds in (1e6, 1e6 + 86164.098903691))
    np.testing.assert_allclose(end, start, atol=1e-9)
