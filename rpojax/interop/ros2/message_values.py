"""What messages say of one tick: every value in the frame, order and unit that its message asks for."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from rpojax.core import quaternion
from rpojax.core.frames import apply, hill_frame, inertial_to_hill
from rpojax.core.pytree import pytree
from rpojax.flight import computer
from rpojax.flight.computer import Stages
from rpojax.flight.navigation.attitude_ekf import AttitudeEstimate
from rpojax.flight.navigation.orbit_filter import OrbitEstimate
from rpojax.interop.ros2.frame_names import block_diagonal, orientation_from_quaternion, rotate_covariance
from rpojax.physics import equipment_faults, plant
from rpojax.scenario.params import Params
from rpojax.scenario.scenario_file import Scenario
from rpojax.sensors import rendered_camera
from rpojax.simulation.closed_loop import Telemetry

Vector = Float[Array, "3"]
Matrix = Float[Array, "3 3"]


@pytree
class Odometry:
    """Motion of a child frame in its parent, as `nav_msgs/Odometry` has it.

    Attributes:
        position: (3,) [m] in the parent
        orientation: (4,) x, y, z, w of the child in the parent
        velocity: (3,) [m/s] seen in the parent, along the child's axes
        rate: (3,) [rad/s] relative to the parent, along the child's axes
        pose_covariance: (6, 6) of position and small rotation, in the parent's axes
        twist_covariance: (6, 6) of velocity and rate, in the child's axes
    """

    position: Array
    orientation: Array
    velocity: Array
    rate: Array
    pose_covariance: Array
    twist_covariance: Array


@pytree
class CameraFrame:
    """The picture of a tick as an image of its own, and the detector's box in it.

    The origin of pixels is the corner of the top left one, as detectors count.

    Attributes:
        size_px: (2,) width and height, int32
        focal_px: () as flight software knows it
        center_px: (2,) principal point
        box_center_px: (2,)
        box_size_px: (2,) width and height
        score: () of the box, 0..1
        present: () bool, there is a box
    """

    size_px: Array
    focal_px: Array
    center_px: Array
    box_center_px: Array
    box_size_px: Array
    score: Array
    present: Array


@pytree
class RosTickValues:
    """Everything that is said of a tick.

    Attributes:
        time_s: () from the start of the run [s]
        servicer: true motion of B in N
        relative: true motion of B in H
        target: true motion of T in N
        servicer_estimate: of B in N
        relative_estimate: of B in H
        target_estimate: of H in N
        hill_orientation: (4,) x, y, z, w of the true H in N
        target_in_hill: (4,) x, y, z, w of T in H
        camera_in_body: (4,) x, y, z, w of K in B, as flight software knows it
        gps: (3,) measured position in N [m]
        gps_present: () bool
        star_tracker: (4,) measured x, y, z, w of B in N
        star_tracker_present: () bool
        gyro: (3,) last sample in B [rad/s]
        gyro_variance: () of a sample per axis, as flight software knows it [rad^2/s^2]
        wheel_speed: (3,) [rad/s]
        wheel_torque: (3,) that the motors give [N m]
        wheel_command: (3,) [N m]
        ignition_s: () of the burn decided last, from the start of the run [s]
        cutoff_s: () of it [s]
        thrust: () that flight software counts on [N]
        view: the picture and the box
        accepted: () bool, the orbit filter used the box
        mode: () guidance mode
        delta_v: () applied so far [m/s]
        mass: () of the servicer [kg]
        running: () bool, the run had not failed
    """

    time_s: Array
    servicer: Odometry
    relative: Odometry
    target: Odometry
    servicer_estimate: Odometry
    relative_estimate: Odometry
    target_estimate: Odometry
    hill_orientation: Array
    target_in_hill: Array
    camera_in_body: Array
    gps: Array
    gps_present: Array
    star_tracker: Array
    star_tracker_present: Array
    gyro: Array
    gyro_variance: Array
    wheel_speed: Array
    wheel_torque: Array
    wheel_command: Array
    ignition_s: Array
    cutoff_s: Array
    thrust: Array
    camera: CameraFrame
    box_accepted: Array
    guidance_mode: Array
    delta_v: Array
    mass: Array
    running: Array


def observe_tick(stages: Stages, scenario: Scenario, params: Params, telemetry: Telemetry) -> RosTickValues:
    """Values of one tick."""
    truth, flight, measurements = telemetry.truth, telemetry.flight, telemetry.measurements
    time = telemetry.tick.astype(jnp.float64) * scenario.tick_s
    R_HN, omega_HN_N = hill_frame(truth.r_TN_N, truth.v_TN_N)
    q_HN = quaternion.from_matrix(R_HN)
    zero = jnp.zeros((), dtype=jnp.float64)
    wheel_command = computer.control_attitude(stages, params.flight, flight, truth.wheel_speed, zero)
    gyro_noise = gyro_variance(scenario, params)
    q_KB = quaternion.normalize(params.flight.vehicle.camera_mounting)
    rho, rho_dot = inertial_to_hill(truth.r_ST_N, truth.v_ST_N, R_HN, omega_HN_N)
    omega_BH_B = truth.omega_BN_B - quaternion.rotate(truth.q_BN, omega_HN_N)
    r_SN_N, v_SN_N = truth.r_TN_N + truth.r_ST_N, truth.v_TN_N + truth.v_ST_N
    return RosTickValues(
        time_s=time,
        servicer=_true_odometry(r_SN_N, truth.q_BN, v_SN_N, truth.omega_BN_B),
        relative=_true_odometry(rho, _relative_quaternion(truth.q_BN, q_HN), rho_dot, omega_BH_B),
        target=_true_odometry(truth.r_TN_N, truth.q_TN, truth.v_TN_N, truth.omega_TN_T),
        servicer_estimate=_servicer_estimate(telemetry, gyro_noise),
        relative_estimate=_relative_estimate(telemetry, gyro_noise),
        target_estimate=target_frame_estimate(flight.orbit),
        hill_orientation=orientation_from_quaternion(q_HN),
        target_in_hill=orientation_from_quaternion(_relative_quaternion(truth.q_TN, q_HN)),
        camera_in_body=orientation_from_quaternion(q_KB),
        gps=measurements.gps.position_N,
        gps_present=measurements.gps.present,
        star_tracker=orientation_from_quaternion(measurements.star_tracker_q_BN),
        star_tracker_present=measurements.star_tracker_present,
        gyro=flight.attitude.gyro_B,
        gyro_variance=gyro_noise,
        wheel_speed=truth.wheel_speed,
        wheel_torque=_motor_torque(scenario, params, telemetry, wheel_command, time),
        wheel_command=wheel_command,
        ignition_s=flight.plan.ignition,
        cutoff_s=flight.plan.cutoff,
        thrust=params.flight.vehicle.thrust,
        camera=_camera_frame(scenario, params, telemetry),
        box_accepted=telemetry.innovation.accepted,
        guidance_mode=telemetry.mode,
        delta_v=truth.delta_v,
        mass=truth.mass,
        running=telemetry.running,
    )


def _relative_quaternion(q_CA: Float[Array, "4"], q_BA: Float[Array, "4"]) -> Float[Array, "4"]:
    """`q_CB`."""
    return quaternion.multiply(q_CA, quaternion.conjugate(q_BA))


def _true_odometry(position: Vector, q: Float[Array, "4"], velocity: Vector, rate: Vector) -> Odometry:
    """A motion without doubt; `velocity` [m/s] comes along the parent's axes, `rate` [rad/s] along the child's."""
    zero = jnp.zeros((6, 6), dtype=position.dtype)
    return Odometry(
        position=position,
        orientation=orientation_from_quaternion(q),
        velocity=quaternion.rotate(q, velocity),
        rate=rate,
        pose_covariance=zero,
        twist_covariance=zero,
    )


def estimated_odometry(
    position: Vector,
    q_BA: Float[Array, "4"],
    velocity: Vector,
    rate: Vector,
    orbit_covariance: Float[Array, "6 6"],
    attitude_covariance: Matrix,
    rate_covariance: Matrix,
) -> Odometry:
    """Estimated motion of a body B in A.

    Position [m], velocity [m/s] and their covariance come in A, rate [rad/s] and the covariances of attitude [rad^2]
    and rate in B. What position and velocity have in common has no place in the message. The velocity is given along
    the axes of the estimated body, so a reader who turns it back gets that in A with its covariance, and the error of
    the attitude plays no part.
    """
    R = quaternion.to_matrix(q_BA)
    return Odometry(
        position=position,
        orientation=orientation_from_quaternion(q_BA),
        velocity=apply(R, velocity),
        rate=rate,
        pose_covariance=block_diagonal(orbit_covariance[:3, :3], rotate_covariance(R.T, attitude_covariance)),
        twist_covariance=block_diagonal(rotate_covariance(R, orbit_covariance[3:, 3:]), rate_covariance),
    )


def gyro_variance(scenario: Scenario, params: Params) -> Array:
    """Variance () of a gyro sample per axis, as flight software knows it [rad^2/s^2]."""
    return params.flight.attitude_filter.angle_random_walk**2 / scenario.step_s


def rate_covariance(attitude: AttitudeEstimate, gyro_variance: Array) -> Matrix:
    """Covariance [rad^2/s^2] of the estimated rate: a gyro sample less its estimated bias."""
    P = attitude.covariance
    return P[3:, 3:] + gyro_variance * jnp.eye(3, dtype=P.dtype)


def _servicer_estimate(telemetry: Telemetry, gyro_noise: Array) -> Odometry:
    orbit, attitude = telemetry.flight.orbit.servicer, telemetry.flight.attitude
    return estimated_odometry(
        orbit.r_SN_N,
        attitude.q_BN,
        orbit.v_SN_N,
        attitude.omega_BN_B,
        orbit.covariance[:6, :6],
        attitude.covariance[:3, :3],
        rate_covariance(attitude, gyro_noise),
    )


def _relative_estimate(telemetry: Telemetry, gyro_noise: Array) -> Odometry:
    """Servicer in the Hill frame that flight software works out of its estimate; the frame's own error is left out.

    A metre beside the target's orbit turns the frame by 1e-7 rad, and moves the servicer by some micrometres.
    """
    orbit, attitude = telemetry.flight.orbit, telemetry.flight.attitude
    r_ST_N, v_ST_N = -orbit.relative.r_TS_N, -orbit.relative.v_TS_N
    R_HN, omega_HN_N = hill_frame(orbit.servicer.r_SN_N - r_ST_N, orbit.servicer.v_SN_N - v_ST_N)
    rho, rho_dot = inertial_to_hill(r_ST_N, v_ST_N, R_HN, omega_HN_N)
    return estimated_odometry(
        rho,
        _relative_quaternion(attitude.q_BN, quaternion.from_matrix(R_HN)),
        rho_dot,
        attitude.omega_BN_B - quaternion.rotate(attitude.q_BN, omega_HN_N),
        hill_covariance(R_HN, omega_HN_N, orbit.relative.covariance[:6, :6]),
        attitude.covariance[:3, :3],
        rate_covariance(attitude, gyro_noise),
    )


def hill_covariance(R_HN: Matrix, omega_HN_N: Vector, P_N: Float[Array, "6 6"]) -> Float[Array, "6 6"]:
    """Covariance of (rho, rho_dot) from that of relative position and inertial velocity in N."""

    def seen(state: Float[Array, "6"]) -> Float[Array, "6"]:
        return jnp.concatenate(inertial_to_hill(state[:3], state[3:], R_HN, omega_HN_N))

    jacobian = jax.jacfwd(seen)(jnp.zeros(6, dtype=P_N.dtype))
    return jacobian @ P_N @ jacobian.T


def target_frame_estimate(orbit: OrbitEstimate) -> Odometry:
    """The target's estimated Hill frame in N: its place, and its axes, which are sure only as far as the orbit is."""
    P = orbit.servicer.covariance[:6, :6] + orbit.relative.covariance[:6, :6]
    r_TN_N = orbit.servicer.r_SN_N + orbit.relative.r_TS_N
    v_TN_N = orbit.servicer.v_SN_N + orbit.relative.v_TS_N
    R_HN, omega_HN_N = hill_frame(r_TN_N, v_TN_N)

    def turn_and_rate(state: Float[Array, "6"]) -> tuple[Vector, Vector]:
        R, omega = hill_frame(state[:3], state[3:])
        S = R_HN.T @ R
        # Axes turned by a small rotation phi give the matrix 1 - [phi x] in these axes.
        return jnp.stack([S[1, 2], S[2, 0], S[0, 1]]), apply(R, omega)

    rotation_jacobian, rate_jacobian = jax.jacfwd(turn_and_rate)(jnp.concatenate([r_TN_N, v_TN_N]))
    pose_jacobian = jnp.concatenate([jnp.eye(3, 6, dtype=P.dtype), rotation_jacobian], axis=0)
    twist_jacobian = jnp.concatenate(
        [jnp.concatenate([jnp.zeros((3, 3), dtype=P.dtype), R_HN], axis=1), rate_jacobian], axis=0
    )
    return Odometry(
        position=r_TN_N,
        orientation=orientation_from_quaternion(quaternion.from_matrix(R_HN)),
        velocity=apply(R_HN, v_TN_N),
        rate=apply(R_HN, omega_HN_N),
        pose_covariance=pose_jacobian @ P @ pose_jacobian.T,
        twist_covariance=twist_jacobian @ P @ twist_jacobian.T,
    )


