"""Guidance: slew profiles, pointing, the burn schedule and when there is none, and the search."""

import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import rendezvous_scene
from hypothesis import given
from hypothesis import strategies as st
from numpy_reference import (
    MU,
    SEEDS,
    attitude_difference,
    axis_angle_quaternion,
    gravity,
    random_unit,
    rate_between,
    rotation_matrix,
    unit,
)
from scipy.integrate import solve_ivp

from rpojax.core.frames import hill_frame, inertial_to_hill
from rpojax.core.pytree import replace
from rpojax.flight.computer import FlightParams
from rpojax.flight.control.attitude_control import AttitudeCommand
from rpojax.flight.control.formation_lqr import StationKeeping
from rpojax.flight.guidance import attitude_guidance, burn_planning, slew_profile, target_pointing
from rpojax.flight.guidance.attitude_guidance import PointingState
from rpojax.flight.guidance.burn_planning import BurnPlan
from rpojax.flight.guidance.pointing_modes import Mode
from rpojax.flight.guidance.slew_profile import SlewReference
from rpojax.flight.navigation.orbit_filter import OrbitEstimate
from rpojax.scenario.params import Params

EXACT = 1e-12  # roundings of unit vectors and angles
GAIN = np.zeros((3, 6))
STAYS = StationKeeping(arrival_velocity=np.zeros(3), impulse=np.zeros(3))
YES, NO = jnp.asarray(True), jnp.asarray(False)
SAMPLES = 5
TIME = np.float64(1000.0)  # of the decision

is_visible = jax.jit(target_pointing.is_visible)
evaluate = jax.jit(slew_profile.evaluate)
guide = jax.jit(attitude_guidance.guide, static_argnums=8)
hill = jax.jit(hill_frame)
inhibit = jax.jit(burn_planning.inhibit, static_argnums=4)
look_attitude = jax.jit(target_pointing.look_attitude)
to_hill = jax.jit(inertial_to_hill)
plan_burn = jax.jit(burn_planning.plan_burn, static_argnums=0)
range_uncertainty = jax.jit(target_pointing.relative_range_sigma)
bearing_uncertainty = jax.jit(target_pointing.bearing_sigma)
slew_duration = jax.jit(slew_profile.slew_duration)


ALWAYS = np.array([0.01, 0.0, 0.0])
"""What the two laws below add to their report, so that it never falls into the dead band [m/s]."""


def report_position(gain: jax.Array, deviation: jax.Array) -> jax.Array:
    """A law that shows what it was given: a millimetre per second for each metre of predicted deviation."""
    return ALWAYS + 1e-3 * deviation[:3]


def report_velocity(gain: jax.Array, deviation: jax.Array) -> jax.Array:
    """The same for the predicted velocity deviation."""
    return ALWAYS + deviation[3:]


def push_back(gain: jax.Array, deviation: jax.Array) -> jax.Array:
    """20 mm/s backwards along the track."""
    return jnp.array([0.0, -0.02, 0.0])


def push_hard(gain: jax.Array, deviation: jax.Array) -> jax.Array:
    """1 m/s, more than can be done while the camera looks away."""
    return jnp.array([0.0, -1.0, 0.0])


def push_gently(gain: jax.Array, deviation: jax.Array) -> jax.Array:
    """0.9 mm/s, inside the dead band."""
    return jnp.array([0.0, 9e-4, 0.0])


def push_briefly(gain: jax.Array, deviation: jax.Array) -> jax.Array:
    """1.1 mm/s, just outside of it."""
    return jnp.array([0.0, 1.1e-3, 0.0])


@pytest.fixture(scope="module")
def flight(params: Params) -> FlightParams:
    return params.flight


@pytest.fixture(scope="module")
def known(flight: FlightParams) -> OrbitEstimate:
    return rendezvous_scene.estimate(flight)


def plan(law: object, flight: FlightParams, estimate: OrbitEstimate, allowed: bool = True) -> BurnPlan:
    parts = (flight.formation, flight.pointing, flight.vehicle, GAIN, STAYS, estimate)
    q_look, _ = look_attitude(flight.vehicle, estimate)
    found = plan_burn(law, *parts, q_look, np.asarray(allowed), TIME)
    return jax.tree.map(np.asarray, found)


