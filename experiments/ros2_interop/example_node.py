"""Example node for `rpojax bridge`: formation and attitude control, with numpy and scipy alone.

    rpojax bridge inspection --external formation,attitude &
    python example_node.py

It receives the estimates of the flight software, plans a burn every 200 s with its own LQR, slews to the burn attitude
and back, and commands the wheels at 5 Hz. With `--stages attitude`, burns and pointing stay with the simulator, and the
node follows its attitude reference.
"""

import argparse
import json
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from ros_wire import Node, make
from rotation import Rotation, cross
from scipy.linalg import solve_discrete_are

NANO = 1_000_000_000
MU = 3.986004418e14
INTERFACE = {
    "/servicer/estimate/odometry": "nav_msgs/msg/Odometry",
    "/servicer/estimate/relative_odometry": "nav_msgs/msg/Odometry",
    "/servicer/estimate/attitude": "sensor_msgs/msg/Imu",
    "/servicer/wheels/state": "sensor_msgs/msg/JointState",
    "/servicer/guidance/attitude": "trajectory_msgs/msg/MultiDOFJointTrajectory",
}
ORBIT, RELATIVE, ATTITUDE, WHEELS, REFERENCE = INTERFACE


class Vehicle:
    """Vehicle model, as in the packaged scenario `inspection`."""

    mass = 30.0
    thrust = 0.03
    thrust_direction = np.array([1.0, 0.0, 0.0])
    minimum_on_time = 0.5
    inertia = np.array([[1.05, 0.01, 0.0], [0.01, 0.95, 0.01], [0.0, 0.01, 0.85]])
    wheel_inertia = 8e-4
    wheel_limit = 0.025
    # From body into camera components: the boresight is +x of the body.
    camera = Rotation.from_quat([-0.5, -0.5, -0.5, 0.5])


class Tuning:
    """Controller parameters, as in the packaged scenario."""

    station = np.array([0.0, -30.0, 0.0])
    period = 200.0
    lead = 60.0
    delta_v_weight = 3e4
    dead_band = 1e-3
    largest_range_uncertainty = 0.2
    minimum_estimates = 3
    slew_acceleration = 0.016
    shortest_slew_time = 6.0
    settle = 5.0
    longest_look_away = 110.0
    retarget_jump = np.radians(5.0)
    bandwidth = 0.5
    damping = 0.9
    step = 0.2


# A_XY is the rotation that turns Y into X components. N: `eci`, H: `hill`, B: body, C: commanded, E: end of a slew.


@dataclass(frozen=True)
class Estimate:
    """Estimate of the flight software at a tick, from its two odometry messages."""

    A_NB: Rotation
    A_NH: Rotation
    r_SN_N: np.ndarray
    v_SN_N: np.ndarray
    rho: np.ndarray
    rho_dot: np.ndarray
    range_uncertainty: float

    @classmethod
    def read(cls, orbit: Any, relative: Any) -> "Estimate":
        A_NB, A_HB = rotation(orbit.pose.pose.orientation), rotation(relative.pose.pose.orientation)
        rho, P = xyz(relative.pose.pose.position), relative.pose.covariance.reshape(6, 6)[:3, :3]
        line = rho / np.linalg.norm(rho)
        return cls(
            A_NB=A_NB,
            A_NH=A_NB * A_HB.inv(),
            r_SN_N=xyz(orbit.pose.pose.position),
            v_SN_N=A_NB.apply(xyz(orbit.twist.twist.linear)),
            rho=rho,
            rho_dot=A_HB.apply(xyz(relative.twist.twist.linear)),
            range_uncertainty=float(np.sqrt(line @ P @ line) / np.linalg.norm(rho)),
        )

    @property
    def mean_motion(self) -> float:
        """Of the servicer's osculating orbit [rad/s]."""
        a = 1.0 / (2.0 / np.linalg.norm(self.r_SN_N) - self.v_SN_N @ self.v_SN_N / MU)
        return float(np.sqrt(MU / a**3))

    def target_pointing(self) -> tuple[Rotation, np.ndarray]:
        """A_EN with the boresight at the target and camera x towards the orbit normal, and its rate [rad/s] in E."""
        h_N = cross(self.r_SN_N, self.v_SN_N)
        normal = h_N / np.linalg.norm(h_N)
        omega_HN_N = h_N / (self.r_SN_N @ self.r_SN_N)
        d_N = -self.A_NH.apply(self.rho)
        d_dot_N = -self.A_NH.apply(self.rho_dot) + cross(omega_HN_N, d_N)
        distance = np.linalg.norm(d_N)
        line = d_N / distance
        line_rate = (d_dot_N - (d_dot_N @ line) * line) / distance
        rest = normal - (normal @ line) * line
        x = rest / np.linalg.norm(rest)
        y = cross(line, x)
        roll_rate = -(normal @ line) * (line_rate @ y) / np.linalg.norm(rest)
        A_EN = Vehicle.camera.inv() * Rotation.from_matrix(np.stack([x, y, line]))
        return A_EN, A_EN.apply(cross(line, line_rate) + roll_rate * line)


