"""Commands of external nodes as the flight software uses them, and the fallback for late ones."""

import time
from typing import Any, Protocol, cast, runtime_checkable

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from rpojax.core.frames import hill_frame, hill_to_inertial
from rpojax.core.quaternion import conjugate, rotate, to_matrix
from rpojax.errors import UnfinishedError
from rpojax.flight.guidance.burn_schedule import ExternalBurn
from rpojax.interop.cosimulation import command_checks, live_topics
from rpojax.interop.cosimulation.clock import Clock
from rpojax.interop.cosimulation.command_checks import BurnWindow, CommandLimits
from rpojax.interop.cosimulation.command_subscription import CommandCheck, MessageExchange, T
from rpojax.interop.cosimulation.event_log import EventLog
from rpojax.interop.cosimulation.live_settings import LiveSettings
from rpojax.interop.ros2 import topics
from rpojax.interop.ros2.message_builders import NANOSECONDS_PER_S, TopicMessages
from rpojax.interop.ros2.odometry import block_diagonal, quaternion_from_orientation, rotate_covariance
from rpojax.interop.ros2.topics import Topic
from rpojax.simulation.external_inputs import ExternalOrbitEstimate

_FRAME_ITERATIONS = 3
"""Fixed-point iterations for the target's Hill frame, started at the servicer's, which is off by 1e-5 rad."""

Vector = Float[Array, "3"]
Quaternion = Float[Array, "4"]
Matrix = Float[Array, "3 3"]
OdometryArrays = tuple[Vector, Quaternion, Vector, Matrix, Matrix]
"""Position, orientation (x, y, z, w), velocity along the child's axes, covariance of position and of that velocity."""
_EMPTY_BURN: dict[str, Any] = {
    "ignition": np.zeros(()),
    "cutoff": np.zeros(()),
    "q_burn": np.array([1.0, 0.0, 0.0, 0.0]),
}
"""Of NumPy, since an array of JAX would start its backend with the import, before its flags are set."""
NO_COMMAND = ExternalBurn(**_EMPTY_BURN, commanded=cast(Any, np.array(False)))
"""No command on burns: the plan stays."""
CLOSED_VALVE = ExternalBurn(**_EMPTY_BURN, commanded=cast(Any, np.array(True)))
"""Command that closes the valve."""


def orbit_estimate_from_odometry(servicer: Any, relative: Any) -> ExternalOrbitEstimate:
    """Orbit estimate from the servicer's `nav_msgs/Odometry` in `eci` and the one in `hill`."""
    return _orbit_estimate(_odometry_arrays(servicer), _odometry_arrays(relative))


def _odometry_arrays(message: Any) -> tuple[np.ndarray, ...]:
    pose, twist = message.pose, message.twist
    position, orientation, velocity = pose.pose.position, pose.pose.orientation, twist.twist.linear
    return (
        np.array([position.x, position.y, position.z]),
        np.array([orientation.x, orientation.y, orientation.z, orientation.w]),
        np.array([velocity.x, velocity.y, velocity.z]),
        np.asarray(pose.covariance, dtype=np.float64).reshape(6, 6)[:3, :3],
        np.asarray(twist.covariance, dtype=np.float64).reshape(6, 6)[:3, :3],
    )


@jax.jit
def _orbit_estimate(servicer: OdometryArrays, relative: OdometryArrays) -> ExternalOrbitEstimate:
    r_SN_N, v_SN_N, P_servicer = _in_parent(*servicer)
    rho, rho_dot, P_H = _in_parent(*relative)
    R_HN, omega_HN_N = hill_frame(r_SN_N, v_SN_N)
    for _ in range(_FRAME_ITERATIONS):
        r_ST_N, v_ST_N = hill_to_inertial(rho, rho_dot, R_HN, omega_HN_N)
        R_HN, omega_HN_N = hill_frame(r_SN_N - r_ST_N, v_SN_N - v_ST_N)
    r_ST_N, v_ST_N = hill_to_inertial(rho, rho_dot, R_HN, omega_HN_N)

    def to_inertial(state: Float[Array, "6"]) -> Float[Array, "6"]:
        return jnp.concatenate(hill_to_inertial(state[:3], state[3:], R_HN, omega_HN_N))

    jacobian = jax.jacfwd(to_inertial)(jnp.concatenate([rho, rho_dot]))
    return ExternalOrbitEstimate(
        r_SN_N=r_SN_N,
        v_SN_N=v_SN_N,
        r_TS_N=-r_ST_N,
        v_TS_N=-v_ST_N,
        servicer_covariance=P_servicer,
        relative_covariance=jacobian @ P_H @ jacobian.T,
    )


