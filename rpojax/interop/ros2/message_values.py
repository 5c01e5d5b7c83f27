"""Values of all messages of one tick, computed from telemetry in the frames, order and units of ROS 2."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from rpojax.core import quaternion
from rpojax.core.frames import hill_frame, inertial_to_hill
from rpojax.core.pytree import pytree
from rpojax.flight import computer
from rpojax.flight.mission.mission_state import MissionState
from rpojax.flight.stages import Stages
from rpojax.interop.ros2.odometry import (
    Odometry,
    orientation_from_quaternion,
    relative_estimate,
    relative_quaternion,
    servicer_estimate,
    target_frame_estimate,
    true_odometry,
)
from rpojax.interop.ros2.target_pose import TargetPose, target_pose
from rpojax.physics import equipment_faults, forces_and_torques
from rpojax.physics.plant_state import Truth
from rpojax.scenario.params import Params
from rpojax.scenario.static_settings import Scenario
from rpojax.sensors import detector_input
from rpojax.simulation.state import elapsed_time
from rpojax.simulation.telemetry import Telemetry
from rpojax.simulation.tick import Loop

Vector = Float[Array, "3"]
Matrix = Float[Array, "3 3"]
Quaternion = Float[Array, "4"]


@pytree
class DetectorImage:
    """The image that the detector gets, its calibration and the detected box.

    The pixel origin is the corner of the top left pixel.

    Attributes:
        size_px: (2,) width and height, int32
        focal_px: () as flight software knows it
        center_px: (2,) principal point
        distortion: (5,) coefficients of the lens as flight software knows them, zeros of a pinhole
        box_center_px: (2,)
        box_size_px: (2,) width and height
        score: () of the box, 0..1
        present: () bool, there is a box
    """

    size_px: Array
    focal_px: Array
    center_px: Array
    distortion: Array
    box_center_px: Array
    box_size_px: Array
    score: Array
    present: Array


@pytree
class MissionStatus:
    """Status of a mission with phases.

    Attributes:
        phase: () int32, number of the phase in the scenario from 0; then those of holding and after an abort
        entered_by: () int32, a `Transition`
        abort_reason: () int32, an `AbortReason`
    """

    phase: Array
    entered_by: Array
    abort_reason: Array


@pytree
class RosTickValues:
    """Values of the messages of one tick.

    Attributes:
        time_s: () from the start of the run [s]
        servicer: true odometry of B in N
        relative: true odometry of B in H
        target: true odometry of T in N
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
        wheel_torque: (3,) applied by the motors [N m]
        wheel_command: (3,) [N m]
        ignition_s: () of the last planned burn, from the start of the run [s]
        cutoff_s: () of the last planned burn, from the start of the run [s]
        thrust: () assumed by flight software [N]
        camera: image and box
        box_accepted: () bool, the orbit filter used the box
        guidance_mode: () code of the mode
        delta_v: () applied so far [m/s]
        mass: () of the servicer [kg]
        mission: its present phase, what began that, and the reason of an abort, None without phases
        target_pose: estimated, of T in K, None without landmarks
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
    camera: DetectorImage
    box_accepted: Array
    guidance_mode: Array
    delta_v: Array
    mass: Array
    mission: MissionStatus | None = None
    target_pose: TargetPose | None = None


