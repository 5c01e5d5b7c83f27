"""Target orbits and entries for tests of reference trajectories."""

from functools import lru_cache

import jax
import jax.numpy as jnp
import numpy as np
from numpy_reference import MU
from scipy.integrate import solve_ivp

from rpojax.core.orbits import yamanaka_ankersen
from rpojax.core.orbits.yamanaka_ankersen import TargetOrbit
from rpojax.flight.guidance.references.phase_entry import PhaseEntry

ECCENTRICITIES = [0.0, 0.1, 0.7]
PERIGEE, PERIGEE_ANGLE = 6.9e6, 0.8

advanced = jax.jit(yamanaka_ankersen.advanced)
target_orbit = jax.jit(yamanaka_ankersen.target_orbit)


@lru_cache
def orbit(e: float, argument_of_latitude: float = 1.7) -> TargetOrbit:
    """Orbit with its perigee at 6900 km, 0.8 rad from the node."""
    return TargetOrbit(
        argument_of_latitude=jnp.asarray(argument_of_latitude),
        ex=jnp.asarray(e * np.cos(PERIGEE_ANGLE)),
        ey=jnp.asarray(e * np.sin(PERIGEE_ANGLE)),
        semi_major_axis=jnp.asarray(PERIGEE / (1.0 - e)),
    )


def period(e: float) -> float:
    """Period [s] of the orbit."""
    return float(2.0 * np.pi * np.sqrt((PERIGEE / (1.0 - e)) ** 3 / MU))


def entry(*relative_state: float, e: float = 0.3) -> PhaseEntry:
    """Entry at a relative state (6,) on the orbit of an eccentricity."""
    return PhaseEntry(relative_state=jnp.array(relative_state), orbit=orbit(e))


def integrated_free_motion(e: float, at: TargetOrbit, state: np.ndarray, seconds: float) -> np.ndarray:
    """Relative state (6,) in H after a time, by integrating the linear equations of relative motion (Tschauner)."""
    p = PERIGEE * (1.0 + e)
    h = np.sqrt(MU * p)

    def rates(_: float, now: np.ndarray) -> np.ndarray:
        x, y, z, u, v, w, nu = now
        r = p / (1.0 + e * np.cos(nu))
        rate, gravity = h / r**2, MU / r**3
        change = -2.0 * rate * (MU / h) * e * np.sin(nu) / r
        radial = (rate**2 + 2.0 * gravity) * x + change * y + 2.0 * rate * v
        along = (rate**2 - gravity) * y - change * x - 2.0 * rate * u
        return np.array([u, v, w, radial, along, -gravity * z, rate])

    start = [*state, float(at.argument_of_latitude) - PERIGEE_ANGLE]
    return solve_ivp(rates, (0.0, seconds), start, method="DOP853", rtol=1e-12, atol=1e-12).y[:6, -1]
