"""Round trip of messages to another DDS library: Cyclone DDS in C, compiled here.

    apt-get install cyclonedds-dev cyclonedds-tools
    python experiments/ros2_interop/check_peers.py

Every message that comes back must have the bytes of the one that was sent. The exit status is 1 where one has not.
"""

import argparse
import os
import subprocess
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.interfaces import Nodetype

from rpojax.interop.cosimulation import live_topics
from rpojax.interop.ros2 import message_builders
from rpojax.interop.ros2.dds_participant import LOOPBACK, Participant
from rpojax.interop.ros2.message_types import message_class, serialize, typestore
from rpojax.interop.ros2.message_values import DetectorImage
from rpojax.interop.ros2.odometry import Odometry
from rpojax.interop.ros2.topics import ECI, SERVICER, Topic, TopicRate, TopicSource

HERE = Path(__file__).parent
DOMAIN = 57
_BASES = {
    "bool": "boolean",
    "byte": "octet",
    "octet": "octet",
    "char": "octet",
    "int8": "int8",
    "uint8": "octet",
    "int16": "short",
    "uint16": "unsigned short",
    "int32": "long",
    "uint32": "unsigned long",
    "int64": "long long",
    "uint64": "unsigned long long",
    "float32": "float",
    "float64": "double",
    "string": "string",
}


def idl(name: str, extensibility: str) -> str:
    """IDL of a message type and its nested types, with the names of ROS 2."""
    return "\n".join(_structs(name, extensibility, set()))


def _structs(name: str, extensibility: str, done: set[str]) -> Iterator[str]:
    if name in done:
        return
    done.add(name)
    members = []
    fields: list[tuple[str, tuple[Any, Any]]] = list(typestore().fielddefs[name][1])
    for field, (kind, what) in fields:
        (inner, of), size = what if kind in (Nodetype.ARRAY, Nodetype.SEQUENCE) else ((kind, what), 0)
        if inner == Nodetype.NAME:
            yield from _structs(of, extensibility, done)
        element = _dds_name(of) if inner == Nodetype.NAME else _BASES[of[0]]
        if kind == Nodetype.ARRAY:
            members.append(f"{element} {field}[{size}];")
        elif kind == Nodetype.SEQUENCE:
            members.append(f"sequence<{element}> {field};")
        else:
            members.append(f"{element} {field};")
    package, group, short = name.split("/")
    struct = f"{extensibility} struct {short}_ {{ {' '.join(members)} }};"
    yield f"module {package} {{ module {group} {{ module dds_ {{ {struct} }}; }}; }};"


def _dds_name(name: str) -> str:
    package, group, short = name.split("/")
    return f"{package}::{group}::dds_::{short}_"


def build_cyclone(name: str, folder: Path) -> Path:
    """The echoing program in C."""
    (folder / "check.idl").write_text(idl(name, "@final"))
    _call(["idlc", "-l", "c", "check.idl"], folder)
    program = folder / "echo"
    kind = _dds_name(name).replace("::", "_")
    source = HERE / "peers" / "echo_cyclone.c"
    _call(["cc", "-O1", f"-I{folder}", f"-DTYPE={kind}", "-o", program, source, "check.c", "-lddsc"], folder)
    return program


def _call(command: list[Any], folder: Path) -> None:
    subprocess.run([str(word) for word in command], cwd=folder, check=True, capture_output=True)


def samples(name: str) -> Iterator[Any]:
    """Messages of random numbers, as the live run builds them."""
    random = np.random.default_rng(0)
    at = 0
    while True:
        at += 200_000_000
        a, b, c = random.normal(size=(3, 3))
        q = random.normal(size=4)
        match name:
            case "sensor_msgs/msg/JointState":
                yield message_builders.wheel_state(at, a, b)
            case "sensor_msgs/msg/Imu":
                yield live_topics.attitude_estimate(at, q, a, np.outer(a, b), np.outer(b, c))
            case "nav_msgs/msg/Odometry":
                P = random.normal(size=(2, 6, 6))
                values = {"position": a, "orientation": q, "velocity": b, "rate": c}
                yield message_builders.odometry(
                    at, ECI, SERVICER, Odometry(**values, pose_covariance=P[0], twist_covariance=P[1])
                )
            case "trajectory_msgs/msg/JointTrajectory":
                yield message_builders.thruster_command(at, at + 60_000_000_000, at + 80_000_000_001, 0.03)
            case "vision_msgs/msg/Detection2DArray":
                view: dict[str, Any] = {"size_px": np.array([128, 128]), "focal_px": 700.0, "center_px": np.zeros(2)}
                view |= {"box_center_px": a[:2], "box_size_px": b[:2], "score": c[0], "present": True}
                yield message_builders.detections(at, DetectorImage(**view))
            case "sensor_msgs/msg/Image":
                yield message_builders.image(at, random.integers(0, 256, (48, 64, 3), dtype=np.uint8))
            case _:
                raise ValueError(name)


TYPES = (
    "sensor_msgs/msg/JointState",
    "sensor_msgs/msg/Imu",
    "nav_msgs/msg/Odometry",
    "trajectory_msgs/msg/JointTrajectory",
    "vision_msgs/msg/Detection2DArray",
    "sensor_msgs/msg/Image",
)


def check(name: str, program: Path, count: int) -> tuple[int, int, float, float]:
    """Number returned, number equal, and round-trip time at the median and the 99th percentile [ms]."""
    there = Topic("/check/there", name, "", "", TopicSource.TRUTH, TopicRate.TICK, "")
    back = Topic("/check/back", name, "", "", TopicSource.TRUTH, TopicRate.TICK, "")
    participant = Participant(DOMAIN)
    publisher, subscriber = participant.publisher(there), participant.subscriber(back)
    peer = subprocess.Popen([program, str(DOMAIN), str(count)], env={**os.environ, "CYCLONEDDS_URI": LOOPBACK})
    until = time.monotonic() + 60.0
    while not (publisher.subscriber_count and subscriber.publisher_count):
        if peer.poll() is not None or time.monotonic() > until:
            raise SystemExit(f"{name}: the peer was not found")
        time.sleep(0.05)
    time.sleep(1.0)
    came, equal, trips = 0, 0, []
    for _, message in zip(range(count), samples(name), strict=False):
        begin = time.perf_counter()
        publisher.send(message)
        if not subscriber.wait(10.0):
            continue
        found = subscriber.take_messages()
        trips.append(time.perf_counter() - begin)
        came += len(found)
        equal += sum(each is not None and serialize(each) == serialize(message) for each in found)
    peer.wait(30.0)
    p50, p99 = 1e3 * np.percentile(trips, [50.0, 99.0]) if trips else (np.nan, np.nan)
    return came, equal, float(p50), float(p99)


def main() -> int:
    """Prints a table; 0 if all messages returned equal."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=1000)
    parser.add_argument("--types", nargs="+", default=TYPES, metavar="TYPE")
    options = parser.parse_args()
    print("| type | sent | returned | equal | p50 [ms] | p99 [ms] |\n|---|---|---|---|---|---|")
    good = True
    for name in options.types:
        message_class(name)
        with tempfile.TemporaryDirectory() as folder:
            came, equal, p50, p99 = check(name, build_cyclone(name, Path(folder)), options.count)
        good = good and came == equal == options.count
        print(f"| {name} | {options.count} | {came} | {equal} | {p50:.2f} | {p99:.2f} |", flush=True)
    return 0 if good else 1


if __name__ == "__main__":
    raise SystemExit(main())
