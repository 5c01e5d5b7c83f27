"""Propellant, centre of mass and inertia after pulses of twelve thrusters, against an integration by scipy."""

import functools
import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp

import rpojax
from rpojax.core.orbits.sun_moon_ephemeris import SunMoonPositions
from rpojax.core.pytree import replace
from rpojax.physics import equipment_faults, forces_and_torques, plant, plant_state, rcs_thrusters, thruster
from rpojax.physics.plant_options import Effects
from rpojax.physics.plant_state import PlantParams, Truth
from rpojax.physics.rcs_thrusters import RcsThruster

STEP, STEPS = 0.2, 500
G0 = 9.80665
EFFECTS = Effects(center_of_mass_shift=True, inertia_change=True)
SKY = SunMoonPositions(sun_N=jnp.array([1.5e11, 0.0, 0.0]), moon_N=jnp.array([0.0, 3.8e8, 0.0]))
TANK = np.array([-0.1, 0.03, 0.05])
RADIUS = 0.12


@pytest.fixture(scope="module")
def params() -> PlantParams:
    """Those of the final approach with a tank beside the centre of mass, of a vehicle that uses a tenth of its mass."""
    _, params, _ = rpojax.initialise_run(rpojax.load("final_approach"), 0, 0)
    given = params.plant
    tank = replace(given.thruster, tank_position=jnp.asarray(TANK), tank_radius=jnp.asarray(RADIUS))
    # Twenty times the force, so that 100 s use kilograms.
    strong = {name: replace(each, force=20.0 * each.force) for name, each in given.thrusters.items()}
    return replace(given, thruster=tank, thrusters=strong)


@pytest.fixture(scope="module")
def on_times(params: PlantParams) -> np.ndarray:
    """On-times (steps, 12) [s]: pulses of any length up to a step, a third of them none."""
    rng = np.random.default_rng(3)
    times = rng.uniform(0.02, STEP, (STEPS, len(params.thrusters)))
    return times * (rng.uniform(size=times.shape) > 1.0 / 3.0)


@functools.partial(jax.jit, static_argnums=0)
def fired(effects: Effects, params: PlantParams, truth: Truth, on_times: jax.Array) -> Truth:
    """Truth after each step (n, ...) with the pulses."""
    stacked = rcs_thrusters.stacked(params.thrusters)
    count = stacked.force.shape[0]
    state = rcs_thrusters.true_state(stacked, jnp.zeros(count), jnp.ones(count))

    def body(truth: Truth, times: jax.Array) -> tuple[Truth, Truth]:
        thrust = rcs_thrusters.thrust_over_step(state, times, effects.integrator, STEP)
        after = plant.step(effects, params, truth, jnp.zeros(3), (), SKY, equipment_faults.healthy(), STEP, thrust)
        return after, after

    return jax.lax.scan(body, truth, on_times)[1]


@pytest.fixture(scope="module")
def start(params: PlantParams) -> Truth:
    """At rest, so far from the Earth that its gravity is negligible."""
    _, loaded, _ = rpojax.initialise_run(rpojax.load("final_approach"), 0, 0)
    place = jnp.array([0.0, -50.0, 0.0])
    truth = plant_state.initial_truth(params, loaded.orbit, place, jnp.zeros(3), jnp.array([1.0, 0.0, 0.0, 0.0]))
    still = replace(truth, omega_BN_B=jnp.zeros(3), plume_impulse=None)
    return replace(still, r_TN_N=jnp.array([1e14, 0.0, 0.0]), v_TN_N=jnp.zeros(3), v_ST_N=jnp.zeros(3))


def expected_mass(thrusters: dict[str, RcsThruster], on_times: np.ndarray, mass: float) -> np.ndarray:
    """Mass [kg] after each step by scipy, whose right-hand side opens and shuts each valve; integrated between them."""
    flows = np.array([float(each.force) / (float(each.isp) * G0) for _, each in sorted(thrusters.items())])
    masses = []
    for times in on_times:
        edges = np.unique(np.concatenate([[0.0, STEP], times]))
        for begin, end in itertools.pairwise(edges):
            flow = float(np.sum(flows[times > 0.5 * (begin + end)]))
            mass = solve_ivp(lambda _, __, f=flow: [-f], (begin, end), [mass], rtol=1e-12, atol=1e-12).y[0, -1]
        masses.append(mass)
    return np.array(masses)


