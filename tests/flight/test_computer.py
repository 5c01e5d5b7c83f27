"""Flight computer: initial solution, expected velocity change, replaceable stages, darkness and failures."""

import re
import sys
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from types import FrameType

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import rendezvous_scene
from numpy_reference import IDENTITY, MU, axis_angle_quaternion, rotation_matrix, unit

import rpojax
from rpojax.core import quaternion
from rpojax.core.pytree import replace
from rpojax.errors import RpojaxError
from rpojax.flight import computer, tick_prediction
from rpojax.flight.control.formation_law import lqr_gain
from rpojax.flight.decisions import burn_decision
from rpojax.flight.decisions.motion_prediction import predict_to_burn
from rpojax.flight.flight_records import FlightMemory, FlightParams, Measurements
from rpojax.flight.guidance import target_pointing
from rpojax.flight.guidance.burn_schedule import BurnPlan
from rpojax.flight.guidance.lens_choice import BelievedWideLens, LensInUse
from rpojax.flight.guidance.pointing_modes import Mode
from rpojax.flight.navigation.attitude_ekf import AttitudeEstimate
from rpojax.flight.navigation.combined_orbit_filter import Innovation, OrbitEstimate
from rpojax.flight.navigation.orbit_measurements import BoxMeasurement, GpsMeasurement
from rpojax.flight.stages import Stages
from rpojax.flight.tick_prediction import MotionOnBoard

expected_delta_v = jax.jit(tick_prediction.expected_delta_v)


@partial(jax.jit, static_argnums=(1, 2))
def start(flight: FlightParams, period: float, stages: Stages, *initial_values: jax.Array) -> FlightMemory:
    """Initial memory, with a small camera."""
    return computer.initial(rendezvous_scene.software(flight, stages, formation_period_s=period), *initial_values)


@partial(jax.jit, static_argnums=0)
def plan_burn(
    stages: Stages, flight: FlightParams, memory: FlightMemory, sun_N: jax.Array, time: jax.Array
) -> BurnPlan:
    sight = target_pointing.point_at_target(flight.vehicle, memory.orbit, memory.pointing.reference.q_EN, sun_N)
    predicted = predict_to_burn(flight, memory.orbit)
    decision = burn_decision.Decision(time=time, memory=memory, predicted=predicted, pointing=sight)
    return burn_decision.plan_burn(rendezvous_scene.software(flight, stages), decision)[0]


@partial(jax.jit, static_argnums=0)
def navigate(
    stages: Stages,
    flight: FlightParams,
    memory: FlightMemory,
    measurements: Measurements,
    sun_N: jax.Array,
    time: jax.Array,
) -> tuple[FlightMemory, Innovation]:
    return computer.navigate(rendezvous_scene.software(flight, stages), memory, measurements, sun_N, time)


@jax.jit
def guide(
    flight: FlightParams, memory: FlightMemory, seen: jax.Array, sun_N: jax.Array, time: jax.Array
) -> tuple[FlightMemory, jax.Array]:
    return computer.guide(rendezvous_scene.software(flight), memory, seen, sun_N, time)


@partial(jax.jit, static_argnums=0)
def control_attitude(
    stages: Stages, flight: FlightParams, memory: FlightMemory, wheel_speed: jax.Array, age: jax.Array, time: jax.Array
) -> jax.Array:
    return computer.control_attitude(rendezvous_scene.software(flight, stages), memory, wheel_speed, age, time)


@jax.jit
def predict(flight: FlightParams, memory: FlightMemory, motion: MotionOnBoard, end: jax.Array) -> FlightMemory:
    return tick_prediction.predict(rendezvous_scene.software(flight), memory, motion, end)


@pytest.fixture(scope="module")
def memory(flight: FlightParams) -> FlightMemory:
    return start(flight, 200.0, Stages(), rendezvous_scene.estimate(flight), IDENTITY, np.zeros(3))


def acquired(memory: FlightMemory) -> FlightMemory:
    """Memory with the target acquired."""
    pointing = rendezvous_scene.with_acquisition(
        memory.pointing, acquired=jnp.asarray(True), recent_detections=jnp.float64(5.0)
    )
    return replace(memory, pointing=pointing)


