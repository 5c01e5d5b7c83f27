"""A state of an orbit in the scenario's inertial frame, its Keplerian elements, and its state from another orbit."""

import math
from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np

from rpojax.core.constants import MU_EARTH
from rpojax.core.frames import Vector, hill_frame, inertial_to_hill
from rpojax.errors import ScenarioError
from rpojax.time_scales import Instant

_LEAST_RADIUS_M, _LARGEST_RADIUS_M = 1e6, 1e9
_NO_DIRECTION = 1e-14
"""Length of the eccentricity vector, or of the normal's part in the equator, below which it has no direction.

A position is right to some 1e-7 m without it.
"""


@dataclass(frozen=True)
class OrbitState:
    """State of an object at a time, and where it was read.

    Attributes:
        epoch: when
        position_m: (3,) in N
        velocity_m_s: (3,) in N
        kind: `OEM`, `OMM`, `OPM` or `TLE`
        frame: of the message
        name: of the object in the message
        interpolation_error_m: estimate of its position's error where it was interpolated
    """

    epoch: Instant
    position_m: np.ndarray
    velocity_m_s: np.ndarray
    kind: str
    frame: str
    name: str
    interpolation_error_m: float | None = None


def check_bound(position_m: np.ndarray, velocity_m_s: np.ndarray, where: str) -> None:
    """Refuses a state (3,), (3,) of no orbit about the Earth, as one in other units; `where` stands first in errors.

    Raises:
        ScenarioError: its distance is none of orbits about the Earth, it is at rest, or it escapes.
    """
    radius, speed = float(np.linalg.norm(position_m)), float(np.linalg.norm(velocity_m_s))
    if _LEAST_RADIUS_M <= radius <= _LARGEST_RADIUS_M and 0.0 < speed**2 < 2.0 * MU_EARTH / radius:
        return
    found = f"a state {radius / 1e3:.6g} km from the centre of the Earth at {speed / 1e3:.6g} km/s"
    raise ScenarioError(where, found, "one of an orbit about it, in km and km/s")


def orbit_section(state: OrbitState) -> dict[str, float]:
    """Section `orbit` of a scenario: osculating elements (Vallado, algorithm 9).

    A circular orbit has its perigee at the node, an equatorial one its node at the x axis.
    """
    r, v = state.position_m, state.velocity_m_s
    radius, momentum = float(np.linalg.norm(r)), np.cross(r, v)
    eccentricity = np.cross(v, momentum) / MU_EARTH - r / radius
    normal = momentum / np.linalg.norm(momentum)
    node = np.array([-normal[1], normal[0], 0.0])
    node = node / np.linalg.norm(node) if np.linalg.norm(node) > _NO_DIRECTION else np.array([1.0, 0.0, 0.0])
    perigee = eccentricity if np.linalg.norm(eccentricity) > _NO_DIRECTION else node
    return {
        "semi_major_axis_m": 1.0 / (2.0 / radius - float(v @ v) / MU_EARTH),
        "eccentricity": float(np.linalg.norm(eccentricity)),
        "inclination_deg": math.degrees(math.atan2(math.hypot(normal[0], normal[1]), normal[2])),
        "raan_deg": math.degrees(math.atan2(node[1], node[0])),
        "argument_of_perigee_deg": math.degrees(_angle(node, perigee, normal)),
        "true_anomaly_deg": math.degrees(_angle(perigee, r, normal)),
    }


def _angle(first: np.ndarray, second: np.ndarray, normal: np.ndarray) -> float:
    """Angle [rad] from one vector to another about the normal of their plane."""
    return math.atan2(float(second @ np.cross(normal, first)), float(second @ first))


def relative_state(servicer: OrbitState, target: OrbitState) -> tuple[list[float], list[float]]:
    """Position [m] and velocity [m/s] of the servicer from the target, as seen in the target's Hill frame."""
    target_N, servicer_N = (
        (jnp.asarray(each.position_m), jnp.asarray(each.velocity_m_s)) for each in (target, servicer)
    )
    rho, rho_dot = _in_hill_frame(target_N, servicer_N)
    return rho.tolist(), rho_dot.tolist()


@jax.jit
def _in_hill_frame(target_N: tuple[Vector, Vector], servicer_N: tuple[Vector, Vector]) -> tuple[Vector, Vector]:
    """Relative position [m] and velocity [m/s] in H, of the states of both in N."""
    R_HN, omega_HN_N = hill_frame(*target_N)
    return inertial_to_hill(servicer_N[0] - target_N[0], servicer_N[1] - target_N[1], R_HN, omega_HN_N)