def rest_of(masses: np.ndarray, full: float, inertia: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Centre of mass [m] and inertia about it [kg m^2] of a dry body and a sphere of 4 kg when full, put together anew.

    The dry body is what is left of the full one without its sphere; it stays, and the sphere keeps its radius.
    """
    propellant = 4.0

    def about(place: np.ndarray) -> np.ndarray:
        return place @ place * np.eye(3) - np.outer(place, place)

    sphere = 0.4 * RADIUS**2 * np.eye(3)
    dry, dry_at_origin = full - propellant, inertia - propellant * (sphere + about(TANK))
    dry_center = -propellant * TANK / dry
    dry_inertia = dry_at_origin - dry * about(dry_center)
    centers, inertias = [], []
    for mass in masses:
        left = mass - dry
        center = (dry * dry_center + left * TANK) / mass
        centers.append(center)
        of_dry = dry_inertia + dry * about(dry_center - center)
        inertias.append(of_dry + left * (sphere + about(TANK - center)))
    return np.array(centers), np.array(inertias)


def test_propellant_centre_of_mass_and_inertia_are_those_of_a_dry_body_and_an_even_sphere(
    params: PlantParams, start: Truth, on_times: np.ndarray
) -> None:
    after = fired(EFFECTS, params, start, jnp.asarray(on_times))
    full = float(params.servicer.mass)
    masses = expected_mass(params.thrusters, on_times, full)
    used = full - masses
    assert 1.0 < used[-1] < 4.0
    np.testing.assert_allclose(full - np.asarray(after.mass), used, rtol=1e-6)
    centers, inertias = rest_of(masses, full, np.asarray(params.servicer.inertia))
    shift = jax.vmap(lambda mass: thruster.center_of_mass_shift(params.thruster, params.servicer.mass - mass, mass))
    np.testing.assert_allclose(shift(after.mass), centers, rtol=1e-6)
    found = jax.vmap(lambda truth: forces_and_torques.servicer_inertia(EFFECTS, params, truth))(after)
    np.testing.assert_allclose(found, inertias, rtol=1e-6)
    # All of them change by much more than the tolerance.
    assert np.abs(inertias[-1] - inertias[0]).max() > 0.02


def test_the_rate_that_pulses_give_is_that_of_the_inertia_that_is_left(
    params: PlantParams, start: Truth, on_times: np.ndarray
) -> None:
    """One step of weak pulses at rest, after 3 kg were used: the moment about the centre of mass over the inertia."""
    weak = {name: replace(each, force=each.force / 2000.0) for name, each in params.thrusters.items()}
    full, times = float(params.servicer.mass), on_times[0]
    lighter = replace(start, mass=start.mass - 3.0)
    found = np.asarray(fired(EFFECTS, replace(params, thrusters=weak), lighter, jnp.asarray(times[None])).omega_BN_B)[
        -1
    ]
    centers, inertias = rest_of(np.array([full - 3.0]), full, np.asarray(params.servicer.inertia))
    stacked = rcs_thrusters.stacked(weak)
    impulse = times[:, None] * np.asarray(rcs_thrusters.nominal_forces(stacked))
    moment = np.cross(np.asarray(stacked.position) - centers[0], impulse).sum(axis=0)
    # Free wheels do not turn about their own axes with the body.
    axes, wheels = np.asarray(params.wheels.axes), np.asarray(params.wheels.inertia)
    locked = (axes.T * wheels) @ axes
    np.testing.assert_allclose(found, np.linalg.solve(inertias[0] - locked, moment), rtol=1e-5)
    of_full = np.linalg.solve(np.asarray(params.servicer.inertia) - locked, moment)
    assert np.linalg.norm(found - of_full) > 0.01 * np.linalg.norm(of_full)


def test_without_the_effect_the_inertia_stays(params: PlantParams, start: Truth) -> None:
    lighter = replace(start, mass=start.mass - 1.0)
    unchanged = forces_and_torques.servicer_inertia(Effects(center_of_mass_shift=True), params, lighter)
    np.testing.assert_array_equal(unchanged, params.servicer.inertia)
