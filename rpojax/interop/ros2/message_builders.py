"""Messages from values: pure builders, and all that is said of a tick with the topic on which it is said."""

from collections.abc import Callable, Iterable, Sequence
from functools import partial
from typing import Any

import cv2
import numpy as np
from jaxtyping import Array

from rpojax.flight.guidance.pointing_modes import Mode
from rpojax.interop.ros2 import topics
from rpojax.interop.ros2.frame_names import CAMERA, ECI, HILL, SERVICER, TARGET
from rpojax.interop.ros2.message_types import message_class
from rpojax.interop.ros2.message_values import Motion, TickValues, View
from rpojax.interop.ros2.topics import Topic

Said = Iterable[tuple[Topic, Callable[[], Any]]]
"""Topics, each with what makes its message where somebody listens."""
Values = Array | np.ndarray
"""Numbers of a tick, wherever they are."""

NANO = 1_000_000_000
WHEELS = ("wheel_1", "wheel_2", "wheel_3")
VALVE = "thruster"
TARGET_CLASS = "target"

_MODES = {Mode.LOOK: "look", Mode.TURN: "turn", Mode.BURN: "burn", Mode.TURN_BACK: "turn back", Mode.SEARCH: "search"}
_NONE = np.zeros(0)


def nanoseconds(time_s: float) -> int:
    """Simulation time [s] in whole nanoseconds."""
    return round(float(time_s) * NANO)