def test_the_gain_is_for_the_targets_mean_motion_and_the_burn_period(
    flight: FlightParams, memory: FlightMemory
) -> None:
    n = np.sqrt(MU / np.linalg.norm(rendezvous_scene.R_SN_N) ** 3)
    expected = lqr_gain(flight.formation, jnp.float64(n), 200.0)
    np.testing.assert_allclose(
        memory.phase_gains[0][0], expected, rtol=1e-3
    )  # the target is 30 m ahead and slightly faster


def test_the_allocation_inverts_the_wheel_axes(flight: FlightParams) -> None:
    axes = np.array([[1.0, 0.0, 0.0], [0.6, 0.8, 0.0], [0.0, 0.6, 0.8]])
    skew = replace(flight, vehicle=replace(flight.vehicle, wheel_axes=jnp.asarray(axes)))
    memory = start(skew, 200.0, Stages(), rendezvous_scene.estimate(flight), IDENTITY, np.zeros(3))
    np.testing.assert_allclose(axes.T @ np.asarray(memory.wheel_allocation), np.eye(3), atol=1e-15)


def test_the_expected_velocity_changes_sum_to_the_whole_burn(flight: FlightParams, memory: FlightMemory) -> None:
    q_BN = axis_angle_quaternion([0.0, 0.0, 1.0], -np.pi / 2)  # body x lies along y of N
    burning = replace(memory, attitude=replace(memory.attitude, q_BN=jnp.asarray(q_BN)))
    begins = 0.2 * np.arange(60)
    parts = [np.asarray(expected_delta_v(flight, burning, 3.3 - begin, 8.75 - begin, 0.2)) for begin in begins]
    np.testing.assert_allclose(np.sum(parts, axis=0), [0.0, 1e-3 * (8.75 - 3.3), 0.0], atol=1e-15)
    np.testing.assert_array_equal(parts[0], np.zeros(3))
    np.testing.assert_allclose(parts[20], [0.0, 1e-3 * 0.2, 0.0], atol=1e-15)


def test_an_empty_burn_has_no_derivative_to_its_time(flight: FlightParams, memory: FlightMemory) -> None:
    def expected(time: jax.Array) -> jax.Array:
        return expected_delta_v(flight, memory, time, time, 0.2)

    for time in (0.0, 0.1, 0.2):  # on either border of the step, and within
        np.testing.assert_array_equal(jax.jacfwd(expected)(jnp.float64(time)), np.zeros(3))


def test_a_users_control_law_decides_the_burn(flight: FlightParams, memory: FlightMemory) -> None:
    def sideways(gain: jax.Array, deviation: jax.Array) -> jax.Array:
        return jnp.array([0.0, 0.0, 0.005])

    found = plan_burn(
        Stages(formation_law=sideways), flight, acquired(memory), rendezvous_scene.SUN_OVERHEAD, np.float64(0.0)
    )
    normal = np.cross(rendezvous_scene.R_SN_N, rendezvous_scene.V_SN_N)
    # The orbit is not quite a circle, so that the station itself takes some impulse.
    np.testing.assert_allclose(found.delta_v_N, 0.005 * normal / np.linalg.norm(normal), atol=5e-8)


def test_a_users_attitude_controller_commands_the_wheels(flight: FlightParams, memory: FlightMemory) -> None:
    def constant() -> jax.Array:
        return jnp.array([1e-3, 2e-3, 3e-3])

    found = control_attitude(
        Stages(wheel_torque=constant), flight, memory, np.zeros(3), np.float64(0.0), np.float64(0.0)
    )
    np.testing.assert_array_equal(found, [1e-3, 2e-3, 3e-3])


def test_a_users_attitude_filter_sees_time_and_orbit(flight: FlightParams, ready: FlightMemory) -> None:
    def patient(estimate: AttitudeEstimate, orbit: OrbitEstimate, time: jax.Array) -> AttitudeEstimate:
        near = jnp.sqrt(jnp.sum(orbit.relative.r_TS_N**2)) < 1e3
        return replace(estimate, omega_BN_B=jnp.where(near, time, -time) * jnp.ones(3))

    memory, _ = sense(flight, ready, stages=Stages(attitude_update=patient))
    np.testing.assert_array_equal(memory.attitude.omega_BN_B, np.full(3, 7.0))


