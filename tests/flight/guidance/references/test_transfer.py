"""Transfers against integrated free motion."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from relative_motion_cases import ECCENTRICITIES, advanced, entry, integrated_free_motion, orbit

from rpojax.core.pytree import replace
from rpojax.flight.guidance.references import transfer
from rpojax.flight.guidance.references.transfer import Transfer

state = jax.jit(transfer.state)
START, END = np.array([40.0, -2000.0, 30.0]), np.array([0.0, -100.0, -5.0])
DURATION = 2000.0


def reference(pulses: float, speed_ratio: float = 0.1) -> Transfer:
    return Transfer(
        position=jnp.asarray(END),
        duration=jnp.asarray(DURATION),
        pulses=jnp.asarray(pulses),
        speed_ratio=jnp.asarray(speed_ratio),
    )


def at(e: float, followed: Transfer, elapsed: float) -> np.ndarray:
    seconds = jnp.asarray(elapsed)
    return np.asarray(state(followed, entry(*START, 0.3, 0.1, -0.2, e=e), advanced(orbit(e), seconds), seconds))


@pytest.mark.parametrize("e", ECCENTRICITIES)
@pytest.mark.parametrize("pulses", [2.0, 5.0])
def test_between_impulses_the_motion_is_free_and_leads_to_the_next(e: float, pulses: float) -> None:
    followed = reference(pulses)
    interval = DURATION / (pulses - 1.0)
    for arc in range(int(pulses) - 1):
        # A tenth of a second off the impulses, at which the velocity jumps.
        begin, end = arc * interval + 0.1, (arc + 1) * interval - 0.1
        place = advanced(orbit(e), jnp.asarray(begin))
        expected = integrated_free_motion(e, place, at(e, followed, begin), end - begin)
        np.testing.assert_allclose(at(e, followed, end), expected, atol=1e-6 * np.linalg.norm(START - END))
    np.testing.assert_allclose(at(e, followed, 0.0)[:3], START, atol=1e-9)
    np.testing.assert_allclose(at(e, followed, np.nextafter(DURATION, 0.0))[:3], END, atol=1e-6)


def test_impulses_lie_on_the_straight_line_at_falling_speed() -> None:
    """Hablani: mean speeds of equal intervals form a geometric series, whose ends have the given ratio as limit."""
    followed = reference(41.0)
    points = np.stack([at(0.1, followed, k * DURATION / 40.0)[:3] for k in range(41)])
    lengths = np.linalg.norm(np.diff(points, axis=0), axis=1)
    np.testing.assert_allclose(np.sum(lengths), np.linalg.norm(START - END), rtol=1e-9)
    np.testing.assert_allclose(lengths[1:] / lengths[:-1], 0.1 ** (1.0 / 40.0), rtol=1e-7)


@pytest.mark.parametrize("speed_ratio", [1.0, 1.0 - 1e-7])
def test_a_glide_slope_of_constant_speed_has_equal_steps(speed_ratio: float) -> None:
    followed = reference(5.0, speed_ratio)
    for k in range(5):
        np.testing.assert_allclose(
            at(0.1, followed, k * DURATION / 4.0)[:3], START + (END - START) * k / 4.0, atol=2e-4
        )


@pytest.mark.parametrize("speed_ratio", [1.0, 1.0 - 1e-7])
def test_the_derivative_to_the_ratio_of_speeds_is_right_at_constant_speed(speed_ratio: float) -> None:
    """A quarter of the way: of expm1(r s) / expm1(r) the derivative to r is s (s - 1) / 2 at r = 0, and r = ln(1)."""

    even, start = reference(5.0), entry(*START, 0.0, 0.0, 0.0)

    def along(ratio: jax.Array, elapsed: float) -> jax.Array:
        return transfer.state(replace(even, speed_ratio=ratio), start, start.orbit, jnp.asarray(elapsed))[1]

    value_and_slope = jax.jit(jax.value_and_grad(along))
    found = value_and_slope(jnp.asarray(speed_ratio), DURATION / 4.0)[1]
    np.testing.assert_allclose(found, 0.25 * (-0.75) / 2.0 * (END - START)[1], rtol=1e-5)
    for elapsed in (300.0, 1100.0):
        above, below = (value_and_slope(jnp.asarray(speed_ratio + step), elapsed)[0] for step in (1e-3, -1e-3))
        found = value_and_slope(jnp.asarray(speed_ratio), elapsed)[1]
        np.testing.assert_allclose(found, (above - below) / 2e-3, rtol=1e-4)
