"""Values of the messages of a run, checked as a ROS user would compute them."""

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from rpojax.core.pytree import replace
from rpojax.flight.mission.mission_state import AbortReason, Transition
from rpojax.flight.navigation import outline_correlation
from rpojax.flight.navigation.combined_orbit_filter import OrbitEstimate
from rpojax.flight.navigation.relative_filter_state import RelativeEstimate
from rpojax.flight.navigation.servicer_orbit_ekf import ServicerEstimate
from rpojax.interop.ros2 import message_builders, odometry
from rpojax.interop.ros2.message_builders import tick_messages
from rpojax.interop.ros2.message_values import MissionStatus, RosTickValues
from rpojax.interop.ros2.odometry import Odometry
from rpojax.interop.run_replay import ReplayedRun

MOTIONS = ("servicer", "relative", "target")


def axes(motion: Odometry) -> Rotation:
    """Rotation from child into parent components."""
    return Rotation.from_quat(np.asarray(motion.orientation))


@pytest.mark.parametrize("name", MOTIONS)
def test_twists_are_the_derivatives_of_poses(ros_run: ReplayedRun[RosTickValues], name: str) -> None:
    found: Odometry = getattr(ros_run.values, name)
    R = axes(found)
    velocity, position = R.apply(np.asarray(found.velocity)), np.asarray(found.position)
    # Over one second: the mean velocity of both ends, except for curvature.
    np.testing.assert_allclose(np.diff(position, axis=0), 0.5 * (velocity[1:] + velocity[:-1]), atol=2e-3)
    turn = (R[:-1].inv() * R[1:]).as_rotvec()
    rate = np.asarray(found.rate)
    np.testing.assert_allclose(turn, 0.5 * (rate[1:] + rate[:-1]), atol=2e-3)
    assert np.abs(rate).max() > 5e-3


def test_tf_frames_compose_to_the_odometries(ros_run: ReplayedRun[RosTickValues]) -> None:
    values, origin = ros_run.values, np.asarray(ros_run.values.target.position)
    R_NH = Rotation.from_quat(np.asarray(values.hill_orientation))
    place = origin + R_NH.apply(np.asarray(values.relative.position))
    np.testing.assert_allclose(place, values.servicer.position, atol=1e-8)
    for inner, outer in (
        (axes(values.relative), axes(values.servicer)),
        (Rotation.from_quat(values.target_in_hill), axes(values.target)),
    ):
        assert ((R_NH * inner) * outer.inv()).magnitude().max() < 1e-12
    # x radial outward, z along the orbit's normal.
    velocity = axes(values.target).apply(np.asarray(values.target.velocity))
    normal = np.cross(origin, velocity)
    for axis, along in ((0, origin), (2, normal)):
        unit = along / np.linalg.norm(along, axis=1, keepdims=True)
        np.testing.assert_allclose(R_NH.as_matrix()[:, :, axis], unit, atol=1e-12)


def test_true_poses_agree_with_the_recorded_poses(ros_run: ReplayedRun[RosTickValues]) -> None:
    q = ros_run.poses["q_BN"]
    np.testing.assert_array_equal(ros_run.values.servicer.orientation, np.concatenate([-q[:, 1:], q[:, :1]], axis=1))
    both = ros_run.poses["r_TN_N"] + ros_run.poses["r_ST_N"]
    np.testing.assert_array_equal(ros_run.values.servicer.position, both)


@pytest.mark.parametrize("name", ["servicer", "relative"])
def test_estimation_errors_are_consistent_with_their_covariance(ros_run: ReplayedRun[RosTickValues], name: str) -> None:
    true: Odometry = getattr(ros_run.values, name)
    estimate: Odometry = getattr(ros_run.values, f"{name}_estimate")
    place = np.asarray(estimate.position) - np.asarray(true.position)
    R = axes(estimate)
    # The filter cannot know the fixed misalignment of the star tracker, in body axes.
    turn_B = (R.inv() * axes(true)).as_rotvec()
    turn = R.apply(turn_B - turn_B.mean(axis=0))
    velocity = np.asarray(estimate.velocity) - R.inv().apply(axes(true).apply(np.asarray(true.velocity)))
    for error, P in (
        (place, estimate.pose_covariance[:, :3, :3]),
        (turn, estimate.pose_covariance[:, 3:, 3:]),
        (velocity, estimate.twist_covariance[:, :3, :3]),
    ):
        nees = np.einsum("ti,tij,tj->t", error, np.linalg.inv(P), error)
        # Expected 3; 180 correlated seconds spread widely, wrong axes or units by orders of magnitude.
        assert 0.1 < nees.mean() < 12.0
        np.testing.assert_allclose(P, np.swapaxes(P, 1, 2), atol=1e-14 * np.max(P))