@pytest.mark.parametrize(
    ("law", "found"),
    [
        (lambda deviation: deviation, "float64 of shape (6,) for the result, expected float64 of shape (3,)"),
        (lambda deviation: deviation[0], "float64 of shape () for the result, expected float64 of shape (3,)"),
        (lambda: jnp.zeros(3, jnp.float32), "float32 of shape (3,) for the result, expected float64 of shape (3,)"),
        (lambda: None, "a result of type NoneType, expected array"),
        (lambda deviation: deviation[:3] if deviation[0] > 0 else -deviation[:3], "Python's `if`, `float` or NumPy"),
        (lambda deviation: np.sin(deviation[:3]), "Python's `if`, `float` or NumPy"),
    ],
)
def test_other_results_of_a_users_stage_are_refused_by_name(
    flight: FlightParams, memory: FlightMemory, law: Callable[..., object], found: str
) -> None:
    with pytest.raises(RpojaxError, match=rf"^stages\.formation_law: found {re.escape(found)}"):
        plan_burn(Stages(formation_law=law), flight, memory, rendezvous_scene.SUN_OVERHEAD, np.float64(0.0))


def test_an_object_that_can_change_is_no_stage() -> None:
    @dataclass
    class Law:
        scale: float

        def __call__(self, deviation: jax.Array) -> jax.Array:
            return -self.scale * deviation[3:]

    with pytest.raises(RpojaxError, match=r"^stages\.formation_law: found a Law without a hash[^\n]*$"):
        Stages(formation_law=Law(1.0))


# Darkness and failed equipment


@pytest.fixture(scope="module")
def ready(flight: FlightParams) -> FlightMemory:
    """Memory with the target acquired by boxes that agree, known to 5 cm, and the camera on it."""
    known = rendezvous_scene.estimate(flight, position_sigma=0.05)
    q_KN = jnp.asarray(rendezvous_scene.camera_attitude(flight, known))
    q_KB = quaternion.normalize(flight.vehicle.camera_mounting)
    q_BN = quaternion.multiply(quaternion.conjugate(q_KB), q_KN)
    memory = acquired(start(flight, 200.0, Stages(), known, q_BN, np.zeros(3)))
    return replace(memory, gate=replace(memory.gate, supported_age=jnp.float64(1.0)))


def sense(
    flight: FlightParams,
    memory: FlightMemory,
    sun_N: np.ndarray = rendezvous_scene.SUN_OVERHEAD,
    pixels: float = 0.0,
    stars: bool = True,
    stages: Stages | None = None,
    is_wide: jax.Array | None = None,
) -> tuple[FlightMemory, Innovation]:
    """Memory after a tick whose box lies `pixels` beside the target, and whose other measurements are as expected.

    It is the seventh second.
    """
    R_KN = rotation_matrix(rendezvous_scene.camera_attitude(flight, memory.orbit))
    box: BoxMeasurement = rendezvous_scene.box(flight, R_KN, rendezvous_scene.TARGET_AHEAD)
    box = replace(box, tangent=box.tangent + jnp.array([pixels, 0.0]) / flight.vehicle.focal_px)
    measurements = Measurements(
        gps=GpsMeasurement(position_N=memory.orbit.servicer.r_SN_N, present=jnp.asarray(True)),
        star_tracker_q_BN=memory.attitude.q_BN,
        star_tracker_present=jnp.asarray(stars),
        box=box,
        is_wide=is_wide,
    )
    return navigate(stages or Stages(), flight, memory, measurements, sun_N, np.float64(7.0))