def _in_parent(
    position: Vector, xyzw: Quaternion, velocity: Vector, P_position: Matrix, P_velocity: Matrix
) -> tuple[Vector, Vector, Float[Array, "6 6"]]:
    """Position, velocity and their covariance in the parent's axes, without correlation between the two."""
    q_BA = quaternion_from_orientation(xyzw)
    P = block_diagonal(P_position, rotate_covariance(to_matrix(q_BA).T, P_velocity))
    return position, rotate(conjugate(q_BA), velocity), P


class CommandInput:
    """Commands from external nodes, each for a simulation time [ns], with the chosen fallback for late ones.

    All commands raise `UnfinishedError` on a late command where the policy is `stop`, and after a long silence.
    """

    def __init__(
        self, settings: LiveSettings, limits: CommandLimits, exchange: MessageExchange, clock: Clock, events: EventLog
    ) -> None:
        self._settings, self._limits = settings, limits
        self._exchange, self._clock, self._events = exchange, clock, events
        self._torque = np.zeros(3)
        self._burn_window = BurnWindow()
        self._last_command_at = time.monotonic()

    def publish(self, messages: TopicMessages) -> None:
        """Sends messages."""
        self._exchange.publish(messages)

    def wait_until(self, time_ns: int) -> None:
        """Waits until the step that ends at `time_ns` may end."""
        self._clock.wait_until(time_ns)

    def wheel_torque(self, time_ns: int) -> np.ndarray:
        """Wheel torques (3,) [N m] of a plant step."""
        found = self._wait_for_command(
            topics.WHEEL_COMMAND, time_ns, lambda message: command_checks.wheel_torque(message, self._limits)
        )
        if found is None:
            kept = self._count_late(topics.WHEEL_COMMAND, time_ns, "the last torques hold", "no torque")
            return self._torque if kept else np.zeros(3)
        if (np.abs(found) > self._limits.torque * (1.0 + 1e-9)).any():
            self._events.count_limited(topics.WHEEL_COMMAND)
        self._torque = found
        return found

    def burn_command(self, time_ns: int) -> ExternalBurn:
        """Burn command of a tick."""

        def check(message: Any) -> BurnWindow | command_checks.RejectionReason:
            return command_checks.burn_window(message, self._limits, time_ns, self._burn_window)

        found = self._wait_for_command(topics.THRUSTER_COMMAND, time_ns, check)
        if found is None:
            kept = self._count_late(topics.THRUSTER_COMMAND, time_ns, "the plan holds", "no burn")
            return NO_COMMAND if kept else self._close_valve(time_ns)
        if found == BurnWindow():
            return self._close_valve(time_ns)
        xyzw = self._wait_for_command(live_topics.ATTITUDE_TARGET, time_ns, command_checks.unit_orientation)
        if xyzw is None:
            kept = self._count_late(live_topics.ATTITUDE_TARGET, time_ns, "the plan holds", "no burn")
            return NO_COMMAND if kept else self._close_valve(time_ns)
        if found == self._burn_window:
            return NO_COMMAND
        self._burn_window = found
        return ExternalBurn(
            commanded=jnp.array(True),
            ignition=jnp.asarray(found.ignition_ns / NANOSECONDS_PER_S, dtype=jnp.float64),
            cutoff=jnp.asarray(found.cutoff_ns / NANOSECONDS_PER_S, dtype=jnp.float64),
            q_burn=quaternion_from_orientation(jnp.asarray(xyzw)),
        )

    def orbit_estimate(self, time_ns: int) -> ExternalOrbitEstimate | None:
        """Orbit estimate of a tick; None where the simulator's filter has to continue from the last one."""
        servicer = self._wait_for_command(topics.SERVICER_ESTIMATE, time_ns, command_checks.servicer_odometry)
        relative = self._wait_for_command(topics.RELATIVE_ESTIMATE, time_ns, command_checks.relative_odometry)
        for topic, found in ((topics.SERVICER_ESTIMATE, servicer), (topics.RELATIVE_ESTIMATE, relative)):
            if found is None:
                self._count_late(topic, time_ns, "the simulator's filter continues", "the simulator's filter continues")
        return None if servicer is None or relative is None else orbit_estimate_from_odometry(servicer, relative)

    def _close_valve(self, time_ns: int) -> ExternalBurn:
        """Burn command that closes the valve if it is open or will open, else leaves the plan."""
        pending, self._burn_window = self._burn_window.cutoff_ns > time_ns, BurnWindow()
        return CLOSED_VALVE if pending else NO_COMMAND

    def _wait_for_command(self, topic: Topic, time_ns: int, check: CommandCheck[T]) -> T | None:
        found = self._clock.wait_for_command(self._exchange.subscriptions[topic.name], time_ns, check)
        if found is not None:
            self._last_command_at = time.monotonic()
        return found

    def _count_late(self, topic: Topic, time_ns: int, hold_text: str, zero_text: str) -> bool:
        """Counts a late command and returns whether the last one holds."""
        hold = self._settings.on_late == "hold"
        self._events.count_late(topic, time_ns / NANOSECONDS_PER_S, hold_text if hold else zero_text)
        if self._settings.on_late == "stop":
            raise UnfinishedError(
                f"{topic.name}: found no command for {time_ns / NANOSECONDS_PER_S:g} s in time, expected one"
            )
        if time.monotonic() - self._last_command_at > self._settings.patience_s:
            raise UnfinishedError(
                f"{topic.name}: found no command at all for {self._settings.patience_s:g} s, expected one"
            )
        return hold


