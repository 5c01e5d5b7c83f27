"""Frame of a target that turns: kinematics against finite differences of its own motion."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from rpojax.core.frames import hill_frame
from rpojax.core.orbits import yamanaka_ankersen
from rpojax.flight.guidance import target_frame
from rpojax.flight.guidance.target_frame import TargetFrame

POSITION, VELOCITY = jnp.array([7e6, 0.0, 0.0]), jnp.array([0.0, 5000.0, 5700.0])
INERTIA = jnp.diag(jnp.array([4.0, 2.4, 4.4]))
OFFSET = jnp.array([0.01, -0.02, 0.03])
RATE = jnp.deg2rad(jnp.array([0.8, -0.5, 0.4]))
of_target, ahead = jax.jit(target_frame.of_target), jax.jit(target_frame.ahead, static_argnums=3)


@pytest.fixture(scope="module")
def frame() -> TargetFrame:
    q_TN = jnp.array([0.5, 0.1, -0.7, 0.5])
    return of_target(q_TN / jnp.linalg.norm(q_TN), RATE, INERTIA, OFFSET, *hill_frame(POSITION, VELOCITY))


def after(frame: TargetFrame, seconds: float) -> TargetFrame:
    """The frame in so many short steps, while the Hill frame turns."""
    orbit, steps = yamanaka_ankersen.target_orbit(POSITION, VELOCITY), 10
    for _ in range(steps):
        later = yamanaka_ankersen.advanced(orbit, jnp.asarray(seconds / steps))
        frame, orbit = ahead(frame, orbit, later, seconds / steps), later
    return frame


def test_to_the_hill_frame_and_back(frame: TargetFrame) -> None:
    state = jnp.array([1.0, -2.0, 8.0, 0.01, 0.02, -0.03])
    found = target_frame.from_hill(frame, target_frame.to_hill(frame, state))
    np.testing.assert_allclose(found, state, atol=1e-12)
    np.testing.assert_allclose(frame.R_TH @ frame.R_TH.T, np.eye(3), atol=1e-12)


def test_a_place_that_rests_in_it_moves_in_the_hill_frame(frame: TargetFrame) -> None:
    resting = jnp.array([0.0, 0.0, 8.0, 0.0, 0.0, 0.0])
    step = 0.01
    change = target_frame.to_hill(after(frame, step), resting) - target_frame.to_hill(frame, resting)
    middle = target_frame.to_hill(after(frame, 0.5 * step), resting)
    np.testing.assert_allclose(change[:3] / step, middle[3:], atol=1e-8)
    # Speed of a turn about the centre of mass, the offset included.
    across = np.cross(RATE - frame.orbit_rate * frame.R_TH[:, 2], np.array([0.0, 0.0, 8.0]) + OFFSET)
    np.testing.assert_allclose(
        np.linalg.norm(target_frame.to_hill(frame, resting)[3:]), np.linalg.norm(across), rtol=1e-12
    )


def test_a_step_ahead_is_that_of_many_short_ones(frame: TargetFrame) -> None:
    orbit = yamanaka_ankersen.target_orbit(POSITION, VELOCITY)
    found = ahead(frame, orbit, yamanaka_ankersen.advanced(orbit, jnp.asarray(1.0)), 1.0)
    expected = after(frame, 1.0)
    np.testing.assert_allclose(found.R_TH, expected.R_TH, atol=1e-7)
    np.testing.assert_allclose(found.omega_TN_T, expected.omega_TN_T, atol=1e-8)


def test_a_fast_target_cannot_be_followed(frame: TargetFrame) -> None:
    needed = float(RATE @ RATE) * 8.0 * 30.0
    for authority, expected in ((2.1 * needed, True), (1.9 * needed, False)):
        found = target_frame.can_be_followed(frame, *map(jnp.asarray, (authority, 30.0, 8.0)))
        assert bool(found) is expected