def test_a_late_box_has_the_beliefs_of_the_lens_of_its_exposure(flight: FlightParams, ready: FlightMemory) -> None:
    wide = BelievedWideLens(
        focal_px=0.4 * flight.vehicle.focal_px,
        switch_range=jnp.float64(1.0),
        return_range=jnp.float64(2.0),
        edge_noise=jnp.float64(9.0),
        misalignment_sigma=jnp.float64(2e-3),
    )
    two = replace(flight, wide_lens=wide)

    def after(is_wide: bool, was_wide: bool, of_box: bool | None) -> FlightMemory:
        lens = LensInUse(is_wide=jnp.asarray(is_wide), was_wide=jnp.asarray(was_wide))
        seen = None if of_box is None else jnp.asarray(of_box)
        memory, _ = sense(two, replace(ready, lens=lens), pixels=3.0, is_wide=seen)
        assert memory.lens is not None
        assert bool(memory.lens.is_wide) is is_wide
        assert bool(memory.lens.was_wide) is (is_wide if of_box is None else of_box)
        return memory

    # The camera looks through the wide lens by now, but this frame is older.
    late, at_once = after(True, False, False), after(False, False, None)
    np.testing.assert_array_equal(late.orbit.relative.covariance, at_once.orbit.relative.covariance)
    np.testing.assert_array_equal(late.orbit.relative.vector, at_once.orbit.relative.vector)
    # The misalignment comes with the first frame through the other lens, whenever that arrives.
    bias = late.orbit.relative.layout["bearing_bias"]

    def bias_variance(memory: FlightMemory) -> float:
        return float(jnp.trace(memory.orbit.relative.covariance[bias, bias]))

    first, second = after(True, False, True), after(True, True, True)
    assert bias_variance(first) > bias_variance(second)


def test_a_box_in_the_dark_is_neither_used_nor_rejected(flight: FlightParams, ready: FlightMemory) -> None:
    light, used = sense(flight, ready, pixels=3.0)
    assert bool(used.sensors["box"].accepted)
    assert np.linalg.norm(light.orbit.relative.r_TS_N - ready.orbit.relative.r_TS_N) > 0.01
    dark, unused = sense(flight, ready, rendezvous_scene.SUN_BEHIND_EARTH, pixels=3.0)
    assert not bool(unused.sensors["box"].accepted)
    assert not bool(unused.sensors["box"].rejected)
    np.testing.assert_array_equal(dark.orbit.relative.r_TS_N, ready.orbit.relative.r_TS_N)
    assert dark.gate.rejections == 0.0


def test_a_box_is_used_in_any_lit_direction_that_the_uncertain_estimate_allows(
    flight: FlightParams, ready: FlightMemory
) -> None:
    # By the estimate the Sun is near the line of sight.
    sun_N = 1.5e11 * unit(rendezvous_scene.TARGET_AHEAD + 0.2 * unit(rendezvous_scene.R_SN_N) * 30.0)
    for sigma, used in ((0.05, False), (20.0, True)):
        orbit = rendezvous_scene.estimate(flight, position_sigma=sigma)
        q_KN = rendezvous_scene.camera_attitude(flight, orbit)
        box = rendezvous_scene.box(flight, rotation_matrix(q_KN), rendezvous_scene.TARGET_AHEAD)
        memory = replace(ready, orbit=orbit)
        filtered = jax.jit(computer.filtered_box)(flight, memory, jnp.zeros(()), box, jnp.asarray(sun_N))
        assert bool(filtered.present) is used, sigma


def push(gain: jax.Array, deviation: jax.Array) -> jax.Array:
    """20 mm/s backwards along the track."""
    return jnp.array([0.0, -0.02, 0.0])


def burns(
    flight: FlightParams, memory: FlightMemory, sun_N: np.ndarray = rendezvous_scene.SUN_OVERHEAD, time: float = 0.0
) -> bool:
    """True if a burn is planned at `time` [s]."""
    found = plan_burn(Stages(formation_law=push), flight, memory, sun_N, np.float64(time))
    return float(found.cutoff) > float(found.ignition)


def test_burns_are_planned_only_for_an_acquired_target_in_the_light(flight: FlightParams, ready: FlightMemory) -> None:
    assert burns(flight, ready)
    assert not burns(flight, ready, rendezvous_scene.SUN_BEHIND_EARTH)
    unseen = replace(
        ready,
        pointing=rendezvous_scene.with_acquisition(
            ready.pointing, recent_detections=jnp.zeros(()), acquired=jnp.asarray(False)
        ),
    )
    for boxes, allowed in ((1, False), (2, False), (3, True)):
        memory = unseen
        for tick in range(boxes):
            memory, _ = guide(flight, memory, np.asarray(True), rendezvous_scene.SUN_OVERHEAD, np.float64(tick))
        assert burns(flight, memory) is allowed, boxes