def test_the_covariance_of_the_hill_frame_agrees_with_sampled_orbits() -> None:
    rng = np.random.default_rng(3)
    r, v = np.array([6.9e6, 3.0e5, -1.0e5]), np.array([-2.0e2, 5.5e3, 5.2e3])
    A = np.diag([400.0, 200.0, 300.0, 0.3, 0.5, 0.4]) @ rng.normal(size=(6, 6))
    P = A @ A.T
    orbit = OrbitEstimate(
        servicer=ServicerEstimate(
            r_SN_N=jnp.asarray(r), v_SN_N=jnp.asarray(v), gps_error_N=jnp.zeros(3), covariance=jnp.zeros((9, 9))
        ),
        relative=RelativeEstimate(
            r_TS_N=jnp.zeros(3),
            v_TS_N=jnp.zeros(3),
            slow={"size": jnp.zeros(2), "bearing_bias": jnp.zeros(2), "center_offset": jnp.zeros(2)},
            covariance=jnp.zeros((12, 12)).at[:6, :6].set(P),
            outline=outline_correlation.initial(),
        ),
    )
    found = odometry.target_frame_estimate(orbit)
    samples = np.concatenate([r, v]) + rng.normal(size=(20000, 6)) @ A.T
    places, speeds = samples[:, :3], samples[:, 3:]
    normal = np.cross(places, speeds)
    x, z = (each / np.linalg.norm(each, axis=1, keepdims=True) for each in (places, normal))
    R_NH = Rotation.from_matrix(np.stack([x, np.cross(z, x), z], axis=2))
    turn = (R_NH * axes(found).inv()).as_rotvec()
    # Velocity along the axes of the estimate; the rate about z is h / r^2.
    rate = (np.linalg.norm(normal, axis=1) / np.sum(places**2, axis=1))[:, None] * np.array([0.0, 0.0, 1.0])
    pose = np.cov(np.concatenate([places, turn], axis=1).T)
    twist = np.cov(np.concatenate([axes(found).inv().apply(speeds), rate], axis=1).T)
    for sampled, reported in ((pose, found.pose_covariance), (twist, found.twist_covariance)):
        scale = np.sqrt(np.maximum(np.diag(sampled), 1e-30))
        np.testing.assert_allclose(
            np.asarray(reported) / np.outer(scale, scale), sampled / np.outer(scale, scale), atol=0.05
        )
    np.testing.assert_allclose(found.rate, [0.0, 0.0, float(np.linalg.norm(np.cross(r, v)) / (r @ r))], atol=1e-15)


def test_calibration_mounting_and_attitude_project_the_box_onto_the_target(ros_run: ReplayedRun[RosTickValues]) -> None:
    values, view = ros_run.values, ros_run.values.camera
    seen = np.asarray(values.box_accepted)
    assert seen.sum() > 50
    ray = (np.asarray(view.box_center_px) - np.asarray(view.center_px)) / np.asarray(view.focal_px)[:, None]
    ray_K = np.concatenate([ray, np.ones((len(ray), 1))], axis=1)
    mounting = Rotation.from_quat(np.asarray(values.camera_in_body))
    ray_H = (axes(values.relative) * mounting).apply(ray_K)[seen]
    line = -np.asarray(values.relative.position)[seen]
    cosine = np.sum(ray_H * line, axis=1) / np.linalg.norm(ray_H, axis=1) / np.linalg.norm(line, axis=1)
    assert np.degrees(np.arccos(np.median(cosine))) < 0.5
    # The box is about as large as the 1 m target at that range.
    size = np.sqrt(np.prod(view.box_size_px, axis=1)) / view.focal_px
    assert 0.5 < np.median(size[seen] * np.linalg.norm(line, axis=1)) < 2.0