def boresight(flight: FlightParams, q_BN: np.ndarray) -> np.ndarray:
    """Direction in N that the camera looks along; the nominal mounting is along body x."""
    return rotation_matrix(np.asarray(q_BN)).T @ np.array([1.0, 0.0, 0.0])


# Slew profile


def slew_of(angle: float, end_rate: np.ndarray, flight: FlightParams, seed: int = 0) -> SlewReference:
    rng = np.random.default_rng(seed)
    return SlewReference(
        q_EN=random_unit(rng, 4),
        omega_EN_E=end_rate,
        remainder=angle * random_unit(rng),
        slew_age=np.float64(0.0),
        slew_time=np.asarray(slew_duration(flight.pointing, np.float64(angle))),
    )


@pytest.mark.parametrize("angle", [0.0, 0.05, 1.0, np.pi])
def test_a_slew_starts_and_ends_at_rest_relative_to_its_end_and_turns_by_its_angle(
    flight: FlightParams, angle: float
) -> None:
    reference = slew_of(angle, np.zeros(3), flight)
    first, last = evaluate(reference, np.float64(0.0)), evaluate(reference, reference.slew_time)
    for command in (first, last):
        np.testing.assert_allclose(command.omega_CN_C, np.zeros(3), atol=EXACT)
        np.testing.assert_allclose(command.acceleration_C, np.zeros(3), atol=EXACT)
    np.testing.assert_allclose(attitude_difference(np.asarray(first.q_CN), reference.q_EN), angle, atol=1e-7)
    assert attitude_difference(np.asarray(last.q_CN), reference.q_EN) < EXACT
    later = evaluate(reference, reference.slew_time + 20.0)
    assert attitude_difference(np.asarray(later.q_CN), reference.q_EN) < EXACT


@given(st.floats(0.5, 3.1))
def test_the_largest_acceleration_of_a_slew_is_the_planned_one(params: Params, angle: float) -> None:
    reference = slew_of(angle, np.zeros(3), params.flight)
    peak = evaluate(reference, 0.25 * reference.slew_time).acceleration_C
    np.testing.assert_allclose(np.linalg.norm(peak), 0.016, rtol=1e-12)


def test_short_slews_take_the_least_time(flight: FlightParams) -> None:
    times = [float(slew_duration(flight.pointing, np.float64(angle))) for angle in (0.0, 0.01, 0.05)]
    assert times == [6.0, 6.0, 6.0]