def _motor_torque(scenario: Scenario, params: Params, telemetry: Telemetry, command: Vector, time: Array) -> Vector:
    effects = scenario.effects
    health = equipment_faults.health_at(params.plant.fault, time) if effects.faults else equipment_faults.healthy()
    return plant.motor_torque(effects, params.plant.wheels, telemetry.truth, command, health, scenario.step_s)


def _camera_frame(scenario: Scenario, params: Params, telemetry: Telemetry) -> CameraFrame:
    frame = telemetry.frame
    middle = jnp.array([0.5 * scenario.width_px, 0.5 * scenario.height_px], dtype=jnp.float64)
    if scenario.camera_model == "rendered":
        side = rendered_camera.input_side(scenario.width_px, scenario.height_px)
        size = (side, side)
        corner, binning = frame.window[:2], frame.window[2] / side
    else:
        size = (scenario.width_px, scenario.height_px)
        corner, binning = jnp.zeros(2, dtype=jnp.float64), jnp.ones((), dtype=jnp.float64)
    low, high = frame.box.edges[:2], frame.box.edges[2:]
    return CameraFrame(
        size_px=jnp.array(size, dtype=jnp.int32),
        focal_px=params.flight.vehicle.focal_px / binning,
        center_px=(middle - corner) / binning,
        box_center_px=(0.5 * (low + high) - corner) / binning,
        box_size_px=(high - low) / binning,
        score=frame.score,
        present=frame.box.present,
    )
