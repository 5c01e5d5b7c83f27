"""Table of the ROS 2 topics of a run, in bags and live.

Frame ids of the ROS 2 messages.

| frame id | letter | what |
|---|---|---|
| `eci` | N | inertial, origin in Earth's centre, Earth's pole = +z |
| `hill` | H | Hill frame (RTN) of the target, origin in the target: x radial outward, y along-track, z orbit normal |
| `servicer/base_link` | B | servicer body, origin in its centre of mass |
| `target/base_link` | T | target body, origin in its centre of mass |
| `servicer/camera_optical_frame` | K | camera: x right, y down, z along the boresight (REP 103) |
"""

import enum
from dataclasses import dataclass

ECI = "eci"
HILL = "hill"
SERVICER = "servicer/base_link"
TARGET = "target/base_link"
CAMERA = "servicer/camera_optical_frame"


class TopicSource(enum.StrEnum):
    """Part of the simulation that a message comes from."""

    TRUTH = "truth"
    SENSOR = "sensor"
    FLIGHT = "flight software"


class TopicRate(enum.StrEnum):
    """Times at which a topic has a message."""

    ONCE = "once, at the start"
    TICK = "every tick"
    PRESENT = "every tick with a measurement"
    KNOWN = "every tick in which it is known"
    IMAGE = "every image"


@dataclass(frozen=True)
class Qos:
    """Quality of service of a publisher.

    Attributes:
        depth: number of last messages that are kept
        latched: late subscribers get them too (transient local); else volatile
    """

    depth: int
    latched: bool = False


# All publishers are reliable, so they serve reliable and best-effort subscribers, rviz's sensor-data profile included.
STREAM_QOS = Qos(depth=10)
LATCHED_QOS = Qos(depth=1, latched=True)


@dataclass(frozen=True, eq=False)
class Topic:
    """One topic, compared by its identity.

    Attributes:
        name: absolute
        type: message type
        frame_id: `header.frame_id`, "" where there is none or several
        child_frame_id: of the message, "" where there is none or several
        source: part of the simulation that a message comes from
        rate: times at which there is a message
        description: content of a message
        qos: quality of service of the publisher
    """

    name: str
    type: str
    frame_id: str
    child_frame_id: str
    source: TopicSource
    rate: TopicRate
    description: str
    qos: Qos = STREAM_QOS