@runtime_checkable
class CommandSource(Protocol):
    """Receiver of the messages of a run and source of its commands."""

    def publish(self, messages: TopicMessages) -> None:
        """Receives messages of the simulator."""
        ...

    def orbit_estimate(self, time_ns: int) -> ExternalOrbitEstimate | None:
        """Orbit estimate for a tick [ns]."""
        ...

    def burn_command(self, time_ns: int) -> ExternalBurn:
        """Burn command at a tick [ns]."""
        ...

    def wheel_torque(self, time_ns: int) -> np.ndarray:
        """Wheel torques (3,) [N m] for a plant step [ns]."""
        ...

    def wait_until(self, time_ns: int) -> None:
        """Returns when the step that ends at a time [ns] may end."""
        ...


class WarmUpCommands:
    """Command source without external nodes: the simulator's own estimates, no burn and no torque."""

    def __init__(self) -> None:
        self._messages: dict[str, Any] = {}

    def publish(self, messages: TopicMessages) -> None:
        """Builds all messages and keeps the last of each topic."""
        self._messages |= {topic.name: build() for topic, build in messages}

    def orbit_estimate(self, time_ns: int) -> ExternalOrbitEstimate:
        """Orbit estimate from the simulator's own odometry messages."""
        names = (topics.SERVICER_ESTIMATE.name, topics.RELATIVE_ESTIMATE.name)
        return orbit_estimate_from_odometry(*(self._messages[name] for name in names))

    def burn_command(self, time_ns: int) -> ExternalBurn:
        """No command."""
        return NO_COMMAND

    def wheel_torque(self, time_ns: int) -> np.ndarray:
        """Zero torque."""
        return np.zeros(3)

    def wait_until(self, time_ns: int) -> None:
        """Returns at once."""
