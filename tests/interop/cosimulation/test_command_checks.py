"""Checks of commands: which are accepted, and why others are ignored."""

from typing import Any

import numpy as np
import pytest
from command_inbox import LIMITS, attitude_target

from rpojax.interop.cosimulation import command_checks
from rpojax.interop.cosimulation.command_checks import BurnWindow, RejectionReason
from rpojax.interop.ros2 import message_builders
from rpojax.interop.ros2.message_builders import NANOSECONDS_PER_S as NANO
from rpojax.interop.ros2.message_types import deserialize, message_class, serialize
from rpojax.interop.ros2.odometry import Odometry
from rpojax.interop.ros2.topics import ECI, HILL, SERVICER

LIMIT = 0.025
NOW = 200 * NANO


def wheels(torque: Any, names: tuple[str, ...] = message_builders.WHEEL_JOINTS) -> Any:
    """Wheel command, serialized and deserialized."""
    message = message_class("sensor_msgs/msg/JointState")(
        header=message_builders.header_message(NOW, ""),
        name=list(names),
        position=np.zeros(0),
        velocity=np.zeros(0),
        effort=np.asarray(torque, dtype=np.float64),
    )
    return deserialize(serialize(message), "sensor_msgs/msg/JointState")


def test_torques_are_accepted_unchanged() -> None:
    np.testing.assert_array_equal(command_checks.wheel_torque(wheels([0.01, -0.02, 0.0]), LIMITS), [0.01, -0.02, 0.0])
    np.testing.assert_array_equal(
        command_checks.wheel_torque(wheels([0.01, -0.02, 0.0], ()), LIMITS), [0.01, -0.02, 0.0]
    )


def test_torques_are_sorted_by_wheel_name() -> None:
    shuffled = wheels([1e-3, 2e-3, 3e-3], ("wheel_3", "wheel_1", "wheel_2"))
    np.testing.assert_array_equal(command_checks.wheel_torque(shuffled, LIMITS), [2e-3, 3e-3, 1e-3])


def test_torques_somewhat_beyond_the_limit_are_accepted() -> None:
    np.testing.assert_array_equal(
        command_checks.wheel_torque(wheels([5 * LIMIT, 0.0, 0.0]), LIMITS), [5 * LIMIT, 0.0, 0.0]
    )


@pytest.mark.parametrize(
    ("message", "reason"),
    [
        (wheels([0.0, np.nan, 0.0]), RejectionReason.NOT_FINITE),
        (wheels([0.0, -np.inf, 0.0]), RejectionReason.NOT_FINITE),
        (wheels([0.0, 0.0, -1000 * LIMIT]), RejectionReason.BEYOND_LIMIT),
        (wheels([1e308, 1e308, 1e308]), RejectionReason.BEYOND_LIMIT),
        (wheels([0.0, 0.0]), RejectionReason.WRONG_LENGTH),
        (wheels(np.zeros(100_000)), RejectionReason.WRONG_LENGTH),
        (wheels([]), RejectionReason.WRONG_LENGTH),
        (wheels(np.zeros(3), ("wheel_1", "wheel_2")), RejectionReason.WRONG_LENGTH),
        (wheels(np.zeros(3), ("wheel_1", "wheel_2", "wheel_4")), RejectionReason.WRONG_NAMES),
        (wheels(np.zeros(3), ("wheel_1", "wheel_1", "wheel_2")), RejectionReason.WRONG_NAMES),
    ],
)
def test_invalid_torques_are_rejected(message: Any, reason: RejectionReason) -> None:
    assert command_checks.wheel_torque(message, LIMITS) == reason


def burn(ignition_s: float, cutoff_s: float, **changes: Any) -> Any:
    """Thruster command, serialized and deserialized."""
    ignition, cutoff = round(ignition_s * NANO), round(cutoff_s * NANO)
    message = message_builders.thruster_command(NOW, ignition, cutoff, 0.03)
    for name, value in changes.items():
        setattr(message, name, value)
    return deserialize(serialize(message), "trajectory_msgs/msg/JointTrajectory")


def window(ignition_s: float, cutoff_s: float) -> BurnWindow:
    return BurnWindow(round(ignition_s * NANO), round(cutoff_s * NANO))


def test_burn_times_count_from_the_stamp() -> None:
    assert command_checks.burn_window(burn(240.0, 262.5), LIMITS, NOW, BurnWindow()) == window(240.0, 262.5)
    assert command_checks.burn_window(burn(0.0, 0.0), LIMITS, NOW, window(240.0, 262.5)) == BurnWindow()


def test_a_running_burn_may_be_repeated_and_get_another_cutoff() -> None:
    before = window(190.0, 220.0)
    assert command_checks.burn_window(burn(190.0, 220.0), LIMITS, NOW, before) == before
    assert command_checks.burn_window(burn(190.0, 205.0), LIMITS, NOW, before) == window(190.0, 205.0)
    assert command_checks.burn_window(burn(190.0, 220.0), LIMITS, NOW, BurnWindow()) == RejectionReason.IN_THE_PAST


def test_a_burn_with_rounded_times_is_the_same_burn() -> None:
    before = window(240.0, 262.5)
    assert command_checks.burn_window(burn(240.0 + 3e-7, 262.5 - 3e-7), LIMITS, NOW, before) == before


