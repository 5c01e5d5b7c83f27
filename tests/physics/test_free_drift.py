"""Ranges of free drifts against direct propagation by the plant itself, thrust off."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy_reference import MU
from scipy.integrate import solve_ivp

from rpojax.campaign.single_run import nominal_parameters
from rpojax.core.numerics import runge_kutta
from rpojax.core.orbits import keplerian_elements
from rpojax.core.orbits.sun_moon_ephemeris import J2000, SunMoonPositions, sun_and_moon_at
from rpojax.physics import equipment_faults, free_drift, plant, plant_state
from rpojax.physics.free_drift import STEP_S, Drift, DriftRange, Environment
from rpojax.physics.plant_options import Effects
from rpojax.physics.plant_state import Motion
from rpojax.scenario.loading import scenario_loader
from rpojax.scenario.params import Params

RHO = np.array([[0.0, -30.0, 0.0], [5.0, 40.0, 8.0], [-10.0, 12.0, -6.0]])
RHO_DOT = np.array([[0.002, -0.0012, 0.001], [0.01, -0.008, 0.02], [0.0, 0.022, -0.01]])
"""Starts [m, m/s] in H that come close to the target and away again."""
ENTRY_TOLERANCE_S = 10.0
"""Two samples of the plant, of the parabola through an interval."""


class Case:
    """A scenario in which drifts begin at time zero, as the plant and as this module propagate them."""

    def __init__(self, name: str, *overrides: str) -> None:
        file = scenario_loader.load(name, list(overrides))
        self.scenario, self.params = nominal_parameters(file)
        self.environment = Environment(self.scenario.effects, self.params.plant, self.params.epoch)
        identity = jnp.array([1.0, 0.0, 0.0, 0.0])

        def start(rho: jax.Array, rho_dot: jax.Array) -> plant_state.Truth:
            return plant_state.initial_truth(self.params.plant, self.params.orbit, rho, rho_dot, identity)

        self.truths = jax.jit(jax.vmap(start, in_axes=-1, out_axes=-1))(RHO.T, RHO_DOT.T)

    def by_plant(self, duration_s: float, step_s: float) -> np.ndarray:
        """Range [m] after each step of the plant (steps, drifts)."""
        scenario, params = self.scenario, self.params.plant

        def advance(truths: plant_state.Truth, number: jax.Array) -> tuple[plant_state.Truth, jax.Array]:
            sky = sun_and_moon_at(self.params.epoch, jnp.floor(number * step_s / scenario.tick_s) * scenario.tick_s)

            def step(truth: plant_state.Truth) -> plant_state.Truth:
                wheels, healthy = jnp.zeros(3), equipment_faults.healthy()
                return plant.step(scenario.effects, params, truth, wheels, (), sky, healthy, step_s)

            after = jax.vmap(step, in_axes=-1, out_axes=-1)(truths)
            return after, jnp.sqrt(jnp.sum(after.r_ST_N**2, axis=0))

        numbers = jnp.arange(round(duration_s / step_s), dtype=jnp.float64)
        return np.asarray(jax.jit(lambda truths: jax.lax.scan(advance, truths, numbers)[1])(self.truths))

    def drifts(self, horizons_s: tuple[float, ...]) -> Drift:
        """The drifts, with free thrusters."""
        count = len(RHO)
        return Drift(
            start=jnp.zeros(count),
            r_ST_N=self.truths.r_ST_N,
            v_ST_N=self.truths.v_ST_N,
            mass=jnp.full(count, self.params.plant.servicer.mass),
            thrust_s=jnp.zeros(count),
            acceleration_N=jnp.zeros((3, count)),
            ends=jnp.asarray(np.array(horizons_s)[:, None] + np.zeros((1, count))),
        )

    def by_free_drift(self, drifts: Drift) -> DriftRange:
        """Their ranges."""
        state = keplerian_elements.state_from_elements(self.params.orbit)
        last = int(np.ceil(np.max(drifts.ends) / STEP_S))
        return jax.jit(lambda drifts: propagate(self, state, drifts, last))(drifts)


def propagate(case: Case, state: tuple[jax.Array, jax.Array], drifts: Drift, last: int) -> DriftRange:
    """Ranges of drifts that begin in the first three steps."""
    orbit = free_drift.target_orbit(case.environment, *state, 3)
    return free_drift.drift_ranges(
        case.environment, orbit, drifts, case.params.limits.keep_out, jnp.int32(0), jnp.int32(last)
    )


def assert_equal_ranges(case: Case, horizons_s: tuple[float, ...], step_s: float, tolerance_m: float) -> None:
    sampled = case.by_plant(max(horizons_s), step_s)
    found = case.by_free_drift(case.drifts(horizons_s))
    for place, horizon in enumerate(horizons_s):
        expected = np.minimum(sampled[: round(horizon / step_s)].min(axis=0), np.linalg.norm(RHO, axis=1))
        np.testing.assert_allclose(np.sqrt(found.least_square[place]), expected, rtol=0.0, atol=tolerance_m)
    inside = sampled < float(case.params.limits.keep_out)
    entry = np.where(inside.any(axis=0), (np.argmax(inside, axis=0) + 1) * step_s, np.inf)
    np.testing.assert_allclose(found.entry, entry, rtol=0.0, atol=ENTRY_TOLERANCE_S)


def test_ranges_within_an_hour_are_those_of_the_plant() -> None:
    # A step of 2 s and a relative speed of 0.1 m/s leave a few millimetres between the plant's samples.
    assert_equal_ranges(Case("inspection_full"), (1500.0, 4000.0), 2.0, 0.01)


@pytest.mark.slow
@pytest.mark.parametrize(
    "overrides",
    [
        ("inspection",),
        ("inspection_full",),
        ("inspection_eclipse",),
        ("inspection_full", "orbit.semi_major_axis_m=7.8e6", "orbit.eccentricity=0.1"),
        ("inspection_full", "orbit.semi_major_axis_m=2.4e7", "orbit.eccentricity=0.7"),
    ],
)
def test_ranges_within_a_day_are_those_of_the_plant_to_a_centimetre(overrides: tuple[str, ...]) -> None:
    assert_equal_ranges(Case(*overrides), (5700.0, 86400.0), 1.0, 0.01)


@pytest.fixture(scope="module")
def case() -> Case:
    """The packaged mission."""
    return Case("inspection")


def test_drifts_do_not_depend_on_each_other_nor_on_the_step_that_they_begin_in(case: Case) -> None:
    """A drift that begins later on the same coast has the same future."""
    drifts = case.drifts((6000.0,))
    state = keplerian_elements.state_from_elements(case.params.orbit)
    orbit = free_drift.target_orbit(case.environment, *state, 3)

    def coasted(seconds: float) -> Drift:
        def after(r: jax.Array, v: jax.Array) -> tuple[jax.Array, jax.Array]:
            zero = jnp.zeros(())
            begin = free_drift.motion_at(case.environment, orbit, zero, r, v)
            mass = case.params.plant.servicer.mass
            there = case.environment.advance(begin, mass, zero, jnp.asarray(seconds), jnp.zeros(3))
            return there.r_ST_N, there.v_ST_N

        r, v = jax.jit(jax.vmap(after, in_axes=-1, out_axes=-1))(drifts.r_ST_N, drifts.v_ST_N)
        return Drift(**{**drifts.__dict__, "start": jnp.full(len(RHO), seconds), "r_ST_N": r, "v_ST_N": v})

    first = case.by_free_drift(drifts)
    for seconds in (STEP_S, 0.3 * STEP_S, 1.7 * STEP_S):
        later = case.by_free_drift(coasted(seconds))
        np.testing.assert_allclose(np.sqrt(later.least_square), np.sqrt(first.least_square), atol=1e-3)
        np.testing.assert_allclose(later.entry, first.entry, atol=ENTRY_TOLERANCE_S)


def test_an_open_thruster_pushes_for_its_time(case: Case) -> None:
    drifts = case.drifts((100.0,))
    push = jnp.asarray(np.array([0.0, 1e-3, 0.0])[:, None] + np.zeros((3, len(RHO))))
    still = Drift(**{**drifts.__dict__, "thrust_s": jnp.full(len(RHO), 60.0), "acceleration_N": push})
    found = np.sqrt(np.asarray(case.by_free_drift(still).least_square))[0]
    # Over a minute the forces of the orbit are 1 % of the thruster's.
    t = np.linspace(0.0, 100.0, 1001)[:, None, None]
    pushed = np.where(t < 60.0, 0.5e-3 * t**2, 1.8 + 0.06 * (t - 60.0)) * np.array([0.0, 1.0, 0.0])
    r0, v0 = np.asarray(still.r_ST_N).T, np.asarray(still.v_ST_N).T
    expected = np.linalg.norm(r0 + v0 * t + pushed, axis=2).min(axis=0)
    np.testing.assert_allclose(found, expected, atol=0.3)
    assert np.max(np.abs(expected - np.linalg.norm(r0 + v0 * t, axis=2).min(axis=0))) > 1.0


ECCENTRIC = Motion(
    r_TN_N=jnp.array([7.0e6, 0.0, 0.0]),
    v_TN_N=jnp.array([-700.0, 7570.0, 2490.0]),
    r_ST_N=jnp.zeros(3),
    v_ST_N=jnp.zeros(3),
)
"""An orbit of an eccentricity of 0.16, a minute before its perigee."""


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_the_shadow_of_a_step_is_looked_up_on_the_orbit_of_the_target(
    monkeypatch: pytest.MonkeyPatch, params: Params, axis: int
) -> None:
    """A sunlit fraction that is a coordinate has the moments over the step of that coordinate."""
    monkeypatch.setattr(free_drift, "sunlit_fraction", lambda _sunlight, r_N, _sun_N: r_N[axis])
    environment = Environment(Effects(zonal_degree=0, solar_pressure=True), params.plant, 0.0)
    sky = SunMoonPositions(sun_N=jnp.ones(3), moon_N=jnp.ones(3))  # not used
    found = np.asarray(jax.jit(environment._sunlit_nodes)(ECCENTRIC, sky, jnp.asarray(STEP_S)))

    places = (np.arange(48) + 0.5) / 48.0
    begin = np.concatenate([ECCENTRIC.r_TN_N, ECCENTRIC.v_TN_N])
    orbit = solve_ivp(
        lambda _, y: np.concatenate([y[3:], -MU * y[:3] / np.linalg.norm(y[:3]) ** 3]),
        (0.0, STEP_S),
        begin,
        method="DOP853",
        t_eval=places * STEP_S,
        rtol=1e-12,
        atol=1e-6,
    )
    nodes, powers = np.array(runge_kutta.NODES["rk8"]), np.arange(5)
    weights = np.linalg.solve(nodes[None, :] ** powers[:, None], 1.0 / (powers + 1.0))
    moments = (weights * nodes[None, :] ** powers[:, None]) @ found
    expected = np.mean(orbit.y[axis] * places[None, :] ** powers[:, None], axis=1)
    # At the end of the step it is 0.02 s off, 130 m, on the mean over the step a fifth of this.
    np.testing.assert_allclose(moments, expected, atol=30.0)


def test_the_impulse_of_a_step_is_what_is_not_affine_in_state_and_inverse_mass(params: Params) -> None:
    environment = Environment(Effects(zonal_degree=2, drag=True), params.plant, J2000)
    time, nominal = jnp.zeros(()), params.plant.servicer.mass
    r_ST_N = jnp.array([[300.0, 0.0, -50.0], [-100.0, 200.0, 0.0], [50.0, 80.0, -300.0]])
    v_ST_N = jnp.array([[0.3, 0.0, -0.1], [0.1, -0.2, 0.2], [0.0, 0.1, -0.3]])
    masses = 1.0 / (1.0 / nominal * jnp.array([1.0, 1.1, 0.8]))

    @jax.jit
    def impulse(r_ST_N: jax.Array, v_ST_N: jax.Array, masses: jax.Array) -> jax.Array:
        motion = Motion(r_TN_N=LOW.r_TN_N, v_TN_N=LOW.v_TN_N, r_ST_N=r_ST_N, v_ST_N=v_ST_N)
        return free_drift._Splitting(environment).kick(motion, masses, time)

    @jax.jit
    def acceleration(r_ST_N: jax.Array, v_ST_N: jax.Array, masses: jax.Array) -> jax.Array:
        def one(r: jax.Array, v: jax.Array, mass: jax.Array) -> jax.Array:
            motion = Motion(r_TN_N=LOW.r_TN_N, v_TN_N=LOW.v_TN_N, r_ST_N=r, v_ST_N=v)
            return environment.accelerations(motion, mass, environment.sky(time), jnp.zeros(()))[1]

        return jax.vmap(one, in_axes=-1, out_axes=-1)(r_ST_N, v_ST_N, masses)

    # By second differences about no relative motion and the nominal mass.
    opposite = 1.0 / (2.0 / nominal - 1.0 / masses)
    both = acceleration(r_ST_N, v_ST_N, masses) + acceleration(-r_ST_N, -v_ST_N, opposite)
    none = jnp.zeros((3, 3))
    expected = 0.5 * both - acceleration(none, none, jnp.full(3, nominal))
    found = impulse(r_ST_N, v_ST_N, masses)
    scale = np.max(np.abs(expected))
    assert scale > 1e-9
    np.testing.assert_allclose(found, expected, atol=1e-3 * scale)


LOW = Motion(
    r_TN_N=jnp.array([5.0e6, 3.0e6, 3.2e6]),
    v_TN_N=jnp.array([-4.0e3, 6.5e3, 0.2e3]),
    r_ST_N=jnp.zeros(3),
    v_ST_N=jnp.zeros(3),
)
"""An orbit 300 km above the ground."""
