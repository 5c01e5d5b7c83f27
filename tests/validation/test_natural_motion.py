"""Free relative orbits of the flight software against trajectories of Basilisk."""

from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from experiments.validation.reference_file import Reference, read_reference
from rpojax.core.frames import hill_frame, inertial_to_hill
from rpojax.core.orbits import yamanaka_ankersen
from rpojax.core.orbits.yamanaka_ankersen import TargetOrbit
from rpojax.core.pytree import replace
from rpojax.flight.guidance.references import relative_orbit
from rpojax.flight.guidance.references.phase_entry import PhaseEntry
from rpojax.flight.guidance.references.relative_orbit import RelativeOrbit

FOLDER = Path(__file__).parent / "references"
RADIAL, CROSS_TRACK = 20.0, 30.0


@jax.jit
def target_and_constants(
    r: jax.Array, v: jax.Array, r_rel: jax.Array, v_rel: jax.Array
) -> tuple[TargetOrbit, jax.Array]:
    orbit = yamanaka_ankersen.target_orbit(r, v)
    state = jnp.concatenate(inertial_to_hill(r_rel, v_rel, *hill_frame(r, v)))
    return orbit, yamanaka_ankersen.constants_of_motion(orbit, state)


@jax.jit
def positions(reference: RelativeOrbit, orbit: TargetOrbit, times: jax.Array) -> jax.Array:
    entry = PhaseEntry(relative_state=jnp.zeros(6), orbit=orbit)

    def position(elapsed: jax.Array) -> jax.Array:
        return relative_orbit.state(reference, entry, yamanaka_ankersen.advanced(orbit, elapsed), elapsed)[:3]

    return jax.vmap(position)(times)


def start(file: Reference) -> tuple[TargetOrbit, np.ndarray]:
    target, chaser = ((file[f"r0_{name}"], file[f"v0_{name}"]) for name in ("target", "chaser"))
    r_rel, v_rel = chaser[0] - target[0], chaser[1] - target[1]
    orbit, constants = target_and_constants(*map(jnp.asarray, (*target, r_rel, v_rel)))
    return orbit, np.asarray(constants)


def relative_orbit_of(constants: np.ndarray) -> RelativeOrbit:
    """Relative orbit about a target on a nearly circular orbit."""
    along, ax, ay, drift, bx, by = constants
    values = {
        "radial": np.hypot(ax, ay),
        "radial_phase": np.arctan2(ay, ax),
        "cross_track": np.hypot(bx, by),
        "cross_track_phase": np.arctan2(by, bx),
        "along_track": along,
        "drift_per_orbit": 6.0 * np.pi * drift,
        "join": 0.0,
    }
    return RelativeOrbit(**{name: jnp.asarray(value) for name, value in values.items()})


@pytest.mark.parametrize(("case", "perigee"), [("low", np.deg2rad(20.0)), ("eccentric", -np.pi / 2)])
def test_a_safety_ellipse_is_that_of_two_orbits_in_basilisk(case: str, perigee: float) -> None:
    """Equal periods: no drift. The linear motion neglects squares of the separation, 100 m, over the radius: 2e-3 m."""
    file = read_reference(FOLDER / f"c_safety_ellipse_{case}.npz")
    orbit, constants = start(file)
    reference = replace(relative_orbit_of(constants), drift_per_orbit=jnp.asarray(0.0))
    np.testing.assert_allclose([reference.radial, reference.cross_track], [RADIAL, CROSS_TRACK], rtol=1e-4)
    np.testing.assert_allclose([reference.radial_phase, reference.cross_track_phase], perigee, atol=1e-4)
    found = np.asarray(positions(reference, orbit, jnp.asarray(file["t"])))
    np.testing.assert_allclose(found, file["rho"], atol=2e-3)
    assert np.ptp(file["rho"], axis=0).min() > 30.0


def test_with_j2_the_motion_stays_free_to_the_size_of_its_perturbation() -> None:
    """Differential J2 moves the servicer by about its relative size, 1.6e-3, times the separation in each radian."""
    file = read_reference(FOLDER / "c_relative.npz")
    orbit, constants = start(file)
    found = np.asarray(positions(relative_orbit_of(constants), orbit, jnp.asarray(file["t"])))
    separation = np.linalg.norm(file["rho"], axis=1)
    angle = 2.0 * np.pi * file["t"] / file["t"][-1] * 5.0
    error = np.linalg.norm(found - file["rho"], axis=1)
    assert np.all(error < 1e-3 + 3.0 * 1.6e-3 * np.maximum.accumulate(separation) * angle)
