"""A node that navigates for `rpojax bridge`, with numpy alone.

    rpojax bridge inspection --external navigation &
    python navigation_node.py

It has no filter: it publishes the truth with white noise and the covariance of that noise. A real filter would replace
`add_noise` and subscribe to the sensor topics.
"""

import argparse
import json
from typing import Any

import numpy as np
from example_node import stamp_ns
from ros_wire import Node, make

ODOMETRY = "nav_msgs/msg/Odometry"
PAIRS = {
    "/servicer/truth/odometry": "/servicer/estimate/odometry",
    "/servicer/truth/relative_odometry": "/servicer/estimate/relative_odometry",
}
SIGMA = {"/servicer/estimate/odometry": (1.0, 1e-3), "/servicer/estimate/relative_odometry": (0.1, 1e-4)}
"""Of position [m] and velocity [m/s] along each axis."""
ATTITUDE_SIGMA = 1e-4
RATE_SIGMA = 1e-5


def add_noise(truth: Any, sigma: tuple[float, float], random: np.random.Generator) -> Any:
    """Odometry with noise and its covariance."""
    (position, velocity), pose, twist = sigma, truth.pose.pose, truth.twist.twist
    return make(
        ODOMETRY,
        header=truth.header,
        child_frame_id=truth.child_frame_id,
        pose=make(
            "geometry_msgs/msg/PoseWithCovariance",
            pose=make(
                "geometry_msgs/msg/Pose",
                position=noisy_vector("Point", pose.position, position, random),
                orientation=pose.orientation,
            ),
            covariance=diagonal(position, ATTITUDE_SIGMA),
        ),
        twist=make(
            "geometry_msgs/msg/TwistWithCovariance",
            twist=make(
                "geometry_msgs/msg/Twist",
                linear=noisy_vector("Vector3", twist.linear, velocity, random),
                angular=twist.angular,
            ),
            covariance=diagonal(velocity, RATE_SIGMA),
        ),
    )


def noisy_vector(kind: str, vector: Any, sigma: float, random: np.random.Generator) -> Any:
    x, y, z = np.array([vector.x, vector.y, vector.z]) + random.normal(0.0, sigma, 3)
    return make(f"geometry_msgs/msg/{kind}", x=float(x), y=float(y), z=float(z))


def diagonal(first: float, second: float) -> np.ndarray:
    return np.diag([first**2] * 3 + [second**2] * 3).ravel()


def main() -> None:
    """Answers every true odometry until the simulator has ended; prints their number and the last stamp."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--domain-id", type=int, default=0)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--patience-s", type=float, default=60.0, help="silence after which the node ends")
    options = parser.parse_args()
    node, random = Node(options.domain_id), np.random.default_rng(options.seed)
    publishers = {topic: node.publisher(topic, ODOMETRY) for topic in PAIRS.values()}
    for topic in PAIRS:
        node.subscribe(topic, ODOMETRY)
    received, last = dict.fromkeys(PAIRS, 0), -1
    for topic, truth in node.messages(options.patience_s):
        estimate = PAIRS[topic]
        publishers[estimate](add_noise(truth, SIGMA[estimate], random))
        received[topic] += 1
        last = stamp_ns(truth)
    print(json.dumps({"received": received, "last_s": last / 1e9}))


if __name__ == "__main__":
    main()