def clohessy_wiltshire_transition(n: float, t: float) -> np.ndarray:
    """Clohessy-Wiltshire state transition matrix of (rho, rho_dot) over `t` [s]."""
    a, s, c = n * t, np.sin(n * t), np.cos(n * t)
    return np.array(
        [
            [4 - 3 * c, 0, 0, s / n, 2 / n * (1 - c), 0],
            [6 * (s - a), 1, 0, -2 / n * (1 - c), (4 * s - 3 * a) / n, 0],
            [0, 0, c, 0, 0, s / n],
            [3 * n * s, 0, 0, c, 2 * s, 0],
            [-6 * n * (1 - c), 0, 0, -2 * s, 4 * c - 3, 0],
            [0, 0, -n * s, 0, 0, c],
        ]
    )


def lqr_gain(n: float) -> np.ndarray:
    """Gain of the LQR with one impulse per period: `x' = Phi (x + [0; dv])`."""
    A = clohessy_wiltshire_transition(n, Tuning.period)
    B, Q, R = A[:, 3:], np.diag([1.0, 1.0, 1.0, 0.0, 0.0, 0.0]), Tuning.delta_v_weight * np.eye(3)
    P = solve_discrete_are(A, B, Q, R)
    return np.linalg.solve(R + B.T @ P @ B, B.T @ P @ A)


def slew_time(angle: float) -> float:
    """Duration of a cycloidal slew [s]."""
    return max(float(np.sqrt(2.0 * np.pi * angle / Tuning.slew_acceleration)), Tuning.shortest_slew_time)


@dataclass(frozen=True)
class Burn:
    """Times [ns] from the start of the run, and the burn attitude A_BN."""

    slew_start: int = 0
    ignition: int = 0
    cutoff: int = 0
    A_BN: Rotation = field(default_factory=Rotation.identity)


def plan_burn(K: np.ndarray, time_ns: int, estimate: Estimate, estimate_count: int) -> Burn:
    """The burn of this period; none inside the dead band, with an uncertain range, or after too few estimates (a first
    detection may be false)."""
    n = estimate.mean_motion
    deviation = clohessy_wiltshire_transition(n, Tuning.lead) @ np.concatenate([estimate.rho, estimate.rho_dot])
    deviation[:3] -= Tuning.station
    # At the burn the Hill frame has rotated on about the orbit normal.
    delta_v_N = estimate.A_NH.apply(Rotation.from_rotvec([0.0, 0.0, n * Tuning.lead]).apply(-K @ deviation))
    size = float(np.linalg.norm(delta_v_N))
    A_EN, _ = estimate.target_pointing()
    thrust_N = A_EN.inv().apply(Vehicle.thrust_direction)
    slew_N = smallest_rotation(thrust_N, delta_v_N / size)
    slew_s = slew_time(float(np.linalg.norm(slew_N)))
    longest = Tuning.longest_look_away - 2.0 * slew_s - Tuning.settle - 3.0
    on_time = min(size * Vehicle.mass / Vehicle.thrust, max(longest, 0.0))
    if (
        size < Tuning.dead_band
        or on_time < Vehicle.minimum_on_time
        or estimate.range_uncertainty > Tuning.largest_range_uncertainty
        or estimate_count < Tuning.minimum_estimates
    ):
        return Burn()
    ignition = time_ns + round((Tuning.lead - 0.5 * on_time) * NANO)
    slew_start = max(ignition - round((Tuning.settle + slew_s) * NANO), time_ns)
    return Burn(slew_start, ignition, ignition + round(on_time * NANO), A_EN * Rotation.from_rotvec(-slew_N))