def test_measurements_have_errors_of_the_expected_size(ros_run: ReplayedRun[RosTickValues]) -> None:
    values = ros_run.values
    gps = np.linalg.norm(np.asarray(values.gps) - values.servicer.position, axis=1)
    stars = (Rotation.from_quat(values.star_tracker) * axes(values.servicer).inv()).magnitude()
    gyro = np.linalg.norm(np.asarray(values.gyro) - values.servicer.rate, axis=1)
    for error, largest in ((gps, 20.0), (stars, 0.01), (gyro, 1e-3)):
        assert 0.0 < error.min() < error.max() < largest
    assert values.gps_present.all()
    np.testing.assert_allclose(np.std(gyro) ** 2, values.gyro_variance[0], rtol=0.9)


def test_the_commanded_valve_times_are_those_of_the_velocity_change(ros_run: ReplayedRun[RosTickValues]) -> None:
    all_messages = [tick_messages(ros_run.tick(number)) for number in range(ros_run.ticks)]
    commands = [
        next(make() for topic, make in tick if topic.name == "/servicer/thruster/command") for tick in all_messages
    ]
    pending = [command for command in commands if command.points]
    assert 40 < len(pending) < ros_run.ticks
    times = {
        tuple(
            message_builders.NANOSECONDS_PER_S * (stamp.sec + each.sec) + stamp.nanosec + each.nanosec
            for each in (point.time_from_start for point in command.points)
        )
        for command in pending
        for stamp in [command.header.stamp]
    }
    [(opens, closes)] = times
    assert [point.effort.tolist() for point in pending[0].points] == [[float(ros_run.values.thrust[0])], [0.0]]
    increases = np.diff(np.asarray(ros_run.values.delta_v)) > 0.0
    begin = np.asarray(ros_run.values.time_s)[:-1] * message_builders.NANOSECONDS_PER_S
    np.testing.assert_array_equal(increases, (begin + message_builders.NANOSECONDS_PER_S > opens) & (begin < closes))
    # During the burn the opening lies before the stamp.
    assert increases[-1]
    assert pending[-1].points[0].time_from_start.sec < 0


@pytest.mark.parametrize(("ignition", "cutoff"), [(3, 3), (5, 5), (1, 2), (1, 3)])
def test_without_a_burn_and_after_it_there_are_no_points(ignition: int, cutoff: int) -> None:
    nano = message_builders.NANOSECONDS_PER_S
    assert message_builders.thruster_command(3 * nano, ignition * nano, cutoff * nano, 0.03).points == []


def test_a_burn_is_two_points_relative_to_the_stamp() -> None:
    command = message_builders.thruster_command(3_500_000_000, 3_000_000_000, 8_250_000_001, 0.03)
    points = [(each.effort.tolist(), each.time_from_start.sec, each.time_from_start.nanosec) for each in command.points]
    assert points == [([0.03], -1, 500_000_000), ([0.0], 4, 750_000_001)]


def test_diagnostics_tell_the_phase_of_a_mission_and_why_it_aborted(ros_run: ReplayedRun[RosTickValues]) -> None:
    tick = ros_run.tick(0)
    assert tick.mission is None
    assert [each.name for each in message_builders.diagnostics(0, tick).status][-1] == "servicer/propulsion"
    for phase, entered_by, reason, text, level in (
        (1, Transition.CONDITIONS_MET, AbortReason.NONE, "conditions met", 0),
        (3, Transition.ABORT, AbortReason.TARGET_LOST, "abort: target lost", 1),
    ):
        codes = {"phase": phase, "entered_by": int(entered_by), "abort_reason": int(reason)}
        status = MissionStatus(**{name: jnp.asarray(code) for name, code in codes.items()})
        found = message_builders.diagnostics(0, replace(tick, mission=status)).status[-1]
        assert (found.name, found.message, found.level) == ("servicer/mission", text, level)
        assert [(each.key, each.value) for each in found.values] == [
            ("phase", str(phase)),
            ("abort_reason", str(int(reason))),
        ]


def test_wheel_torques_follow_the_command_within_limits(ros_run: ReplayedRun[RosTickValues]) -> None:
    limit = np.asarray(ros_run.file.wheels.torque_limit_n_m)
    assert (np.abs(ros_run.values.wheel_command) <= limit * (1.0 + 1e-12)).all()
    np.testing.assert_array_equal(ros_run.values.wheel_torque, ros_run.values.wheel_command)
    assert np.ptp(np.asarray(ros_run.values.wheel_speed)) > 1.0