def observe_tick(stages: Stages, scenario: Scenario, params: Params, telemetry: Telemetry) -> RosTickValues:
    """Message values of one tick."""
    truth, flight, measurements = telemetry.truth, telemetry.flight, telemetry.measurements
    time = elapsed_time(scenario, truth, telemetry.tick)
    R_HN, omega_HN_N = hill_frame(truth.r_TN_N, truth.v_TN_N)
    q_HN = quaternion.from_matrix(R_HN)
    zero = jnp.zeros((), dtype=jnp.float64)
    software = Loop(scenario, params, stages).software
    wheel_command = computer.control_attitude(software, flight, truth.wheel_speed, zero, time)
    gyro_noise = gyro_variance(scenario, params)
    q_KB = quaternion.normalize(params.flight.vehicle.camera_mounting)
    servicer, relative, target = _true_odometries(truth, R_HN, omega_HN_N, q_HN)
    return RosTickValues(
        time_s=time,
        servicer=servicer,
        relative=relative,
        target=target,
        servicer_estimate=servicer_estimate(flight.orbit, flight.attitude, gyro_noise),
        relative_estimate=relative_estimate(flight.orbit, flight.attitude, gyro_noise),
        target_estimate=target_frame_estimate(flight.orbit),
        hill_orientation=orientation_from_quaternion(q_HN),
        target_in_hill=orientation_from_quaternion(relative_quaternion(truth.q_TN, q_HN)),
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
        camera=_detector_image(scenario, params, telemetry),
        box_accepted=telemetry.innovation.sensors["box"].accepted,
        guidance_mode=telemetry.mode,
        delta_v=truth.delta_v,
        mass=truth.mass,
        mission=_mission_status(flight.mission) if scenario.mission.is_managed else None,
        target_pose=target_pose(flight.orbit.relative, quaternion.multiply(q_KB, flight.attitude.q_BN)),
    )


def _mission_status(mission: MissionState) -> MissionStatus:
    return MissionStatus(phase=mission.phase, entered_by=mission.entered_by, abort_reason=mission.abort_reason)


def _true_odometries(
    truth: Truth, R_HN: Matrix, omega_HN_N: Vector, q_HN: Quaternion
) -> tuple[Odometry, Odometry, Odometry]:
    """True odometry of B in N, B in H and T in N."""
    rho, rho_dot = inertial_to_hill(truth.r_ST_N, truth.v_ST_N, R_HN, omega_HN_N)
    omega_BH_B = truth.omega_BN_B - quaternion.rotate(truth.q_BN, omega_HN_N)
    r_SN_N, v_SN_N = truth.r_TN_N + truth.r_ST_N, truth.v_TN_N + truth.v_ST_N
    return (
        true_odometry(r_SN_N, truth.q_BN, v_SN_N, truth.omega_BN_B),
        true_odometry(rho, relative_quaternion(truth.q_BN, q_HN), rho_dot, omega_BH_B),
        true_odometry(truth.r_TN_N, truth.q_TN, truth.v_TN_N, truth.omega_TN_T),
    )


def gyro_variance(scenario: Scenario, params: Params) -> Array:
    """Variance () of a gyro sample per axis, as flight software knows it [rad^2/s^2]."""
    return params.flight.attitude_filter.angle_random_walk**2 / scenario.step_s


def _motor_torque(scenario: Scenario, params: Params, telemetry: Telemetry, command: Vector, time: Array) -> Vector:
    effects = scenario.effects
    health = equipment_faults.health_at(params.plant.faults, time) if effects.faults else equipment_faults.healthy()
    return forces_and_torques.motor_torque(
        effects, params.plant.wheels, telemetry.truth, command, health, scenario.step_s
    )


def _detector_image(scenario: Scenario, params: Params, telemetry: Telemetry) -> DetectorImage:
    frame = telemetry.frame
    frame_center = jnp.array([0.5 * scenario.width_px, 0.5 * scenario.height_px], dtype=jnp.float64)
    if scenario.camera_model == "rendered":
        side = detector_input.input_side(scenario.width_px, scenario.height_px)
        size = (side, side)
        corner, binning = frame.window[:2], frame.window[2] / side
    else:
        size = (scenario.width_px, scenario.height_px)
        corner, binning = jnp.zeros(2, dtype=jnp.float64), jnp.ones((), dtype=jnp.float64)
    low, high = frame.box.edges[:2], frame.box.edges[2:]
    vehicle = params.flight.seen_through(telemetry.flight.lens).vehicle
    return DetectorImage(
        size_px=jnp.array(size, dtype=jnp.int32),
        focal_px=vehicle.focal_px / binning,
        center_px=(frame_center - corner) / binning,
        distortion=jnp.zeros(5) if vehicle.distortion is None else vehicle.distortion,
        box_center_px=(0.5 * (low + high) - corner) / binning,
        box_size_px=(high - low) / binning,
        score=frame.score,
        present=frame.box.present,
    )