def smallest_rotation(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Rotation vector of the smallest rotation from unit vector `a` to `b`; any for opposite ones."""
    axis, cosine = cross(a, b), float(a @ b)
    sine = float(np.linalg.norm(axis))
    if sine < 1e-9:
        axis, sine = cross(a, np.eye(3)[int(np.argmin(np.abs(a)))]), 1.0
        axis = axis / np.linalg.norm(axis) if cosine < 0.0 else 0.0 * axis
        return np.pi * axis
    return float(np.arctan2(sine, cosine)) / sine * axis


@dataclass
class AttitudeGuidance:
    """Attitude command over time: a moving target attitude and the remaining cycloidal slew to it."""

    at: int
    A_EN: Rotation
    omega_E: np.ndarray
    remainder: np.ndarray
    slew_at: int
    slew_s: float
    burning: bool = False

    def command(self, at: int) -> tuple[Rotation, np.ndarray, np.ndarray]:
        """A_CN, rate and angular acceleration in C."""
        age = (at - self.at) / NANO
        done = min((at - self.slew_at) / NANO / self.slew_s, 1.0)
        phase = 2.0 * np.pi * done
        moved = done - np.sin(phase) / (2.0 * np.pi)
        A_CE = Rotation.from_rotvec((1.0 - moved) * self.remainder)
        A_EN = Rotation.from_rotvec(-age * self.omega_E) * self.A_EN
        rate = (1.0 - np.cos(phase)) / self.slew_s if done < 1.0 else 0.0
        acceleration = 2.0 * np.pi * np.sin(phase) / self.slew_s**2 if done < 1.0 else 0.0
        return A_CE * A_EN, rate * self.remainder + A_CE.apply(self.omega_E), acceleration * self.remainder

    def retarget(self, at: int, A_EN: Rotation, omega_E: np.ndarray, burning: bool) -> None:
        """Sets a new target attitude; a change of task or a jump of the target starts a slew."""
        expected = Rotation.from_rotvec(-(at - self.at) / NANO * self.omega_E) * self.A_EN
        jump = np.linalg.norm((A_EN * expected.inv()).as_rotvec())
        if burning != self.burning or jump > Tuning.retarget_jump:
            self.remainder = (self.command(at)[0] * A_EN.inv()).as_rotvec()
            self.slew_at, self.slew_s = at, slew_time(float(np.linalg.norm(self.remainder)))
        self.at, self.A_EN, self.omega_E, self.burning = at, A_EN, omega_E, burning


def wheel_torque(
    A_BN: Rotation, omega: np.ndarray, wheels: np.ndarray, command: tuple[Rotation, np.ndarray, np.ndarray]
) -> np.ndarray:
    """Quaternion feedback with feed-forward; the wheels lie along the body axes."""
    A_CN, omega_C, alpha_C = command
    A_BC = A_BN * A_CN.inv()
    x, y, z, w = A_BC.as_quat()
    error = -2.0 * np.copysign(1.0, w) * np.array([x, y, z])
    rate_error = omega - A_BC.apply(omega_C)
    alpha = A_BC.apply(alpha_C) - Tuning.bandwidth**2 * error - 2.0 * Tuning.damping * Tuning.bandwidth * rate_error
    momentum = Vehicle.inertia @ omega + Vehicle.wheel_inertia * wheels
    torque = -(Vehicle.inertia @ alpha + cross(omega, momentum))
    return torque / max(np.max(np.abs(torque)) / Vehicle.wheel_limit, 1.0)


class Controller:
    """Computes commands from the simulator's messages, once per stamp."""

    def __init__(self, node: Node, stages: set[str]) -> None:
        self.node, self.formation, self.attitude = node, "formation" in stages, "attitude" in stages
        self.latest: dict[str, Any] = {}
        self.counts = dict.fromkeys(INTERFACE, 0)
        self.decided = self.answered = -1
        self.K: np.ndarray | None = None
        self.burn = Burn()
        self.pointing: AttitudeGuidance | None = None
        for topic, name in INTERFACE.items():
            node.subscribe(topic, name)
        if self.formation:
            self.publish_burn = node.publisher("/servicer/thruster/command", "trajectory_msgs/msg/JointTrajectory")
            self.publish_attitude_target = node.publisher(
                "/servicer/attitude/target", "geometry_msgs/msg/QuaternionStamped"
            )
        if self.attitude:
            self.publish_wheel_torque = node.publisher("/servicer/wheels/command", "sensor_msgs/msg/JointState")

    def run(self, patience_s: float) -> None:
        """Answers messages until the simulator has ended, or none was found."""
        for topic, message in self.node.messages(patience_s):
            self.counts[topic] += 1
            self.latest[topic] = message
            self.answer()

    def answer(self) -> None:
        """Publishes the commands that the messages received so far allow."""
        if self.formation and (at := self.common_stamp(ORBIT, RELATIVE)) > self.decided:
            self.decided = at
            self.control_formation(at, Estimate.read(self.latest[ORBIT], self.latest[RELATIVE]))
        if (
            self.attitude
            and (at := self.common_stamp(ATTITUDE, WHEELS)) > self.answered
            and self.has_attitude_reference(at)
        ):
            self.answered = at
            self.control_attitude(at)

    def has_attitude_reference(self, at: int) -> bool:
        """Whether there is an own plan, or the simulator's reference for this time, which may follow the estimate."""
        if self.pointing is not None or REFERENCE not in self.latest:
            return self.pointing is not None
        return 0 <= self.reference_index(at) < len(self.latest[REFERENCE].points)

    def reference_index(self, at: int) -> int:
        """Index of the plant step in the simulator's reference."""
        return round((at - stamp_ns(self.latest[REFERENCE])) / NANO / Tuning.step)

    def common_stamp(self, *topics: str) -> int:
        """Common stamp [ns] of the latest messages of the topics, or -1."""
        stamps = {stamp_ns(self.latest[topic]) if topic in self.latest else -1 for topic in topics}
        return stamps.pop() if len(stamps) == 1 else -1

    def control_formation(self, at: int, now: Estimate) -> None:
        """Plans a burn each period and the attitude, once per tick."""
        if self.K is None:
            self.K = lqr_gain(now.mean_motion)
        if at % round(Tuning.period * NANO) == 0:
            self.burn = plan_burn(self.K, at, now, self.counts[RELATIVE])
        A_EN, omega_E = now.target_pointing()
        burning = self.burn.slew_start <= at < self.burn.cutoff
        if burning:
            A_EN, omega_E = self.burn.A_BN, np.zeros(3)
        if self.pointing is None:
            # From the current attitude, as this node may be started during a run.
            remainder = (now.A_NB.inv() * A_EN.inv()).as_rotvec()
            slew_s = slew_time(float(np.linalg.norm(remainder)))
            self.pointing = AttitudeGuidance(at, A_EN, omega_E, remainder, at, slew_s, burning)
        self.pointing.retarget(at, A_EN, omega_E, burning)
        points = [] if self.burn.cutoff <= at else [(self.burn.ignition, Vehicle.thrust), (self.burn.cutoff, 0.0)]
        if points:
            self.publish_attitude_target(
                make(
                    "geometry_msgs/msg/QuaternionStamped",
                    header=header(at, "eci"),
                    quaternion=orientation(self.burn.A_BN.inv()),
                )
            )
        self.publish_burn(
            make(
                "trajectory_msgs/msg/JointTrajectory",
                header=header(at, "servicer/base_link"),
                joint_names=["thruster"],
                points=[valve_point(time - at, force) for time, force in points],
            )
        )

    def control_attitude(self, at: int) -> None:
        """Publishes wheel torques, at every plant step."""
        estimate, wheels = self.latest[ATTITUDE], self.latest[WHEELS]
        command = self.pointing.command(at) if self.pointing else self.received_reference(at)
        omega = xyz(estimate.angular_velocity)
        torque = wheel_torque(rotation(estimate.orientation).inv(), omega, np.asarray(wheels.velocity), command)
        self.publish_wheel_torque(
            make(
                "sensor_msgs/msg/JointState",
                header=header(at, ""),
                name=["wheel_1", "wheel_2", "wheel_3"],
                position=np.zeros(0),
                velocity=np.zeros(0),
                effort=torque,
            )
        )

    def received_reference(self, at: int) -> tuple[Rotation, np.ndarray, np.ndarray]:
        """The simulator's reference at this plant step."""
        point = self.latest[REFERENCE].points[self.reference_index(at)]
        return (
            rotation(point.transforms[0].rotation).inv(),
            xyz(point.velocities[0].angular),
            xyz(point.accelerations[0].angular),
        )


def xyz(vector: Any) -> np.ndarray:
    return np.array([vector.x, vector.y, vector.z])


def rotation(quaternion: Any) -> Rotation:
    """Rotation from child into parent components."""
    return Rotation.from_quat([quaternion.x, quaternion.y, quaternion.z, quaternion.w])


def orientation(rotation: Rotation) -> Any:
    x, y, z, w = rotation.as_quat()
    return make("geometry_msgs/msg/Quaternion", x=x, y=y, z=z, w=w)


def stamp_ns(message: Any) -> int:
    return message.header.stamp.sec * NANO + message.header.stamp.nanosec


def header(at: int, frame: str) -> Any:
    time = make("builtin_interfaces/msg/Time", sec=at // NANO, nanosec=at % NANO)
    return make("std_msgs/msg/Header", stamp=time, frame_id=frame)


def valve_point(after: int, force: float) -> Any:
    return make(
        "trajectory_msgs/msg/JointTrajectoryPoint",
        positions=np.zeros(0),
        velocities=np.zeros(0),
        accelerations=np.zeros(0),
        effort=np.array([force]),
        time_from_start=make("builtin_interfaces/msg/Duration", sec=after // NANO, nanosec=after % NANO),
    )


def main() -> None:
    """Controls the run until the simulator has ended; prints the number of received messages."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--domain-id", type=int, default=0)
    parser.add_argument("--stages", default="formation,attitude")
    parser.add_argument("--patience-s", type=float, default=60.0, help="silence after which the node ends")
    options = parser.parse_args()
    controller = Controller(Node(options.domain_id), set(options.stages.split(",")))
    controller.run(options.patience_s)
    print(json.dumps({"received": controller.counts}))


if __name__ == "__main__":
    main()