CLOCK = Topic(
    "/clock",
    "rosgraph_msgs/msg/Clock",
    "",
    "",
    TopicSource.TRUTH,
    TopicRate.TICK,
    "simulation time, for `use_sim_time`",
)
TF = Topic(
    "/tf",
    "tf2_msgs/msg/TFMessage",
    "",
    "",
    TopicSource.TRUTH,
    TopicRate.TICK,
    "Hill frame in `eci`; servicer and target in it",
)
TF_STATIC = Topic(
    "/tf_static",
    "tf2_msgs/msg/TFMessage",
    SERVICER,
    CAMERA,
    TopicSource.FLIGHT,
    TopicRate.ONCE,
    "mounting of the camera as flight software knows it",
    LATCHED_QOS,
)
SERVICER_TRUTH = Topic(
    "/servicer/truth/odometry",
    "nav_msgs/msg/Odometry",
    ECI,
    SERVICER,
    TopicSource.TRUTH,
    TopicRate.TICK,
    "the servicer's orbit and attitude",
)
RELATIVE_TRUTH = Topic(
    "/servicer/truth/relative_odometry",
    "nav_msgs/msg/Odometry",
    HILL,
    SERVICER,
    TopicSource.TRUTH,
    TopicRate.TICK,
    "the servicer from the target, its velocity as seen in the turning Hill frame",
)
TARGET_TRUTH = Topic(
    "/target/truth/odometry",
    "nav_msgs/msg/Odometry",
    ECI,
    TARGET,
    TopicSource.TRUTH,
    TopicRate.TICK,
    "the target's orbit and tumble",
)
SERVICER_ESTIMATE = Topic(
    "/servicer/estimate/odometry",
    "nav_msgs/msg/Odometry",
    ECI,
    SERVICER,
    TopicSource.FLIGHT,
    TopicRate.TICK,
    "orbit and attitude after the tick's measurements, with covariance",
)
RELATIVE_ESTIMATE = Topic(
    "/servicer/estimate/relative_odometry",
    "nav_msgs/msg/Odometry",
    HILL,
    SERVICER,
    TopicSource.FLIGHT,
    TopicRate.TICK,
    "the servicer from the target after the tick's measurements, with covariance",
)
TARGET_ESTIMATE = Topic(
    "/target/estimate/odometry",
    "nav_msgs/msg/Odometry",
    ECI,
    HILL,
    TopicSource.FLIGHT,
    TopicRate.TICK,
    "the target's orbit as its Hill frame, with covariance",
)
TARGET_POSE = Topic(
    "/target/estimate/pose",
    "geometry_msgs/msg/PoseWithCovarianceStamped",
    CAMERA,
    "",
    TopicSource.FLIGHT,
    TopicRate.KNOWN,
    "with `camera.landmarks`: the target's body in the camera after the tick's measurements, with covariance",
)
GPS = Topic(
    "/servicer/gps/position",
    "geometry_msgs/msg/PointStamped",
    ECI,
    "",
    TopicSource.SENSOR,
    TopicRate.PRESENT,
    "measured position of the servicer [m]",
)
STAR_TRACKER = Topic(
    "/servicer/star_tracker/attitude",
    "geometry_msgs/msg/QuaternionStamped",
    ECI,
    "",
    TopicSource.SENSOR,
    TopicRate.PRESENT,
    "measured orientation of the servicer in `eci`",
)
IMU = Topic(
    "/servicer/imu",
    "sensor_msgs/msg/Imu",
    SERVICER,
    "",
    TopicSource.SENSOR,
    TopicRate.TICK,
    "last gyro sample [rad/s]; covariances of -1 mark the absent orientation and acceleration",
)
WHEELS = Topic(
    "/servicer/wheels/state",
    "sensor_msgs/msg/JointState",
    "",
    "",
    TopicSource.TRUTH,
    TopicRate.TICK,
    "speeds [rad/s] and torques of the motors [N m]",
)
WHEEL_COMMAND = Topic(
    "/servicer/wheels/command",
    "sensor_msgs/msg/JointState",
    "",
    "",
    TopicSource.FLIGHT,
    TopicRate.TICK,
    "torque commands at the start of the tick [N m], as effort",
)
THRUSTER_COMMAND = Topic(
    "/servicer/thruster/command",
    "trajectory_msgs/msg/JointTrajectory",
    SERVICER,
    "",
    TopicSource.FLIGHT,
    TopicRate.TICK,
    "opening and closing of the valve: two points from the stamp on, force [N] as effort; none without a burn ahead",
)
CAMERA_INFO = Topic(
    "/servicer/camera/camera_info",
    "sensor_msgs/msg/CameraInfo",
    CAMERA,
    "",
    TopicSource.FLIGHT,
    TopicRate.TICK,
    "calibration of the tick's image: of a large frame, the window that the detector gets",
)
IMAGE = Topic(
    "/servicer/camera/image_raw",
    "sensor_msgs/msg/Image",
    CAMERA,
    "",
    TopicSource.SENSOR,
    TopicRate.IMAGE,
    "the image, rgb8",
)
COMPRESSED_IMAGE = Topic(
    "/servicer/camera/image_raw/compressed",
    "sensor_msgs/msg/CompressedImage",
    CAMERA,
    "",
    TopicSource.SENSOR,
    TopicRate.IMAGE,
    "the image, PNG",
)
DETECTIONS = Topic(
    "/servicer/camera/detections",
    "vision_msgs/msg/Detection2DArray",
    CAMERA,
    "",
    TopicSource.SENSOR,
    TopicRate.TICK,
    "the detector's box in pixels of `camera_info`, or none",
)
DIAGNOSTICS = Topic(
    "/diagnostics",
    "diagnostic_msgs/msg/DiagnosticArray",
    "",
    "",
    TopicSource.FLIGHT,
    TopicRate.TICK,
    "guidance mode, use of the box; true velocity change and mass; phase of a mission, reason of an abort",
)

ALL_TOPICS = (
    CLOCK,
    TF,
    TF_STATIC,
    SERVICER_TRUTH,
    RELATIVE_TRUTH,
    TARGET_TRUTH,
    SERVICER_ESTIMATE,
    RELATIVE_ESTIMATE,
    TARGET_ESTIMATE,
    TARGET_POSE,
    GPS,
    STAR_TRACKER,
    IMU,
    WHEELS,
    WHEEL_COMMAND,
    THRUSTER_COMMAND,
    CAMERA_INFO,
    IMAGE,
    COMPRESSED_IMAGE,
    DETECTIONS,
    DIAGNOSTICS,
)
"""All topics, in the order in which the messages of a tick are written."""
