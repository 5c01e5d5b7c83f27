"""When a camera can see its target: lighting, phase angle and angle to the Sun."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from rpojax.core.orbits import camera_visibility

SUN = np.array([1.496e11, 0.0, 0.0])

is_observable = jax.jit(camera_visibility.is_observable)

DAY, NIGHT = np.array([7.0e6, 0.0, 0.0]), np.array([-7.0e6, 0.0, 0.0])


def observable(r_TN_N: np.ndarray, r_ST_N: np.ndarray, phase_limit: float, sun_exclusion: float) -> bool:
    return bool(is_observable(r_TN_N, r_ST_N, SUN, jnp.deg2rad(phase_limit), jnp.deg2rad(sun_exclusion)))


@pytest.mark.parametrize(
    ("r_TN_N", "phase_deg", "seen"),
    [(DAY, 90.0, True), (DAY, 0.0, True), (DAY, 149.0, True), (DAY, 151.0, False), (NIGHT, 90.0, False)],
    ids=["from the side", "Sun behind the camera", "thick enough a crescent", "too thin a crescent", "eclipse"],
)
def test_a_target_is_observable_where_it_is_lit_and_the_phase_angle_is_small(
    r_TN_N: np.ndarray, phase_deg: float, seen: bool
) -> None:
    phase = np.deg2rad(phase_deg)
    r_ST_N = 40.0 * np.array([np.cos(phase), 0.6 * np.sin(phase), 0.8 * np.sin(phase)])
    assert observable(r_TN_N, r_ST_N, 150.0, 20.0) is seen


@pytest.mark.parametrize(("off_sun_deg", "seen"), [(29.0, False), (31.0, True)])
def test_a_target_is_not_observable_near_the_sun(off_sun_deg: float, seen: bool) -> None:
    angle = np.deg2rad(off_sun_deg)
    r_ST_N = -40.0 * np.array([np.cos(angle), np.sin(angle), 0.0])
    assert observable(DAY, r_ST_N, 180.0, 30.0) is seen  # every phase will do, so that only the exclusion counts