def time_message(nanos: int) -> Any:
    """`builtin_interfaces/Time` of a time [ns]."""
    return message_class("builtin_interfaces/msg/Time")(sec=nanos // NANO, nanosec=nanos % NANO)


def duration(nanos: int) -> Any:
    """`builtin_interfaces/Duration` of a time [ns]; a negative one has negative seconds and positive nanoseconds."""
    return message_class("builtin_interfaces/msg/Duration")(sec=nanos // NANO, nanosec=nanos % NANO)


def header(nanos: int, frame: str) -> Any:
    """`std_msgs/Header` of a time [ns] in a frame."""
    return message_class("std_msgs/msg/Header")(stamp=time_message(nanos), frame_id=frame)


def clock(nanos: int) -> Any:
    """`rosgraph_msgs/Clock` at a time [ns]."""
    return message_class("rosgraph_msgs/msg/Clock")(clock=time_message(nanos))


def vector(values: Values) -> Any:
    """`geometry_msgs/Vector3`."""
    x, y, z = values.tolist()
    return message_class("geometry_msgs/msg/Vector3")(x=x, y=y, z=z)


def point(values: Values) -> Any:
    """`geometry_msgs/Point`."""
    x, y, z = values.tolist()
    return message_class("geometry_msgs/msg/Point")(x=x, y=y, z=z)


def quaternion(xyzw: Values) -> Any:
    """`geometry_msgs/Quaternion` of a ROS orientation (x, y, z, w)."""
    x, y, z, w = xyzw.tolist()
    return message_class("geometry_msgs/msg/Quaternion")(x=x, y=y, z=z, w=w)


def odometry(nanos: int, frame: str, child: str, motion: Motion) -> Any:
    """`nav_msgs/Odometry` of a child frame in a frame."""
    pose = message_class("geometry_msgs/msg/Pose")(
        position=point(motion.position), orientation=quaternion(motion.orientation)
    )
    twist = message_class("geometry_msgs/msg/Twist")(linear=vector(motion.velocity), angular=vector(motion.rate))
    return message_class("nav_msgs/msg/Odometry")(
        header=header(nanos, frame),
        child_frame_id=child,
        pose=message_class("geometry_msgs/msg/PoseWithCovariance")(
            pose=pose, covariance=np.ascontiguousarray(motion.pose_covariance).reshape(36)
        ),
        twist=message_class("geometry_msgs/msg/TwistWithCovariance")(
            twist=twist, covariance=np.ascontiguousarray(motion.twist_covariance).reshape(36)
        ),
    )


def transform(nanos: int, frame: str, child: str, position: Values, orientation: Values) -> Any:
    """`geometry_msgs/TransformStamped` of a child frame in a frame; position [m], orientation (x, y, z, w)."""
    return message_class("geometry_msgs/msg/TransformStamped")(
        header=header(nanos, frame),
        child_frame_id=child,
        transform=message_class("geometry_msgs/msg/Transform")(
            translation=vector(position), rotation=quaternion(orientation)
        ),
    )


def tf(transforms: Sequence[Any]) -> Any:
    """`tf2_msgs/TFMessage` of some transforms."""
    return message_class("tf2_msgs/msg/TFMessage")(transforms=list(transforms))


def moving_frames(nanos: int, values: TickValues) -> Any:
    """The true Hill frame in `eci`, and both vehicles in it: near things relative to near things."""
    return tf(
        [
            transform(nanos, ECI, HILL, values.target.position, values.hill_orientation),
            transform(nanos, HILL, SERVICER, values.relative.position, values.relative.orientation),
            transform(nanos, HILL, TARGET, np.zeros(3), values.target_in_hill),
        ]
    )


def camera_mounting(nanos: int, values: TickValues) -> Any:
    """The camera on the servicer, as flight software knows it."""
    return tf([transform(nanos, SERVICER, CAMERA, np.zeros(3), values.camera_in_body)])


def gps(nanos: int, position: Values) -> Any:
    """`geometry_msgs/PointStamped` of a measured position [m] in `eci`."""
    return message_class("geometry_msgs/msg/PointStamped")(header=header(nanos, ECI), point=point(position))


def star_tracker(nanos: int, orientation: Values) -> Any:
    """`geometry_msgs/QuaternionStamped` of the measured orientation (x, y, z, w) of the servicer in `eci`."""
    return message_class("geometry_msgs/msg/QuaternionStamped")(
        header=header(nanos, ECI), quaternion=quaternion(orientation)
    )


def imu(nanos: int, rate: Values, variance: float) -> Any:
    """`sensor_msgs/Imu` of a gyro sample [rad/s] with its variance per axis [rad^2/s^2]; the rest is marked absent."""
    absent = np.array([-1.0, *[0.0] * 8])
    return message_class("sensor_msgs/msg/Imu")(
        header=header(nanos, SERVICER),
        orientation=quaternion(np.array([0.0, 0.0, 0.0, 1.0])),
        orientation_covariance=absent,
        angular_velocity=vector(rate),
        angular_velocity_covariance=variance * np.eye(3).reshape(9),
        linear_acceleration=vector(np.zeros(3)),
        linear_acceleration_covariance=absent,
    )


def wheels(nanos: int, speed: Values, torque: Values) -> Any:
    """`sensor_msgs/JointState` of the wheels' speeds [rad/s] and torques [N m]; empty arrays for what is not known."""
    return message_class("sensor_msgs/msg/JointState")(
        header=header(nanos, ""), name=list(WHEELS), position=_NONE, velocity=speed, effort=torque
    )


def wheel_command(nanos: int, torque: Values) -> Any:
    """`sensor_msgs/JointState` of torque commands [N m] as effort."""
    return wheels(nanos, _NONE, torque)


def thruster_command(nanos: int, ignition_nanos: int, cutoff_nanos: int, thrust: float) -> Any:
    """`trajectory_msgs/JointTrajectory` of a burn: the valve opens and closes at times [ns] counted from the stamp.

    `thrust` [N] is the effort while it is open. Without a burn, or after it, there are no points. A burn that is under
    way has its opening before the stamp.
    """
    openings = [(ignition_nanos, thrust), (cutoff_nanos, 0.0)]
    ahead = cutoff_nanos > max(ignition_nanos, nanos)
    return message_class("trajectory_msgs/msg/JointTrajectory")(
        header=header(nanos, SERVICER),
        joint_names=[VALVE],
        points=[_valve(at - nanos, force) for at, force in openings] if ahead else [],
    )


def _valve(nanos: int, force: float) -> Any:
    return message_class("trajectory_msgs/msg/JointTrajectoryPoint")(
        positions=_NONE,
        velocities=_NONE,
        accelerations=_NONE,
        effort=np.array([force], dtype=np.float64),
        time_from_start=duration(nanos),
    )


def camera_info(nanos: int, view: View) -> Any:
    """`sensor_msgs/CameraInfo` of a picture without distortion."""
    width, height = view.size_px.tolist()
    (x, y), f = view.center_px.tolist(), float(view.focal_px)
    return message_class("sensor_msgs/msg/CameraInfo")(
        header=header(nanos, CAMERA),
        height=height,
        width=width,
        distortion_model="plumb_bob",
        d=np.zeros(5),
        k=np.array([f, 0.0, x, 0.0, f, y, 0.0, 0.0, 1.0]),
        r=np.eye(3).reshape(9),
        p=np.array([f, 0.0, x, 0.0, 0.0, f, y, 0.0, 0.0, 0.0, 1.0, 0.0]),
        binning_x=0,
        binning_y=0,
        roi=message_class("sensor_msgs/msg/RegionOfInterest")(
            x_offset=0, y_offset=0, height=0, width=0, do_rectify=False
        ),
    )


def image(nanos: int, picture: np.ndarray) -> Any:
    """`sensor_msgs/Image` of a picture (h, w, 3), uint8 sRGB codes."""
    height, width, _ = picture.shape
    return message_class("sensor_msgs/msg/Image")(
        header=header(nanos, CAMERA),
        height=height,
        width=width,
        encoding="rgb8",
        is_bigendian=0,
        step=3 * width,
        data=np.ascontiguousarray(picture).reshape(-1),
    )


def compressed_image(nanos: int, picture: np.ndarray) -> Any:
    """`sensor_msgs/CompressedImage` of a picture (h, w, 3), uint8 sRGB codes, as PNG, without loss."""
    _, data = cv2.imencode(".png", cv2.cvtColor(picture, cv2.COLOR_RGB2BGR))
    return message_class("sensor_msgs/msg/CompressedImage")(
        header=header(nanos, CAMERA), format="rgb8; png compressed bgr8", data=data.reshape(-1)
    )


def detections(nanos: int, view: View) -> Any:
    """`vision_msgs/Detection2DArray` of the one box of a picture, or of none."""
    found = [_detection(nanos, view)] if view.present else []
    return message_class("vision_msgs/msg/Detection2DArray")(header=header(nanos, CAMERA), detections=found)


def _detection(nanos: int, view: View) -> Any:
    (x, y), (width, height) = view.box_center_px.tolist(), view.box_size_px.tolist()
    place = message_class("vision_msgs/msg/Pose2D")(
        position=message_class("vision_msgs/msg/Point2D")(x=x, y=y), theta=0.0
    )
    # A box has no pose in space; the field is left as a message is made.
    nowhere = message_class("geometry_msgs/msg/PoseWithCovariance")(
        pose=message_class("geometry_msgs/msg/Pose")(
            position=point(np.zeros(3)), orientation=quaternion(np.array([0.0, 0.0, 0.0, 1.0]))
        ),
        covariance=np.zeros(36),
    )
    hypothesis = message_class("vision_msgs/msg/ObjectHypothesis")(class_id=TARGET_CLASS, score=float(view.score))
    return message_class("vision_msgs/msg/Detection2D")(
        header=header(nanos, CAMERA),
        results=[message_class("vision_msgs/msg/ObjectHypothesisWithPose")(hypothesis=hypothesis, pose=nowhere)],
        bbox=message_class("vision_msgs/msg/BoundingBox2D")(center=place, size_x=width, size_y=height),
        id="",
    )


def diagnostics(nanos: int, values: TickValues) -> Any:
    """`diagnostic_msgs/DiagnosticArray`: guidance mode, what became of the box, consumption."""
    box = "accepted" if values.accepted else "rejected" if values.view.present else "none"
    mode = _MODES[Mode(int(values.mode))]
    level = "WARN" if mode == "search" else "OK"
    used = {"delta_v_m_s": float(values.delta_v), "mass_kg": float(values.mass)}
    return message_class("diagnostic_msgs/msg/DiagnosticArray")(
        header=header(nanos, ""),
        status=[
            _status(level, "servicer/guidance", mode, {}),
            _status("WARN" if box == "rejected" else "OK", "servicer/navigation", f"box {box}", {}),
            _status("OK", "servicer/propulsion", "", used),
        ],
    )


def _status(level: str, name: str, text: str, values: dict[str, float]) -> Any:
    kind, pair = message_class("diagnostic_msgs/msg/DiagnosticStatus"), message_class("diagnostic_msgs/msg/KeyValue")
    return kind(
        level=getattr(kind, level),
        name=name,
        message=text,
        hardware_id="servicer",
        values=[pair(key=key, value=repr(value)) for key, value in values.items()],
    )


def of_tick(values: TickValues, wanted: Iterable[Topic] = topics.TABLE) -> Said:
    """What is said of a tick on the topics that are wanted, in their order.

    Pictures and what is said once are left out.
    """
    makers = _makers(nanoseconds(float(values.time_s)), values)
    return [(topic, makers[topic]) for topic in wanted if topic in makers]


def _makers(at: int, values: TickValues) -> dict[Topic, Callable[[], Any]]:
    """What makes the message of each topic that there is something to say on."""
    makers: dict[Topic, Callable[[], Any]] = {
        topics.CLOCK: lambda: clock(at),
        topics.TF: lambda: moving_frames(at, values),
        **_odometries(at, values),
    }
    if values.gps_present:
        makers[topics.GPS] = lambda: gps(at, values.gps)
    if values.star_tracker_present:
        makers[topics.STAR_TRACKER] = lambda: star_tracker(at, values.star_tracker)
    return makers | {
        topics.IMU: lambda: imu(at, values.gyro, float(values.gyro_variance)),
        topics.WHEELS: lambda: wheels(at, values.wheel_speed, values.wheel_torque),
        topics.WHEEL_COMMAND: lambda: wheel_command(at, values.wheel_command),
        topics.THRUSTER_COMMAND: lambda: _burn(at, values),
        topics.CAMERA_INFO: lambda: camera_info(at, values.view),
        topics.DETECTIONS: lambda: detections(at, values.view),
        topics.DIAGNOSTICS: lambda: diagnostics(at, values),
    }


def _odometries(at: int, values: TickValues) -> dict[Topic, Callable[[], Any]]:
    motions = {
        topics.SERVICER_TRUTH: values.servicer,
        topics.RELATIVE_TRUTH: values.relative,
        topics.TARGET_TRUTH: values.target,
        topics.SERVICER_ESTIMATE: values.servicer_estimate,
        topics.RELATIVE_ESTIMATE: values.relative_estimate,
        topics.TARGET_ESTIMATE: values.target_estimate,
    }
    return {topic: partial(odometry, at, topic.frame, topic.child, motion) for topic, motion in motions.items()}


def _burn(at: int, values: TickValues) -> Any:
    ignition, cutoff = nanoseconds(float(values.ignition_s)), nanoseconds(float(values.cutoff_s))
    return thruster_command(at, ignition, cutoff, float(values.thrust))