@pytest.mark.parametrize(("sigma", "allowed"), [(5.9, True), (6.1, False)])
def test_there_is_no_burn_while_the_range_is_less_certain_than_a_fifth(
    flight: FlightParams, ready: FlightMemory, sigma: float, allowed: bool
) -> None:
    uncertain = rendezvous_scene.estimate(flight, position_sigma=sigma)
    near = replace(flight, health=replace(flight.health, clearance=jnp.float64(0.05)))
    near = replace(near, mission=replace(flight.mission, keep_out=jnp.ones(3)))
    assert burns(near, replace(ready, orbit=uncertain)) is allowed


def test_in_the_dark_the_camera_points_at_the_estimate(flight: FlightParams, ready: FlightMemory) -> None:
    memory, modes = ready, set()
    for tick in range(80):
        memory, mode = guide(flight, memory, np.asarray(False), rendezvous_scene.SUN_BEHIND_EARTH, np.float64(tick))
        modes.add(int(mode))
    assert modes == {Mode.LOOK}
    assert memory.pointing.acquisition.unseen_time == 0.0


@pytest.mark.parametrize(
    ("searched_s", "smallest_px", "reopened"), [(1e6, 1.0, True), (0.0, 1.0, False), (1e6, 1e4, False)]
)
def test_guidance_says_when_it_widens_the_estimate_after_a_failed_search(
    flight: FlightParams, ready: FlightMemory, searched_s: float, smallest_px: float, reopened: bool
) -> None:
    """A target that may be too small to be seen is not looked for in vain."""
    flight = replace(flight, navigation=replace(flight.navigation, minimum_size=jnp.asarray(smallest_px)))
    unseen = rendezvous_scene.with_acquisition(
        replace(ready.pointing, search_time=jnp.float64(searched_s)),
        acquired=jnp.asarray(False),
        unseen_time=jnp.float64(1e3),
    )
    searching = replace(ready, pointing=unseen)
    for sees in (False, True):
        after, _ = guide(flight, searching, np.asarray(sees), rendezvous_scene.SUN_OVERHEAD, np.float64(0.0))
        before, variance = (np.trace(each.orbit.relative.covariance[:3, :3]) for each in (searching, after))
        assert bool(after.reopened) is (reopened and not sees)
        np.testing.assert_allclose(variance / before, 2.0 if after.reopened else 1.0)
        searching = after


def test_a_burn_is_inhibited_by_the_estimated_attitude(flight: FlightParams, ready: FlightMemory) -> None:
    plan = plan_burn(Stages(formation_law=push), flight, ready, rendezvous_scene.SUN_OVERHEAD, np.float64(0.0))
    planned = replace(ready, plan=plan)
    ignition = float(planned.plan.ignition)
    for degrees, fired in ((0.1, True), (5.0, False)):
        off = jnp.asarray(axis_angle_quaternion([1.0, 0.0, 0.0], np.deg2rad(degrees)))
        q_BN = quaternion.multiply(off, planned.plan.q_burn)
        aiming = replace(planned, attitude=replace(planned.attitude, q_BN=q_BN))
        after, _ = guide(flight, aiming, np.asarray(False), rendezvous_scene.SUN_OVERHEAD, np.float64(ignition))
        expected = sum(
            np.asarray(expected_delta_v(flight, after, after.plan.ignition - begin, after.plan.cutoff - begin, 1.0))
            for begin in np.arange(0.0, 199.0)
        )
        assert (np.linalg.norm(expected) > 0.019) is np.bool_(fired)
        if not fired:
            np.testing.assert_array_equal(expected, np.zeros(3))


def test_without_stars_the_bearing_bias_variance_grows_as_the_attitude_variance(
    flight: FlightParams, ready: FlightMemory
) -> None:
    def bias_variance(memory: FlightMemory) -> np.ndarray:
        return np.diag(np.asarray(memory.orbit.relative.covariance))[8:10]

    memory = ready
    for tick in range(60):
        memory = carry(flight, memory, end=tick + 1.0)
        memory, _ = sense(flight, memory, rendezvous_scene.SUN_BEHIND_EARTH, stars=False)  # no box helps either
    grown = bias_variance(memory) - bias_variance(ready)
    turned = np.asarray(memory.attitude.covariance - ready.attitude.covariance)
    across = np.diag(turned)[1:3]  # the camera looks along x
    np.testing.assert_allclose(grown, across.mean(), rtol=1e-9)
    # 0.003 deg/s of gyro bias for a minute, 0.0025 deg/sqrt(s) of random walk, less the initial uncertainty.
    np.testing.assert_allclose(np.sqrt(across), np.deg2rad(np.hypot(0.18, 0.0025 * np.sqrt(60.0))), rtol=0.01)
    # The bias learnt under drift is as wrong when the star tracker returns.
    back, _ = sense(flight, memory, rendezvous_scene.SUN_BEHIND_EARTH)
    np.testing.assert_allclose(bias_variance(back) - bias_variance(ready), 2.0 * grown, rtol=0.01)


