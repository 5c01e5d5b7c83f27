"""Orbit and free relative motion of a scenario before it is simulated, by the functions of the simulation."""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from rpojax.core.orbits import clohessy_wiltshire, keplerian_elements
from rpojax.core.orbits.yamanaka_ankersen import TargetOrbit, advanced
from rpojax.core.pytree import replace
from rpojax.scenario.schema import ScenarioFile


def mean_motion(file: ScenarioFile) -> float:
    """Mean motion [rad/s] of the nominal orbit."""
    return float(keplerian_elements.mean_motion(jnp.float64(file.orbit.semi_major_axis_m)))


def orbit_from(file: ScenarioFile, latitude: float) -> TargetOrbit:
    """Place on the nominal orbit at an argument of latitude [rad]."""
    e, perigee = file.orbit.eccentricity, np.radians(file.orbit.argument_of_perigee_deg)
    return TargetOrbit(
        argument_of_latitude=jnp.float64(latitude),
        ex=jnp.float64(e * np.cos(perigee)),
        ey=jnp.float64(e * np.sin(perigee)),
        semi_major_axis=jnp.float64(file.orbit.semi_major_axis_m),
    )


def transition_matrices(n: float, times: np.ndarray) -> np.ndarray:
    """(t, 6, 6) transition matrices of (rho, rho_dot) in H over `times` (t,) [s] on a circular orbit."""
    return np.asarray(_circular_motions(n, times))


def latitudes_after(file: ScenarioFile, start: float, times: np.ndarray) -> np.ndarray:
    """Arguments of latitude (t,) [rad] at `times` (t,) [s] after that at the `start`; they count whole turns on."""
    return np.asarray(_later(orbit_from(file, start), times).argument_of_latitude)


def at_latitudes(orbit: TargetOrbit, latitudes: Float[Array, " p"]) -> TargetOrbit:
    """Places (p,) on an orbit at arguments of latitude [rad]."""
    return jax.vmap(lambda latitude: replace(orbit, argument_of_latitude=latitude))(latitudes)


_circular_motions = jax.jit(jax.vmap(clohessy_wiltshire.transition_matrix, in_axes=(None, 0)))
_later = jax.jit(jax.vmap(advanced, in_axes=(None, 0)))
