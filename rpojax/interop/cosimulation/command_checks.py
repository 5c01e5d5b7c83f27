"""Checks of received commands: finite, within limits, right lengths, names and frames.

Each check returns the content of the command, or the reason why it is ignored.
"""

import enum
from dataclasses import dataclass
from typing import Any

import numpy as np

from rpojax.core.constants import RADIUS_EARTH
from rpojax.interop.ros2.message_builders import NANOSECONDS_PER_S, THRUSTER_JOINT, WHEEL_JOINTS
from rpojax.interop.ros2.topics import ECI, HILL, SERVICER

TORQUE_REJECTION_FACTOR = 10.0
"""Multiple of the torque limit from which a command is rejected; below it, the drive limits the torque."""
_TIME_TOLERANCE_NS = 1000
_UNIT_NORM_TOLERANCE = 1e-3
_LARGEST_RANGE_M = 1e5
"""From the target, far beyond the range where the linear motion of formation control is valid."""
_SMALLEST_RANGE_M = 0.1
_LARGEST_ORBIT_RADIUS_M = 1e9
_LARGEST_VARIANCE = 1e18


class RejectionReason(enum.StrEnum):
    """Why a message is ignored."""

    UNREADABLE = "unreadable"
    WRONG_TYPE = "wrong type"
    STALE = "stale stamp"
    EARLY = "stamp ahead"
    WRONG_LENGTH = "wrong length"
    WRONG_NAMES = "wrong names"
    WRONG_FRAME = "wrong frame"
    NOT_FINITE = "not finite"
    BEYOND_LIMIT = "beyond limit"
    TOO_SHORT = "on-time too short"
    IN_THE_PAST = "ignition in the past"
    NO_ROTATION = "no unit quaternion"
    NO_COVARIANCE = "no covariance"


@dataclass(frozen=True)
class CommandLimits:
    """Limits within which a command is accepted.

    Attributes:
        torque: (3,) of the wheels [N m]
        minimum_on_time_s: of the thruster
        maximum_on_time_s: of the thruster
    """

    torque: np.ndarray
    minimum_on_time_s: float
    maximum_on_time_s: float


@dataclass(frozen=True)
class BurnWindow:
    """Times of opening and closing the valve, from the start of the run [ns]; equal ones are no burn."""

    ignition_ns: int = 0
    cutoff_ns: int = 0


def header_stamp_ns(message: Any) -> int:
    """Time of a message [ns]."""
    at = message.header.stamp
    return int(at.sec) * NANOSECONDS_PER_S + int(at.nanosec)


def wheel_torque(message: Any, limits: CommandLimits) -> np.ndarray | RejectionReason:
    """Torques [N m] (3,) of a `sensor_msgs/JointState` that names the three wheels in any order, or none at all."""
    names, torque = list(message.name), np.asarray(message.effort, dtype=np.float64)
    if torque.shape != (3,) or len(names) not in (0, 3):
        return RejectionReason.WRONG_LENGTH
    if names and set(names) != set(WHEEL_JOINTS):
        return RejectionReason.WRONG_NAMES
    if not np.isfinite(torque).all():
        return RejectionReason.NOT_FINITE
    if (np.abs(torque) > TORQUE_REJECTION_FACTOR * limits.torque).any():
        return RejectionReason.BEYOND_LIMIT
    return torque[[names.index(wheel) for wheel in WHEEL_JOINTS]] if names else torque


