"""Builders of ROS 2 messages from arrays; pure functions."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from typing import Any

import cv2
import numpy as np
from jaxtyping import Array

from rpojax.flight.guidance.pointing_modes import Mode
from rpojax.flight.mission.mission_state import AbortReason, Transition
from rpojax.interop.ros2 import topics
from rpojax.interop.ros2.message_types import message_class
from rpojax.interop.ros2.message_values import DetectorImage, MissionStatus, RosTickValues
from rpojax.interop.ros2.odometry import Odometry
from rpojax.interop.ros2.target_pose import TargetPose
from rpojax.interop.ros2.topics import CAMERA, ECI, HILL, SERVICER, TARGET, Topic

Numbers = Array | np.ndarray
"""An array on the host or on a device."""

NANOSECONDS_PER_S = 1_000_000_000
WHEEL_JOINTS = ("wheel_1", "wheel_2", "wheel_3")
THRUSTER_JOINT = "thruster"
TARGET_CLASS_ID = "target"

_MODE_NAMES = {
    Mode.LOOK: "look",
    Mode.TURN: "turn",
    Mode.BURN: "burn",
    Mode.TURN_BACK: "turn back",
    Mode.SEARCH: "search",
}
_EMPTY = np.zeros(0)
TopicMessages = Iterable[tuple[Topic, Callable[[], Any]]]
"""Topics, each with a function that builds its message, called only where the message is needed."""


def nanoseconds(time_s: float) -> int:
    """Simulation time [s] in whole nanoseconds."""
    return round(float(time_s) * NANOSECONDS_PER_S)


def time_message(time_ns: int) -> Any:
    """`builtin_interfaces/Time` of a time [ns]."""
    return message_class("builtin_interfaces/msg/Time")(
        sec=time_ns // NANOSECONDS_PER_S, nanosec=time_ns % NANOSECONDS_PER_S
    )


def duration_message(time_ns: int) -> Any:
    """`builtin_interfaces/Duration` of a time [ns]; a negative one has negative seconds and positive nanoseconds."""
    return message_class("builtin_interfaces/msg/Duration")(
        sec=time_ns // NANOSECONDS_PER_S, nanosec=time_ns % NANOSECONDS_PER_S
    )


def header_message(time_ns: int, frame: str) -> Any:
    """`std_msgs/Header` of a time [ns] in a frame."""
    return message_class("std_msgs/msg/Header")(stamp=time_message(time_ns), frame_id=frame)


def clock_message(time_ns: int) -> Any:
    """`rosgraph_msgs/Clock` at a time [ns]."""
    return message_class("rosgraph_msgs/msg/Clock")(clock=time_message(time_ns))


def vector_message(values: Numbers) -> Any:
    """`geometry_msgs/Vector3`."""
    x, y, z = values.tolist()
    return message_class("geometry_msgs/msg/Vector3")(x=x, y=y, z=z)


def point_message(values: Numbers) -> Any:
    """`geometry_msgs/Point`."""
    x, y, z = values.tolist()
    return message_class("geometry_msgs/msg/Point")(x=x, y=y, z=z)


def quaternion_message(xyzw: Numbers) -> Any:
    """`geometry_msgs/Quaternion` of a ROS orientation (x, y, z, w)."""
    x, y, z, w = xyzw.tolist()
    return message_class("geometry_msgs/msg/Quaternion")(x=x, y=y, z=z, w=w)


def pose_with_covariance(position: Numbers, orientation: Numbers, covariance: Numbers) -> Any:
    """`geometry_msgs/PoseWithCovariance`; position [m], orientation (x, y, z, w), covariance (6, 6)."""
    pose = message_class("geometry_msgs/msg/Pose")(
        position=point_message(position), orientation=quaternion_message(orientation)
    )
    return message_class("geometry_msgs/msg/PoseWithCovariance")(
        pose=pose, covariance=np.ascontiguousarray(covariance).reshape(36)
    )


def target_pose(time_ns: int, pose: TargetPose) -> Any:
    """`geometry_msgs/PoseWithCovarianceStamped` of the target in the camera."""
    return message_class("geometry_msgs/msg/PoseWithCovarianceStamped")(
        header=header_message(time_ns, CAMERA),
        pose=pose_with_covariance(pose.position, pose.orientation, pose.covariance),
    )


def odometry(time_ns: int, frame: str, child: str, motion: Odometry) -> Any:
    """`nav_msgs/Odometry` of a child frame in a frame."""
    twist = message_class("geometry_msgs/msg/Twist")(
        linear=vector_message(motion.velocity), angular=vector_message(motion.rate)
    )
    return message_class("nav_msgs/msg/Odometry")(
        header=header_message(time_ns, frame),
        child_frame_id=child,
        pose=pose_with_covariance(motion.position, motion.orientation, motion.pose_covariance),
        twist=message_class("geometry_msgs/msg/TwistWithCovariance")(
            twist=twist, covariance=np.ascontiguousarray(motion.twist_covariance).reshape(36)
        ),
    )


def transform(time_ns: int, frame: str, child: str, position: Numbers, orientation: Numbers) -> Any:
    """`geometry_msgs/TransformStamped` of a child frame in a frame; position [m], orientation (x, y, z, w)."""
    return message_class("geometry_msgs/msg/TransformStamped")(
        header=header_message(time_ns, frame),
        child_frame_id=child,
        transform=message_class("geometry_msgs/msg/Transform")(
            translation=vector_message(position), rotation=quaternion_message(orientation)
        ),
    )


def tf_message(transforms: Sequence[Any]) -> Any:
    """`tf2_msgs/TFMessage` of transforms."""
    return message_class("tf2_msgs/msg/TFMessage")(transforms=list(transforms))


def vehicle_transforms(time_ns: int, values: RosTickValues) -> Any:
    """`tf2_msgs/TFMessage` of the true Hill frame in `eci`, and of both vehicles in the Hill frame."""
    return tf_message(
        [
            transform(time_ns, ECI, HILL, values.target.position, values.hill_orientation),
            transform(time_ns, HILL, SERVICER, values.relative.position, values.relative.orientation),
            transform(time_ns, HILL, TARGET, np.zeros(3), values.target_in_hill),
        ]
    )


def camera_transform(time_ns: int, values: RosTickValues) -> Any:
    """`tf2_msgs/TFMessage` of the camera in the servicer body, as flight software knows it."""
    return tf_message([transform(time_ns, SERVICER, CAMERA, np.zeros(3), values.camera_in_body)])


def gps(time_ns: int, position: Numbers) -> Any:
    """`geometry_msgs/PointStamped` of a measured position [m] in `eci`."""
    return message_class("geometry_msgs/msg/PointStamped")(
        header=header_message(time_ns, ECI), point=point_message(position)
    )


def star_tracker(time_ns: int, orientation: Numbers) -> Any:
    """`geometry_msgs/QuaternionStamped` of the measured orientation (x, y, z, w) of the servicer in `eci`."""
    return message_class("geometry_msgs/msg/QuaternionStamped")(
        header=header_message(time_ns, ECI), quaternion=quaternion_message(orientation)
    )


def imu(time_ns: int, rate: Numbers, variance: float) -> Any:
    """`sensor_msgs/Imu` of a gyro sample [rad/s] with its variance per axis [rad^2/s^2]; all else is marked absent."""
    absent = np.array([-1.0, *[0.0] * 8])
    return message_class("sensor_msgs/msg/Imu")(
        header=header_message(time_ns, SERVICER),
        orientation=quaternion_message(np.array([0.0, 0.0, 0.0, 1.0])),
        orientation_covariance=absent,
        angular_velocity=vector_message(rate),
        angular_velocity_covariance=variance * np.eye(3).reshape(9),
        linear_acceleration=vector_message(np.zeros(3)),
        linear_acceleration_covariance=absent,
    )


def wheel_state(time_ns: int, speed: Numbers, torque: Numbers) -> Any:
    """`sensor_msgs/JointState` of wheel speeds [rad/s] and torques [N m]; an unknown one is an empty array."""
    return message_class("sensor_msgs/msg/JointState")(
        header=header_message(time_ns, ""), name=list(WHEEL_JOINTS), position=_EMPTY, velocity=speed, effort=torque
    )


def wheel_command(time_ns: int, torque: Numbers) -> Any:
    """`sensor_msgs/JointState` of torque commands [N m] as effort."""
    return wheel_state(time_ns, _EMPTY, torque)


def thruster_command(time_ns: int, ignition_ns: int, cutoff_ns: int, thrust: float) -> Any:
    """`trajectory_msgs/JointTrajectory` of a burn: opening and closing of the valve, relative to the stamp.

    `thrust` [N] is the effort while the valve is open. There are no points without a burn and after its end. During a
    burn the opening lies before the stamp.
    """
    valve_switches = [(ignition_ns, thrust), (cutoff_ns, 0.0)]
    pending = cutoff_ns > max(ignition_ns, time_ns)
    return message_class("trajectory_msgs/msg/JointTrajectory")(
        header=header_message(time_ns, SERVICER),
        joint_names=[THRUSTER_JOINT],
        points=[_valve_point(at - time_ns, force) for at, force in valve_switches] if pending else [],
    )


def _valve_point(time_ns: int, force: float) -> Any:
    return message_class("trajectory_msgs/msg/JointTrajectoryPoint")(
        positions=_EMPTY,
        velocities=_EMPTY,
        accelerations=_EMPTY,
        effort=np.array([force], dtype=np.float64),
        time_from_start=duration_message(time_ns),
    )


def camera_info(time_ns: int, detector_image: DetectorImage) -> Any:
    """`sensor_msgs/CameraInfo` of an image, with the lens as flight software knows it."""
    width, height = detector_image.size_px.tolist()
    (x, y), f = detector_image.center_px.tolist(), float(detector_image.focal_px)
    return message_class("sensor_msgs/msg/CameraInfo")(
        header=header_message(time_ns, CAMERA),
        height=height,
        width=width,
        distortion_model="plumb_bob",
        d=np.asarray(detector_image.distortion, dtype=np.float64),
        k=np.array([f, 0.0, x, 0.0, f, y, 0.0, 0.0, 1.0]),
        r=np.eye(3).reshape(9),
        p=np.array([f, 0.0, x, 0.0, 0.0, f, y, 0.0, 0.0, 0.0, 1.0, 0.0]),
        binning_x=0,
        binning_y=0,
        roi=message_class("sensor_msgs/msg/RegionOfInterest")(
            x_offset=0, y_offset=0, height=0, width=0, do_rectify=False
        ),
    )


def image(time_ns: int, pixels: np.ndarray) -> Any:
    """`sensor_msgs/Image` of an image (h, w, 3), uint8 sRGB codes."""
    height, width, _ = pixels.shape
    return message_class("sensor_msgs/msg/Image")(
        header=header_message(time_ns, CAMERA),
        height=height,
        width=width,
        encoding="rgb8",
        is_bigendian=0,
        step=3 * width,
        data=np.ascontiguousarray(pixels).reshape(-1),
    )


def compressed_image(time_ns: int, pixels: np.ndarray) -> Any:
    """`sensor_msgs/CompressedImage` of an image (h, w, 3), uint8 sRGB codes, as PNG, without loss."""
    _, data = cv2.imencode(".png", cv2.cvtColor(pixels, cv2.COLOR_RGB2BGR))
    return message_class("sensor_msgs/msg/CompressedImage")(
        header=header_message(time_ns, CAMERA), format="rgb8; png compressed bgr8", data=data.reshape(-1)
    )


def detections(time_ns: int, detector_image: DetectorImage) -> Any:
    """`vision_msgs/Detection2DArray` of the detected box, empty without one."""
    found = [_detection(time_ns, detector_image)] if detector_image.present else []
    return message_class("vision_msgs/msg/Detection2DArray")(header=header_message(time_ns, CAMERA), detections=found)


def _detection(time_ns: int, detector_image: DetectorImage) -> Any:
    (x, y), (width, height) = detector_image.box_center_px.tolist(), detector_image.box_size_px.tolist()
    center = message_class("vision_msgs/msg/Pose2D")(
        position=message_class("vision_msgs/msg/Point2D")(x=x, y=y), theta=0.0
    )
    # A box has no pose in space; the field keeps its default.
    undefined_pose = pose_with_covariance(np.zeros(3), np.array([0.0, 0.0, 0.0, 1.0]), np.zeros((6, 6)))
    hypothesis = message_class("vision_msgs/msg/ObjectHypothesis")(
        class_id=TARGET_CLASS_ID, score=float(detector_image.score)
    )
    return message_class("vision_msgs/msg/Detection2D")(
        header=header_message(time_ns, CAMERA),
        results=[message_class("vision_msgs/msg/ObjectHypothesisWithPose")(hypothesis=hypothesis, pose=undefined_pose)],
        bbox=message_class("vision_msgs/msg/BoundingBox2D")(center=center, size_x=width, size_y=height),
        id="",
    )


def diagnostics(time_ns: int, values: RosTickValues) -> Any:
    """`diagnostic_msgs/DiagnosticArray`: guidance mode, use of the box, consumption, phase of the mission."""
    box_status = "accepted" if values.box_accepted else "rejected" if values.camera.present else "none"
    mode = _MODE_NAMES[Mode(int(values.guidance_mode))]
    level = "WARN" if mode == "search" else "OK"
    consumption = {"delta_v_m_s": float(values.delta_v), "mass_kg": float(values.mass)}
    return message_class("diagnostic_msgs/msg/DiagnosticArray")(
        header=header_message(time_ns, ""),
        status=[
            _status(level, "servicer/guidance", mode, {}),
            _status("WARN" if box_status == "rejected" else "OK", "servicer/navigation", f"box {box_status}", {}),
            _status("OK", "servicer/propulsion", "", consumption),
            *([] if values.mission is None else [_mission_status(values.mission)]),
        ],
    )


def _mission_status(mission: MissionStatus) -> Any:
    """Phase by its number, what began it, and the reason of an abort."""
    reason = AbortReason(int(mission.abort_reason))
    text = Transition(int(mission.entered_by)).text + (f": {reason.text}" if reason else "")
    numbers = {"phase": int(mission.phase), "abort_reason": int(reason)}
    return _status("WARN" if reason else "OK", "servicer/mission", text, numbers)


def _status(level: str, name: str, text: str, values: Mapping[str, float | int]) -> Any:
    status_class, key_value_class = (
        message_class("diagnostic_msgs/msg/DiagnosticStatus"),
        message_class("diagnostic_msgs/msg/KeyValue"),
    )
    return status_class(
        level=getattr(status_class, level),
        name=name,
        message=text,
        hardware_id="servicer",
        values=[key_value_class(key=key, value=repr(value)) for key, value in values.items()],
    )


def tick_messages(values: RosTickValues, published: Iterable[Topic] = topics.ALL_TOPICS) -> TopicMessages:
    """Messages of one tick on the `published` topics, in that order; without images and messages sent once."""
    builders = _message_builders(nanoseconds(float(values.time_s)), values)
    return [(topic, builders[topic]) for topic in published if topic in builders]


def _message_builders(time_ns: int, values: RosTickValues) -> dict[Topic, Callable[[], Any]]:
    """Builder of the message of each topic that has one in this tick."""
    builders: dict[Topic, Callable[[], Any]] = {
        topics.CLOCK: lambda: clock_message(time_ns),
        topics.TF: lambda: vehicle_transforms(time_ns, values),
        **_odometry_builders(time_ns, values),
    }
    pose = values.target_pose
    if pose is not None and pose.known:
        builders[topics.TARGET_POSE] = lambda: target_pose(time_ns, pose)
    if values.gps_present:
        builders[topics.GPS] = lambda: gps(time_ns, values.gps)
    if values.star_tracker_present:
        builders[topics.STAR_TRACKER] = lambda: star_tracker(time_ns, values.star_tracker)
    return builders | {
        topics.IMU: lambda: imu(time_ns, values.gyro, float(values.gyro_variance)),
        topics.WHEELS: lambda: wheel_state(time_ns, values.wheel_speed, values.wheel_torque),
        topics.WHEEL_COMMAND: lambda: wheel_command(time_ns, values.wheel_command),
        topics.THRUSTER_COMMAND: lambda: _pending_burn(time_ns, values),
        topics.CAMERA_INFO: lambda: camera_info(time_ns, values.camera),
        topics.DETECTIONS: lambda: detections(time_ns, values.camera),
        topics.DIAGNOSTICS: lambda: diagnostics(time_ns, values),
    }


def _odometry_builders(time_ns: int, values: RosTickValues) -> dict[Topic, Callable[[], Any]]:
    motions = {
        topics.SERVICER_TRUTH: values.servicer,
        topics.RELATIVE_TRUTH: values.relative,
        topics.TARGET_TRUTH: values.target,
        topics.SERVICER_ESTIMATE: values.servicer_estimate,
        topics.RELATIVE_ESTIMATE: values.relative_estimate,
        topics.TARGET_ESTIMATE: values.target_estimate,
    }
    return {
        topic: partial(odometry, time_ns, topic.frame_id, topic.child_frame_id, motion)
        for topic, motion in motions.items()
    }


def _pending_burn(time_ns: int, values: RosTickValues) -> Any:
    ignition_ns = nanoseconds(float(values.ignition_s))
    cutoff_ns = nanoseconds(float(values.cutoff_s))
    return thruster_command(time_ns, ignition_ns, cutoff_ns, float(values.thrust))