@given(SEEDS)
def test_commanded_rate_and_acceleration_are_the_derivatives_of_the_commanded_attitude(
    params: Params, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    reference = slew_of(rng.uniform(0.3, 3.0), 1e-3 * rng.normal(size=3), params.flight, seed)
    age, h = rng.uniform(0.05, 0.95) * float(reference.slew_time), 1e-4
    before, now, after = (evaluate(reference, np.float64(age + shift)) for shift in (-h, 0.0, h))
    omega = rate_between(np.asarray(before.q_CN), np.asarray(after.q_CN), 2 * h)
    np.testing.assert_allclose(now.omega_CN_C, omega, atol=1e-8)
    slope = (np.asarray(after.omega_CN_C) - np.asarray(before.omega_CN_C)) / (2 * h)
    # The command leaves out how the slew turns the end's own slow rate: below its rate times the slew's.
    np.testing.assert_allclose(now.acceleration_C, slope, atol=4e-3 * 0.2)


# Pointing at the target


@given(SEEDS)
def test_the_camera_looks_at_the_target_with_its_x_axis_as_near_as_can_be_to_the_orbit_normal(
    params: Params, seed: int
) -> None:
    direction = random_unit(np.random.default_rng(seed))
    known = rendezvous_scene.estimate(params.flight, 40.0 * direction)
    q_BN, _ = look_attitude(params.flight.vehicle, known)
    q_KN = rendezvous_scene.camera_attitude(params.flight, known)
    R_KN = rotation_matrix(q_KN)
    np.testing.assert_allclose(R_KN[2], direction, atol=EXACT)
    normal = unit(np.cross(rendezvous_scene.R_SN_N, rendezvous_scene.V_SN_N))
    np.testing.assert_allclose(R_KN[0] @ normal, np.sqrt(1.0 - (normal @ direction) ** 2), atol=1e-9)
    np.testing.assert_allclose(boresight(params.flight, q_BN), direction, atol=EXACT)


@given(SEEDS)
def test_the_look_rate_is_how_fast_the_look_attitude_turns(params: Params, seed: int) -> None:
    rng = np.random.default_rng(seed)
    normal = unit(np.cross(rendezvous_scene.R_SN_N, rendezvous_scene.V_SN_N))
    line = unit(np.cross(normal, random_unit(rng)) + 0.7 * rng.uniform(-1, 1) * normal)
    r, v, h = 30.0 * line, 0.1 * rng.normal(size=3), 0.01
    pull = -MU * rendezvous_scene.R_SN_N / np.linalg.norm(rendezvous_scene.R_SN_N) ** 3

    def at(t: float) -> OrbitEstimate:
        known = rendezvous_scene.estimate(params.flight, r + t * v, v)
        moved = replace(
            known.servicer,
            r_SN_N=rendezvous_scene.R_SN_N + t * rendezvous_scene.V_SN_N + 0.5 * t * t * pull,
            v_SN_N=rendezvous_scene.V_SN_N + t * pull,
        )
        return replace(known, servicer=moved)

    (before, _), (_, omega), (after, _) = (look_attitude(params.flight.vehicle, at(t)) for t in (-h, 0.0, h))
    expected = rate_between(np.asarray(before), np.asarray(after), 2 * h)
    np.testing.assert_allclose(omega, expected, atol=1e-8)  # truncation h^2 times the cube of a rate of 6e-3 rad/s


# The burn


@given(SEEDS)
def test_the_deviation_is_predicted_to_the_middle_of_the_burn_in_the_hill_frame_there(
    params: Params, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    flight = params.flight
    r_TS_N, v_TS_N = (
        rendezvous_scene.TARGET_AHEAD + 3.0 * rng.normal(size=3),
        np.cross(rendezvous_scene.HILL_RATE, rendezvous_scene.TARGET_AHEAD),
    )
    v_TS_N = v_TS_N + 0.01 * rng.normal(size=3)
    known = rendezvous_scene.estimate(flight, r_TS_N, v_TS_N)
    lead = 60.0
    orbits = []
    for start in (
        np.concatenate([rendezvous_scene.R_SN_N, rendezvous_scene.V_SN_N]),
        np.concatenate([rendezvous_scene.R_SN_N + r_TS_N, rendezvous_scene.V_SN_N + v_TS_N]),
    ):
        solution = solve_ivp(
            lambda _, y: np.concatenate([y[3:], gravity(y[:3])]), (0.0, lead), start, "DOP853", rtol=1e-13, atol=1e-8
        )
        orbits.append(solution.y[:, -1])
    servicer, target = orbits
    axes = hill(target[:3], target[3:])
    rho, rho_dot = to_hill((servicer - target)[:3], (servicer - target)[3:], *axes)
    # The circular-orbit model over a minute leaves out J2 and eccentricity: 1e-3 of the 30 m times (n 60 s)^2.
    for law, scale, expected, bound in (
        (report_position, 1e-3, np.asarray(rho) - [0.0, -30.0, 0.0], 2e-3),
        (report_velocity, 1.0, np.asarray(rho_dot), 1e-4),
    ):
        found = (np.asarray(axes[0]) @ plan(law, flight, known).delta_v_N - ALWAYS) / scale
        np.testing.assert_allclose(found, expected, atol=bound)


def test_the_burn_is_centred_on_the_lead_and_lasts_as_long_as_its_velocity_change_takes(
    flight: FlightParams, known: OrbitEstimate
) -> None:
    found = plan(push_back, flight, known)
    np.testing.assert_allclose(found.cutoff - found.ignition, 20.0, rtol=1e-12)  # 20 mm/s at 1 mm/s^2
    np.testing.assert_allclose(0.5 * (found.cutoff + found.ignition), TIME + 60.0, rtol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(found.delta_v_N), 0.02, rtol=1e-12)


@given(SEEDS)
def test_the_burn_attitude_puts_the_thrust_along_the_velocity_change(params: Params, seed: int) -> None:
    rng = np.random.default_rng(seed)
    r_TS_N = rendezvous_scene.TARGET_AHEAD + 5.0 * rng.normal(size=3)
    found = plan(report_position, params.flight, rendezvous_scene.estimate(params.flight, r_TS_N))
    thrust = rotation_matrix(found.q_burn).T @ np.asarray(params.flight.vehicle.thrust_direction)
    np.testing.assert_allclose(thrust, unit(found.delta_v_N), atol=1e-9)


def assert_no_burn(found: BurnPlan) -> None:
    assert found.cutoff == found.ignition
    np.testing.assert_array_equal(found.delta_v_N, np.zeros(3))
    assert found.turn_start == found.ignition


def test_there_is_no_burn_in_the_dead_band(flight: FlightParams, known: OrbitEstimate) -> None:
    assert_no_burn(plan(push_gently, flight, known))
    assert plan(push_briefly, flight, known).cutoff > plan(push_briefly, flight, known).ignition


def test_there_is_no_burn_unless_it_is_allowed(flight: FlightParams, known: OrbitEstimate) -> None:
    assert_no_burn(plan(push_back, flight, known, allowed=False))


@pytest.mark.parametrize(("sigma", "burns"), [(5.9, True), (6.1, False)])
def test_there_is_no_burn_while_the_range_is_less_certain_than_a_fifth(
    flight: FlightParams, sigma: float, burns: bool
) -> None:
    found = plan(push_back, flight, rendezvous_scene.estimate(flight, position_sigma=sigma))
    assert (found.cutoff > found.ignition) is np.bool_(burns)


def test_there_is_no_burn_shorter_than_the_thrusters_least_on_time(flight: FlightParams, known: OrbitEstimate) -> None:
    slow = replace(flight, vehicle=replace(flight.vehicle, minimum_on_time=jnp.float64(1.2)))
    assert_no_burn(plan(push_briefly, slow, known))


def test_uncertainties_are_those_along_and_across_the_line_of_sight(flight: FlightParams) -> None:
    known = rendezvous_scene.estimate(flight)
    line = unit(rendezvous_scene.TARGET_AHEAD)
    P = 0.01 * np.eye(3) + 8.99 * np.outer(line, line)
    covariance = known.relative.covariance.at[:3, :3].set(jnp.asarray(P))
    long = replace(known, relative=replace(known.relative, covariance=covariance))
    np.testing.assert_allclose(range_uncertainty(long), 3.0 / 30.0, rtol=1e-12)
    np.testing.assert_allclose(bearing_uncertainty(long), np.sqrt(2) * 0.1 / 30.0, rtol=1e-9)


# The schedule, flown


@jax.jit
def simulate(
    flight: FlightParams,
    estimate: OrbitEstimate,
    plan: BurnPlan,
    state: PointingState,
    times: jax.Array,
    blind: jax.Array,
    visible: jax.Array = YES,
) -> tuple[jax.Array, AttitudeCommand, jax.Array]:
    """Modes, commands five times a second, and whether a box was accepted, tick by tick.

    A box is accepted when the camera looks within 5 deg of the target, unless `blind`.
    """
    line = estimate.relative.r_TS_N / jnp.sqrt(jnp.sum(estimate.relative.r_TS_N**2))

    def body(
        state: PointingState, time: jax.Array
    ) -> tuple[PointingState, tuple[jax.Array, AttitudeCommand, jax.Array]]:
        q_BN = slew_profile.evaluate(state.reference, jnp.ones(())).q_CN
        looks = attitude_guidance.rotate(attitude_guidance.quaternion.conjugate(q_BN), jnp.array([1.0, 0.0, 0.0]))
        accepted = (jnp.sum(looks * line) > jnp.cos(jnp.deg2rad(5.0))) & ~blind
        state, mode = attitude_guidance.guide(
            flight.pointing, flight.vehicle, estimate, plan, state, accepted, visible, time, 1.0
        )
        ages = jnp.arange(SAMPLES, dtype=jnp.float64) / SAMPLES
        return state, (mode, jax.vmap(lambda age: slew_profile.evaluate(state.reference, age))(ages), accepted)

    return jax.lax.scan(body, state, times)[1]


def simulate_plan(
    flight: FlightParams, known: OrbitEstimate, found: BurnPlan
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times, modes and commanded attitudes (ticks, samples, 4) around a planned burn, starting on the target."""
    times = TIME + np.arange(300.0)
    state = attitude_guidance.initial_pointing(flight.vehicle, known)
    modes, commands, _ = simulate(flight, known, found, state, times, np.asarray(False))
    return times, np.asarray(modes), np.asarray(commands.q_CN)


@pytest.mark.parametrize("law", [push_back, push_hard], ids=["usual", "too long"])
def test_the_camera_turns_away_burns_and_comes_back_within_the_limit(
    flight: FlightParams, known: OrbitEstimate, law: object
) -> None:
    found = plan(law, flight, known)
    times, modes, attitudes = simulate_plan(flight, known, found)
    sequence = [Mode(mode) for mode, _ in itertools.groupby(modes)]
    assert sequence == [Mode.LOOK, Mode.TURN, Mode.BURN, Mode.TURN_BACK, Mode.LOOK]
    away = times[(modes != Mode.LOOK)]
    assert away[-1] + 1.0 - away[0] <= 110.0
    burning = (times >= found.ignition) & (times < found.cutoff)
    for q_CN in attitudes[burning].reshape(-1, 4):
        assert attitude_difference(q_CN, found.q_burn) < EXACT
    line = unit(rendezvous_scene.TARGET_AHEAD)
    assert boresight(flight, attitudes[-1, -1]) @ line > np.cos(np.deg2rad(0.1))
    assert found.cutoff - found.ignition > 5.0


def test_a_burn_too_long_for_the_limit_is_shortened(flight: FlightParams, known: OrbitEstimate) -> None:
    found = plan(push_hard, flight, known)
    np.testing.assert_allclose(np.linalg.norm(found.delta_v_N), 1e-3 * (found.cutoff - found.ignition), rtol=1e-12)
    assert 20.0 < found.cutoff - found.ignition < 110.0


def test_the_commanded_attitude_never_jumps_during_the_schedule(flight: FlightParams, known: OrbitEstimate) -> None:
    _, _, attitudes = simulate_plan(flight, known, plan(push_back, flight, known))
    flat = attitudes.reshape(-1, 4)
    steps = np.array([attitude_difference(q, p) for q, p in itertools.pairwise(flat)])
    peak = np.sqrt(2.0 * np.pi * 0.016 / np.pi)  # rad/s, twice the mean rate of the longest slew, half a turn
    assert steps.max() < peak / SAMPLES * 1.01


def test_without_a_burn_the_camera_stays_on_the_target(flight: FlightParams, known: OrbitEstimate) -> None:
    found = plan(push_gently, flight, known)
    _, modes, attitudes = simulate_plan(flight, known, found)
    assert set(modes.tolist()) == {Mode.LOOK}
    off = [boresight(flight, q) @ unit(rendezvous_scene.TARGET_AHEAD) for q in attitudes.reshape(-1, 4)]
    assert min(off) > np.cos(np.deg2rad(0.1))


# The search


def simulate_search(flight: FlightParams, position_sigma: float, ticks: int) -> tuple[np.ndarray, np.ndarray]:
    """Modes and commanded attitudes (ticks, samples, 4) of a search for a target that is never seen."""
    known = rendezvous_scene.estimate(flight, v_TS_N=np.zeros(3), position_sigma=position_sigma)
    state = attitude_guidance.initial_pointing(flight.vehicle, known)
    modes, commands, _ = simulate(
        flight, known, burn_planning.no_burn(), state, TIME + np.arange(float(ticks)), np.asarray(True)
    )
    return np.asarray(modes), np.asarray(commands.q_CN)


@pytest.mark.parametrize("radius_deg", [8.0, 20.0, 44.0])
def test_the_frames_of_a_search_cover_its_cone_without_gaps(flight: FlightParams, radius_deg: float) -> None:
    # The cone is three sigma of the bearing's uncertainty as guidance takes it, sqrt(2) of one axis.
    sigma = np.deg2rad(radius_deg) / 3.0 / np.sqrt(2.0) * 30.0
    modes, attitudes = simulate_search(flight, sigma, 300)
    assert np.all(modes[5:] == Mode.SEARCH)
    cameras = np.array([rotation_matrix(q) for q in attitudes[:, 0]])  # one frame a second
    line = unit(rendezvous_scene.TARGET_AHEAD)
    across = unit(np.cross(line, [0.0, 0.0, 1.0]))
    other = np.cross(line, across)
    rng = np.random.default_rng(1)
    # The last turn may end a pitch of 6.5 deg inside of the rim, and the view reaches 5 deg to each side.
    distance = np.deg2rad(radius_deg - 1.5) * np.sqrt(rng.uniform(size=1000))[:, None]
    around = rng.uniform(0.0, 2.0 * np.pi, (1000, 1))
    targets = np.cos(distance) * line + np.sin(distance) * (np.cos(around) * across + np.sin(around) * other)
    ahead, right, down = np.moveaxis(np.einsum("kij,nj->kni", cameras, targets), 2, 0)
    half = np.tan(np.deg2rad(5.0)) * ahead
    in_view = (ahead > 0.0) & (np.abs(right) < half) & (np.abs(down) < half)
    assert np.all(np.any(in_view, axis=0))
    farthest = np.rad2deg(np.arccos(np.clip(cameras[:, 0] @ line, -1.0, 1.0))).max()
    assert farthest < radius_deg + 3.0  # the step of a second, at the speed of the outer turns


def test_the_search_starts_after_the_wait_for_acquisition_and_later_after_the_patience(
    flight: FlightParams, known: OrbitEstimate
) -> None:
    # The first tick counts as the end of a slew, so a search begins one tick after the wait is over.
    modes, _ = simulate_search(flight, 3.0, 300)
    assert modes[:10].tolist() == [Mode.LOOK] * 4 + [Mode.SEARCH] * 6
    acquired = replace(attitude_guidance.initial_pointing(flight.vehicle, known), acquired=jnp.asarray(True))
    times = TIME + np.arange(300.0)
    later, _, _ = simulate(flight, known, burn_planning.no_burn(), acquired, times, np.asarray(True))
    assert np.asarray(later)[:70].tolist() == [Mode.LOOK] * 61 + [Mode.SEARCH] * 9


def test_a_search_ends_when_the_target_is_seen(flight: FlightParams, known: OrbitEstimate) -> None:
    state = attitude_guidance.initial_pointing(flight.vehicle, known)
    searching = replace(state, unseen_time=jnp.float64(99.0), search_time=jnp.float64(4.0))
    modes, _, accepted = simulate(
        flight, known, burn_planning.no_burn(), searching, TIME + np.arange(300.0), np.asarray(False)
    )
    assert accepted[0]
    assert np.all(np.asarray(modes) == Mode.LOOK)


def test_the_search_moves_no_faster_than_its_centripetal_acceleration_allows(flight: FlightParams) -> None:
    _, attitudes = simulate_search(flight, 30.0 * np.deg2rad(45.0), 300)
    settled = [boresight(flight, q) for q in attitudes[20:200].reshape(-1, 4)]
    rates = np.array([np.arccos(np.clip(a @ b, -1, 1)) for a, b in itertools.pairwise(settled)]) * SAMPLES
    # At radius r the spiral is flown at sqrt(a r) rad/s; 45 deg is the largest radius.
    assert rates.max() < 1.1 * np.sqrt(0.012 * np.deg2rad(45.0))


def test_the_target_counts_as_lost_before_acquisition_and_after_a_minute_unseen(
    flight: FlightParams, known: OrbitEstimate
) -> None:
    state = attitude_guidance.initial_pointing(flight.vehicle, known)
    assert bool(attitude_guidance.is_lost(flight.pointing, state))
    acquired = replace(state, acquired=jnp.asarray(True), recent_detections=jnp.float64(3.0))
    assert not bool(attitude_guidance.is_lost(flight.pointing, acquired))
    unseen = replace(acquired, unseen_time=jnp.float64(60.5))
    assert bool(attitude_guidance.is_lost(flight.pointing, unseen))


# What counts as seen


def look(
    flight: FlightParams,
    known: OrbitEstimate,
    frames: str,
    state: PointingState | None = None,
    plan: BurnPlan | None = None,
    visible: jax.Array = YES,
) -> PointingState:
    """State after frames with ('x') and without ('.') an accepted box."""
    state = attitude_guidance.initial_pointing(flight.vehicle, known) if state is None else state
    for tick, frame in enumerate(frames):
        accepted = np.asarray(frame == "x")
        state, _ = guide(
            flight.pointing,
            flight.vehicle,
            known,
            burn_planning.no_burn() if plan is None else plan,
            state,
            accepted,
            visible,
            TIME + tick,
            1.0,
        )
    return state


@pytest.mark.parametrize(
    ("frames", "seen"),
    [("x", False), ("xx", False), ("xxx", True), ("x.x.x", False), ("x.xx", True), ("x" + 19 * "." + "x", False)],
)
def test_one_box_may_be_false_but_three_in_a_row_are_the_target(
    flight: FlightParams, known: OrbitEstimate, frames: str, seen: bool
) -> None:
    state = look(flight, known, frames)
    assert bool(state.acquired) is seen
    assert bool(attitude_guidance.is_lost(flight.pointing, state)) is not seen


def test_sightings_fade_by_a_fifth_with_every_frame_that_looks_and_sees_nothing(
    flight: FlightParams, known: OrbitEstimate
) -> None:
    state = look(flight, known, "xxxx..")
    np.testing.assert_allclose(state.recent_detections, 4.0 * 0.8**2, rtol=1e-12)
    full = look(flight, known, 15 * "x")
    assert full.recent_detections == 10.0
    # From ten sightings on the target is doubted after the seventh empty frame, long before a search begins.
    assert not bool(attitude_guidance.is_lost(flight.pointing, look(flight, known, 6 * ".", full)))
    doubted = look(flight, known, 7 * ".", full)
    assert bool(attitude_guidance.is_lost(flight.pointing, doubted))
    assert bool(doubted.acquired)
    assert doubted.search_time == 0.0


def test_a_planned_look_away_forgets_no_sightings_and_counts_no_time(
    flight: FlightParams, known: OrbitEstimate
) -> None:
    away = replace(
        jax.tree.map(jnp.asarray, plan(push_back, flight, known)), turn_start=jnp.float64(0.0), cutoff=jnp.float64(1e6)
    )
    before = look(flight, known, "xxxx")
    after = look(flight, known, 20 * ".", before, away)
    assert after.recent_detections == before.recent_detections == 4.0
    assert after.unseen_time == 0.0


def test_a_single_box_keeps_the_camera_from_searching_for_five_seconds(
    flight: FlightParams, known: OrbitEstimate
) -> None:
    searching = replace(look(flight, known, ".."), unseen_time=jnp.float64(50.0), search_time=jnp.float64(4.0))
    once = look(flight, known, "x", searching)
    assert once.search_time == 0.0
    assert look(flight, known, 5 * ".", once).search_time == 0.0
    assert look(flight, known, 6 * ".", once).search_time > 0.0


def test_in_the_dark_nothing_is_searched_for_and_the_target_must_be_acquired_anew(
    flight: FlightParams, known: OrbitEstimate
) -> None:
    seen = look(flight, known, 5 * "x")
    assert bool(seen.acquired)
    dark = look(flight, known, ".", seen, visible=NO)
    assert (float(dark.recent_detections), float(dark.unseen_time), bool(dark.acquired)) == (0.0, 0.0, False)
    state = attitude_guidance.initial_pointing(flight.vehicle, known)
    times = TIME + np.arange(300.0)
    modes, commands, _ = simulate(flight, known, burn_planning.no_burn(), state, times, YES, NO)
    assert set(np.asarray(modes).tolist()) == {Mode.LOOK}
    off = [boresight(flight, q) @ unit(rendezvous_scene.TARGET_AHEAD) for q in np.asarray(commands.q_CN)[:, 0]]
    assert min(off) > np.cos(np.deg2rad(0.1))
    # The first light: a search only after the wait for acquisition.
    assert look(flight, known, "...", dark).search_time == 0.0
    assert look(flight, known, "....", dark).search_time > 0.0


def test_a_search_under_way_ends_at_sunset(flight: FlightParams, known: OrbitEstimate) -> None:
    searching = look(flight, known, 30 * ".")
    assert searching.search_time > 0.0
    dark = look(flight, known, ".", searching, visible=NO)
    assert (float(dark.search_time), float(dark.unseen_time)) == (0.0, 0.0)


def test_the_target_can_be_seen_in_the_light_unless_the_sun_is_behind_it_or_beside_the_view(
    flight: FlightParams, known: OrbitEstimate
) -> None:
    line, up = unit(rendezvous_scene.TARGET_AHEAD), unit(rendezvous_scene.R_SN_N)

    def seen(phase_deg: float) -> bool:
        """The Sun at an angle from the direction target to servicer, leaning to the zenith."""
        phase = np.deg2rad(phase_deg)
        sun = 1.5e11 * (-np.cos(phase) * line + np.sin(phase) * up)
        return bool(is_visible(flight.vehicle, known, sun))

    assert seen(90.0)
    assert seen(149.9)
    assert not seen(150.1)  # both limits: a crescent, and the Sun 30 deg from the view
    assert not bool(is_visible(flight.vehicle, known, rendezvous_scene.SUN_BEHIND_EARTH))


# Burns that are called off


@pytest.mark.parametrize(("degrees", "flown"), [(0.1, True), (2.9, True), (3.1, False), (5.0, False), (180.0, False)])
def test_no_thrust_while_the_attitude_is_further_from_the_burns_than_the_limit(
    flight: FlightParams, known: OrbitEstimate, degrees: float, flown: bool
) -> None:
    found = plan(push_back, flight, known)
    off = axis_angle_quaternion([0.3, -0.5, 0.8], np.deg2rad(degrees))
    q_BN = np.asarray(rendezvous_scene.quaternion.multiply(jnp.asarray(off), jnp.asarray(found.q_burn)))
    for sign in (1.0, -1.0):
        after = inhibit(flight.pointing, found, sign * q_BN, found.ignition - 0.5, 1.0)
        assert (float(after.cutoff) > float(after.ignition)) is flown
    if flown:
        jax.tree.map(np.testing.assert_array_equal, after, found)


def test_a_burn_called_off_halfway_keeps_what_was_flown_and_gives_no_more(
    flight: FlightParams, known: OrbitEstimate
) -> None:
    found = plan(push_back, flight, known)
    tumbling = np.asarray(
        rendezvous_scene.quaternion.multiply(
            jnp.asarray(axis_angle_quaternion([0.0, 0.0, 1.0], 0.1)), jnp.asarray(found.q_burn)
        )
    )
    halfway = found.ignition + 7.0
    after = inhibit(flight.pointing, found, tumbling, halfway, 1.0)
    assert (float(after.ignition), float(after.cutoff)) == (float(found.ignition), float(halfway))
    # No thrust later either, though the attitude is right again.
    later = inhibit(flight.pointing, after, found.q_burn, halfway + 1.0, 1.0)
    jax.tree.map(np.testing.assert_array_equal, later, after)


def test_the_way_back_from_a_burn_that_was_called_off_is_no_search(flight: FlightParams, known: OrbitEstimate) -> None:
    found = plan(push_back, flight, known)
    off = replace(found, cutoff=found.ignition)
    _, modes, _ = simulate_plan(flight, known, off)
    sequence = [Mode(mode) for mode, _ in itertools.groupby(modes)]
    assert sequence == [Mode.LOOK, Mode.TURN, Mode.TURN_BACK, Mode.LOOK]


def test_the_attitude_does_not_matter_long_before_a_burn_and_after_it(
    flight: FlightParams, known: OrbitEstimate
) -> None:
    found = plan(push_back, flight, known)
    elsewhere = np.asarray(look_attitude(flight.vehicle, known)[0])
    assert attitude_difference(elsewhere, found.q_burn) > 1.0
    for time in (found.ignition - 1.0, found.cutoff):
        after = inhibit(flight.pointing, found, elsewhere, time, 1.0)
        jax.tree.map(np.testing.assert_array_equal, after, found)