def burn_window(message: Any, limits: CommandLimits, now_ns: int, previous: BurnWindow) -> BurnWindow | RejectionReason:
    """Burn commanded by a `trajectory_msgs/JointTrajectory` at time `now_ns`; without points there is none.

    An ignition in the past is accepted only where it is that of the `previous` burn, repeated.
    """
    points = list(message.points)
    if len(points) not in (0, 2) or len(message.joint_names) > 1:
        return RejectionReason.WRONG_LENGTH
    if list(message.joint_names) not in ([], [THRUSTER_JOINT]):
        return RejectionReason.WRONG_NAMES
    if not all(np.isfinite(np.asarray(point.effort, dtype=np.float64)).all() for point in points):
        return RejectionReason.NOT_FINITE
    if not points:
        return BurnWindow()
    switch_times = [header_stamp_ns(message) + _duration_ns(point.time_from_start) for point in points]
    # Nodes that compute the times anew at every tick may differ by rounding.
    ignition, cutoff = (
        known if abs(time - known) < _TIME_TOLERANCE_NS else time
        for time, known in zip(switch_times, (previous.ignition_ns, previous.cutoff_ns), strict=True)
    )
    if (cutoff - ignition) < limits.minimum_on_time_s * NANOSECONDS_PER_S:
        return RejectionReason.TOO_SHORT
    if (cutoff - ignition) > limits.maximum_on_time_s * NANOSECONDS_PER_S:
        return RejectionReason.BEYOND_LIMIT
    if ignition < now_ns and ignition != previous.ignition_ns:
        return RejectionReason.IN_THE_PAST
    return BurnWindow(ignition, cutoff)


def unit_orientation(message: Any) -> np.ndarray | RejectionReason:
    """Orientation (x, y, z, w) of a `geometry_msgs/QuaternionStamped` in `eci`."""
    if message.header.frame_id not in ("", ECI):
        return RejectionReason.WRONG_FRAME
    return _normalized(message.quaternion)


def servicer_odometry(message: Any) -> Any | RejectionReason:
    """The `nav_msgs/Odometry` itself, if it is plausible for the servicer in `eci`."""
    return _odometry(message, ECI, (RADIUS_EARTH, _LARGEST_ORBIT_RADIUS_M))


def relative_odometry(message: Any) -> Any | RejectionReason:
    """The `nav_msgs/Odometry` itself, if it is plausible for the servicer relative to the target."""
    return _odometry(message, HILL, (_SMALLEST_RANGE_M, _LARGEST_RANGE_M))


def _odometry(message: Any, frame: str, distance_range: tuple[float, float]) -> Any | RejectionReason:
    if message.header.frame_id != frame or message.child_frame_id != SERVICER:
        return RejectionReason.WRONG_FRAME
    center, velocity = message.pose.pose.position, message.twist.twist.linear
    position = np.array([center.x, center.y, center.z])
    covariances = (np.asarray(message.pose.covariance), np.asarray(message.twist.covariance))
    if not np.isfinite([*position, velocity.x, velocity.y, velocity.z, *covariances[0], *covariances[1]]).all():
        return RejectionReason.NOT_FINITE
    low, high = distance_range
    if np.abs(position).max() > high or not low <= np.linalg.norm(position) <= high:
        return RejectionReason.BEYOND_LIMIT
    if isinstance(quaternion := _normalized(message.pose.pose.orientation), RejectionReason):
        return quaternion
    if not all(_is_covariance(P.reshape(6, 6)[:3, :3]) for P in covariances):
        return RejectionReason.NO_COVARIANCE
    return message


def _is_covariance(P: np.ndarray) -> bool:
    """Whether a matrix is symmetric and positive definite, as the filter needs it."""
    if np.abs(P).max() > _LARGEST_VARIANCE or not np.allclose(P, P.T, rtol=1e-6, atol=0.0):
        return False
    return bool(np.linalg.eigvalsh(P).min() > 0.0)


def _normalized(orientation: Any) -> np.ndarray | RejectionReason:
    xyzw = np.array([orientation.x, orientation.y, orientation.z, orientation.w])
    if not np.isfinite(xyzw).all():
        return RejectionReason.NOT_FINITE
    size = float(np.linalg.norm(np.clip(xyzw, -2.0, 2.0)))
    return xyzw / size if abs(size - 1.0) < _UNIT_NORM_TOLERANCE else RejectionReason.NO_ROTATION


def _duration_ns(span: Any) -> int:
    return int(span.sec) * NANOSECONDS_PER_S + int(span.nanosec)