def carry(
    flight: FlightParams,
    memory: FlightMemory,
    delta_v_N: np.ndarray | None = None,
    ratio: float | None = 1.0,
    end: float = 1.0,
) -> FlightMemory:
    """Memory a second later, with expected `delta_v_N` [m/s] and chamber pressure over nominal `ratio`, if measured."""
    delta_v_N = np.zeros(3) if delta_v_N is None else delta_v_N
    q_BN = memory.attitude.q_BN
    motion = MotionOnBoard(
        q_BN_before=q_BN,
        delta_v_N=jnp.asarray(delta_v_N),
        thrust_ratio=None if ratio is None else jnp.float64(ratio),
        third_body_acceleration_N=jnp.zeros(3),
        sun_N=jnp.asarray(rendezvous_scene.SUN_BEHIND_EARTH),
    )
    return predict(flight, memory, motion, np.float64(end))


BURN = np.array([6e-4, 0.0, 8e-4])  # thrust of one second


# Calibration 1.5 %, 1 % of change in a second, pressure sensor 3 %: the gain of the first pressure, by hand.
FIRST_GAIN = (0.015**2 + 0.01**2) / (0.015**2 + 0.01**2 + 0.03**2)
BROKEN_GAIN = 1.0 / (1.0 + 0.03**2)


@pytest.mark.parametrize(
    ("ratio", "thrust_ratio"),
    [
        (1.0, 1.0),
        (1.1, 1.0 + 0.1 * FIRST_GAIN),
        (0.9, 1.0 - 0.1 * FIRST_GAIN),
        (0.6, 1.0 - 0.4 * BROKEN_GAIN),
        (0.0, 1.0 - BROKEN_GAIN),
    ],
)
def test_the_chamber_pressure_corrects_the_expected_velocity_change(
    flight: FlightParams, ready: FlightMemory, ratio: float, thrust_ratio: float
) -> None:
    coasting = carry(flight, ready)
    burning = carry(flight, ready, BURN, ratio)
    gained = np.asarray(burning.orbit.servicer.v_SN_N - coasting.orbit.servicer.v_SN_N)
    # The displacement in that second changes gravity: n^2 times a third of a millimetre, 4e-10 m/s.
    np.testing.assert_allclose(gained, thrust_ratio * BURN, atol=1e-9)
    closed = np.asarray(burning.orbit.relative.v_TS_N - coasting.orbit.relative.v_TS_N)
    np.testing.assert_allclose(closed, -thrust_ratio * BURN, atol=1e-9)


def test_a_slightly_low_thrust_is_estimated_within_a_burn(flight: FlightParams, ready: FlightMemory) -> None:
    memory = ready
    for _ in range(8):
        memory = carry(flight, memory, BURN, 0.92)
    np.testing.assert_allclose(memory.thrust_estimate.ratio, 0.92, atol=0.01)
    assert 0.01 < np.sqrt(memory.thrust_estimate.variance) < 0.02
    np.testing.assert_array_equal(
        carry(flight, memory, None, 0.5).thrust_estimate.ratio, memory.thrust_estimate.ratio
    )  # no burn


def test_thrust_estimated_from_the_pressure_alone_inflates_the_burn_covariance(
    flight: FlightParams, ready: FlightMemory
) -> None:
    planned = replace(ready, plan=replace(ready.plan, delta_v_N=jnp.array([0.0, 0.0, 0.02])))
    along = BURN / 1e-3

    def added(ratio: float) -> float:
        burning, coasting = carry(flight, planned, BURN, ratio), carry(flight, planned)
        change = np.asarray(burning.orbit.relative.covariance - coasting.orbit.relative.covariance)[3:6, 3:6]
        return float(along @ change @ along)

    thrust_ratio = 1.0 - 0.5 * BROKEN_GAIN
    inflation = 0.03 * np.sqrt(BROKEN_GAIN) / (1.2 * 0.015)
    np.testing.assert_allclose(added(1.0), 1e-3 * 0.02 * 0.015**2, rtol=1e-6)
    np.testing.assert_allclose(
        added(0.5), (thrust_ratio * 1e-3) * (thrust_ratio * 0.02) * (inflation * 0.015) ** 2, rtol=1e-6
    )