def effort(value: float) -> list[Any]:
    """Two points, one with such an effort."""
    points = message_builders.thruster_command(NOW, NOW + NANO, NOW + 9 * NANO, 0.03).points
    points[0].effort = np.array([value])
    return points


@pytest.mark.parametrize(
    ("message", "reason"),
    [
        (burn(201.0, 209.0, points=effort(np.nan)), RejectionReason.NOT_FINITE),
        (burn(201.0, 209.0, points=effort(0.03)[:1]), RejectionReason.WRONG_LENGTH),
        (burn(201.0, 209.0, points=effort(0.03)[::-1]), RejectionReason.TOO_SHORT),
        (burn(201.0, 209.0, joint_names=["wheel_1"]), RejectionReason.WRONG_NAMES),
        (burn(201.0, 209.0, joint_names=["thruster", "thruster"]), RejectionReason.WRONG_LENGTH),
        (burn(240.0, 240.4), RejectionReason.TOO_SHORT),
        (burn(240.0, 240.0 + 1000.0 * 110.0), RejectionReason.BEYOND_LIMIT),
        (burn(199.9, 220.0), RejectionReason.IN_THE_PAST),
    ],
)
def test_invalid_burns_are_rejected(message: Any, reason: RejectionReason) -> None:
    assert command_checks.burn_window(message, LIMITS, NOW, BurnWindow()) == reason


def test_orientations_are_normalized() -> None:
    found = command_checks.unit_orientation(attitude_target(NOW, [0.0, 0.6 * 1.0001, 0.0, 0.8 * 1.0001]))
    np.testing.assert_allclose(found, [0.0, 0.6, 0.0, 0.8], rtol=1e-12)


@pytest.mark.parametrize(
    ("message", "reason"),
    [
        (attitude_target(NOW, [0.0, 0.0, 0.0, 0.0]), RejectionReason.NO_ROTATION),
        (attitude_target(NOW, [0.0, 0.0, 0.0, 1.1]), RejectionReason.NO_ROTATION),
        (attitude_target(NOW, [1e308, 1e308, 0.0, 1.0]), RejectionReason.NO_ROTATION),
        (attitude_target(NOW, [0.0, np.nan, 0.0, 1.0]), RejectionReason.NOT_FINITE),
        (attitude_target(NOW, [0.0, 0.0, 0.0, 1.0], HILL), RejectionReason.WRONG_FRAME),
    ],
)
def test_invalid_orientations_are_rejected(message: Any, reason: RejectionReason) -> None:
    assert command_checks.unit_orientation(message) == reason


def odometry(frame: str = HILL, position: Any = (0.0, -30.0, 0.0), **changes: Any) -> Any:
    """The servicer from the target, or in `eci`."""
    motion = {
        "position": np.asarray(position),
        "orientation": np.array([0.0, 0.0, 0.0, 1.0]),
        "velocity": np.zeros(3),
        "rate": np.zeros(3),
        "pose_covariance": np.eye(6),
        "twist_covariance": 1e-4 * np.eye(6),
    }
    return message_builders.odometry(NOW, frame, SERVICER, Odometry(**(motion | changes)))


def with_variance(place: tuple[int, int], value: float) -> np.ndarray:
    P = np.eye(6)
    P[place] = value
    return P


def test_plausible_estimates_are_accepted() -> None:
    message = odometry()
    assert command_checks.relative_odometry(message) is message
    message = odometry(ECI, (7e6, 0.0, 0.0))
    assert command_checks.servicer_odometry(message) is message


@pytest.mark.parametrize(
    ("message", "reason"),
    [
        (odometry(ECI), RejectionReason.WRONG_FRAME),
        (odometry(position=(0.0, np.nan, 0.0)), RejectionReason.NOT_FINITE),
        (odometry(velocity=np.array([np.inf, 0.0, 0.0])), RejectionReason.NOT_FINITE),
        (odometry(pose_covariance=np.full((6, 6), np.nan)), RejectionReason.NOT_FINITE),
        (odometry(position=(0.0, 0.0, 0.0)), RejectionReason.BEYOND_LIMIT),
        (odometry(position=(0.0, 1e6, 0.0)), RejectionReason.BEYOND_LIMIT),
        (odometry(position=(1e308, 1e308, 0.0)), RejectionReason.BEYOND_LIMIT),
        (odometry(orientation=np.zeros(4)), RejectionReason.NO_ROTATION),
        (odometry(pose_covariance=np.zeros((6, 6))), RejectionReason.NO_COVARIANCE),
        (odometry(pose_covariance=with_variance((0, 1), 0.5)), RejectionReason.NO_COVARIANCE),
        (odometry(pose_covariance=with_variance((2, 2), -1.0)), RejectionReason.NO_COVARIANCE),
        (odometry(twist_covariance=with_variance((2, 2), 1e300)), RejectionReason.NO_COVARIANCE),
    ],
)
def test_invalid_estimates_are_rejected(message: Any, reason: RejectionReason) -> None:
    assert command_checks.relative_odometry(message) == reason


def test_an_orbit_inside_the_earth_is_rejected() -> None:
    assert command_checks.servicer_odometry(odometry(ECI, (1e6, 0.0, 0.0))) == RejectionReason.BEYOND_LIMIT