def test_without_a_pressure_sensor_the_belief_in_one_changes_nothing(flight: FlightParams, ready: FlightMemory) -> None:
    planned = replace(ready, plan=replace(ready.plan, delta_v_N=jnp.array([0.0, 0.0, 0.02])))

    def burnt(pressure_noise: float, ratio: float | None) -> FlightMemory:
        tuning = replace(flight.navigation, pressure_noise=jnp.asarray(pressure_noise), thrust_walk=jnp.asarray(0.1))
        memory = planned
        for _ in range(3):
            memory = carry(replace(flight, navigation=tuning), memory, BURN, ratio)
        return memory

    fine, coarse = burnt(0.03, None), burnt(1.0, None)
    np.testing.assert_array_equal(fine.orbit.relative.covariance, coarse.orbit.relative.covariance)
    np.testing.assert_array_equal(fine.thrust_estimate.variance, flight.navigation.thrust_sigma**2)
    # A sensor as bad as that leaves the random walk of the thrust, and so a less certain burn.
    assert burnt(1.0, 1.0).orbit.relative.covariance[3, 3] > fine.orbit.relative.covariance[3, 3]


def test_after_a_burn_without_thrust_no_burn_is_planned_until_the_retry(
    flight: FlightParams, ready: FlightMemory
) -> None:
    assert np.isneginf(ready.thruster_failed_at)
    failed = carry(flight, ready, BURN, 0.0, end=61.0)
    assert float(failed.thruster_failed_at) == 61.0
    assert not burns(flight, failed, time=200.0)
    assert not burns(flight, failed, time=1060.9)
    assert burns(flight, failed, time=1061.0)
    weak = carry(flight, ready, BURN, 0.5, end=61.0)
    assert burns(flight, weak, time=200.0)
    idle = carry(flight, ready, None, 0.0, end=61.0)  # without a burn the pressure is not used
    assert burns(flight, idle, time=200.0)


def test_the_path_of_a_box_on_the_page_is_that_of_the_calls(flight: FlightParams, ready: FlightMemory) -> None:
    """Every file of the path calls another one of it, up to the correction of the states; boxes go by no others."""
    page = (Path(__file__).parents[2] / "docs" / "reference" / "architecture.md").read_text(encoding="utf-8")
    [listed] = re.findall(r"path from a box to the state, in the order of the calls:\n(.*?)\.\n5\.", page, re.S)
    path = re.findall(r"`([a-z_/]+\.py)`", listed)
    assert len(path) <= 9
    package = str(Path(rpojax.__file__).parent) + "/"
    calls: set[tuple[str, str, str]] = set()

    def is_between(file: str) -> bool:
        """Whether a file is of another package, such as the checks of types, or of calls of replaceable stages."""
        return not file.startswith(package) or file.endswith(("flight/stages.py", "core/named_arguments.py"))

    def note(frame: FrameType, event: str, _: object) -> None:
        called, caller = frame.f_code, frame.f_back
        if event != "call" or is_between(called.co_filename):
            return
        while caller and is_between(caller.f_code.co_filename):
            caller = caller.f_back
        if caller:
            files = (code.co_filename.removeprefix(package) for code in (caller.f_code, called))
            calls.add((*files, called.co_name))

    before = sys.getprofile()
    sys.setprofile(note)
    try:
        sense(flight, ready, stages=Stages(wheel_torque=lambda: jnp.zeros(3)))
    finally:
        sys.setprofile(before)
    edges = {(caller, called) for caller, called, _ in calls}
    assert [called for called in path[3:] if not any((caller, called) in edges for caller in path)] == []
    assert ("flight/navigation/relative_orbit_ekf.py", path[-1], "corrected") in calls
    of_boxes = {called for _, called in edges if called.startswith("flight/navigation/box_measurement/")}
    assert of_boxes - {"flight/navigation/box_measurement/detection_model.py"} <= set(path)
