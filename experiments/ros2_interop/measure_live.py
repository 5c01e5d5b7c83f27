"""Measurement of live runs: `rpojax bridge` and example_node.py, two processes on the loopback interface.

    python experiments/ros2_interop/measure_live.py --case run
    python experiments/ros2_interop/measure_live.py --case restart --set duration_s=600
    python experiments/ros2_interop/measure_live.py --case hostile --set duration_s=600

Prints a table; the exit status is 1 where a row does not hold.
"""

import argparse
import json
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

HERE = Path(__file__).parent
EXTERNAL_STAGES = "formation,attitude"


def start_bridge(options: argparse.Namespace, *more: str) -> "subprocess.Popen[str]":
    """The simulator, once it waits for its node."""
    overrides = [word for each in options.overrides for word in ("--set", each)]
    command = ["-m", "rpojax", "bridge", options.scenario, "--external", EXTERNAL_STAGES, "--seed", str(options.seed)]
    waits = ["--wait-s", "600", "--domain-id", str(options.domain_id), "--json"]
    bridge = subprocess.Popen(
        [sys.executable, *command, *overrides, *waits, *more], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    assert bridge.stderr is not None
    for line in bridge.stderr:
        if "waiting" in line:
            return bridge
    raise SystemExit(f"the simulator ended: {bridge.wait()}")


def start_node(options: argparse.Namespace) -> "subprocess.Popen[str]":
    """The example node."""
    command = [sys.executable, str(HERE / "example_node.py"), "--domain-id", str(options.domain_id)]
    return subprocess.Popen([*command, "--patience-s", "120"], stdout=subprocess.PIPE, text=True)


def wait_for_summary(bridge: "subprocess.Popen[str]") -> dict[str, Any]:
    """Summary of the simulator and its exit status."""
    output, _ = bridge.communicate()
    return {**json.loads(output), "status": bridge.returncode}


def internal_metrics(options: argparse.Namespace) -> dict[str, float]:
    """Metrics of the same run with the packaged flight software."""
    from rpojax.campaign import single_run
    from rpojax.scenario.loading import scenario_loader
    from rpojax.simulation.metrics import recorded_metrics

    file = scenario_loader.load(options.scenario, options.overrides)
    channels = single_run.simulate(file, options.seed, 0)
    ticks = len(channels["time_s"])
    records = {name: value[None] for name, value in channels.items() if value.shape[:1] == (ticks,)}
    own = {"formation.desired_position_m": channels["rho_desired_H"][None]}
    return {name: float(value[0]) for name, value in recorded_metrics.evaluate(file, records, own).items()}


def simulate_with_node(options: argparse.Namespace) -> list[tuple[str, str, bool]]:
    """The example node controls the run."""
    bridge = start_bridge(options)
    node = start_node(options)
    end = wait_for_summary(bridge)
    received = json.loads(node.communicate()[0])["received"]
    inside = internal_metrics(options)
    lost = sum(end["sent"][topic] - count for topic, count in received.items())
    rows = []
    for name in ("formation_error_rms_m", "nav_relative_position_error_rms_m", "delta_v_m_s", "pointing_error_p95_deg"):
        live, own = end["metrics"][name], inside[name]
        holds = abs(live / own - 1.0) <= 0.05 or name != "formation_error_rms_m"
        rows.append((name, f"{live:.4g} live, {own:.4g} in process, ratio {live / own:.4f}", holds))
    speed = end["times_real_time"]
    bound = end["simulated_s"] / end["cpu_s"]
    rows.append(("times real time", f"{speed:.1f} by the wall, {bound:.0f} by its own processor time", speed >= 100.0))
    total = sum(received.values()) + sum(end["received"].values())
    rows.append(("messages lost", f"{lost} of {total} in {end['steps']} steps", lost == 0 and end["unsent"] == 0))
    rows.append(("commands late or ignored", f"{end['late']} {end['ignored']}", not end["late"] and not end["ignored"]))
    return rows


def restart(options: argparse.Namespace) -> list[tuple[str, str, bool]]:
    """The node is killed during the run, and another one replaces it."""
    bridge = start_bridge(options, "--timeout-s", "0.2", "--patience-s", "120")
    first = start_node(options)
    time.sleep(options.kill_after_s)
    first.send_signal(signal.SIGKILL)
    first.wait()
    time.sleep(2.0)
    second = start_node(options)
    end = wait_for_summary(bridge)
    answered = sum(json.loads(second.communicate()[0])["received"].values())
    return [
        (
            "status and end",
            f"{end['status']}, {end['ticks']} ticks, {end['stopped'] or end['outcome']}",
            end["status"] == 0,
        ),
        ("late while the node was away", str(end["late"]), bool(end["late"])),
        ("messages to the second node", str(answered), answered > 0),
    ]


def hostile(options: argparse.Namespace) -> list[tuple[str, str, bool]]:
    """The node controls the run while another one floods the command topics with invalid messages."""
    bridge = start_bridge(options, "--timeout-s", "20")
    command = [sys.executable, __file__, "--case", "flood", "--domain-id", str(options.domain_id)]
    flooder = subprocess.Popen(command)
    node = start_node(options)
    end = wait_for_summary(bridge)
    flooder.kill()
    flooder.wait()
    node.communicate()
    inside = internal_metrics(options)["formation_error_rms_m"]
    ratio = end["metrics"]["formation_error_rms_m"] / inside if end["metrics"] else np.nan
    ignored = {f"{topic} {reason}": count for topic, each in end["ignored"].items() for reason, count in each.items()}
    return [
        ("status and end", f"{end['status']}, {end['stopped'] or end['outcome']}", end["status"] == 0),
        ("late", str(end["late"]), not end["late"]),
        *((name, f"{count} ignored", True) for name, count in ignored.items()),
        ("formation error over that in process", f"{ratio:.4f}", abs(ratio - 1.0) <= 0.05),
    ]


def flood(options: argparse.Namespace) -> None:
    """Publishes invalid wheel commands as fast as possible: nan, 1000 times the limit, past and future stamps."""
    from example_node import header
    from ros_wire import Node, make

    node = Node(options.domain_id)
    wheels = node.publisher("/servicer/wheels/command", "sensor_msgs/msg/JointState")
    mismatched = node.publisher("/servicer/thruster/command", "geometry_msgs/msg/PointStamped")
    none = np.zeros(0)
    while True:
        for at, torque in ((0, 0.0), (10**9, np.nan), (10**15, 0.0), (0, 25.0)):
            message = make(
                "sensor_msgs/msg/JointState",
                header=header(at, ""),
                name=[],
                position=none,
                velocity=none,
                effort=np.full(3, torque),
            )
            wheels(message)
        point = make("geometry_msgs/msg/Point", x=0.0, y=0.0, z=0.0)
        mismatched(make("geometry_msgs/msg/PointStamped", header=header(0, "eci"), point=point))
        time.sleep(options.pause_s)


CASES = {"run": simulate_with_node, "restart": restart, "hostile": hostile}


def main() -> int:
    """Prints the table of a case."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--case", choices=[*CASES, "flood"], default="run")
    parser.add_argument("--scenario", default="inspection")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--set", dest="overrides", action="append", default=[], metavar="KEY=VALUE")
    parser.add_argument("--domain-id", type=int, default=44)
    parser.add_argument("--kill-after-s", type=float, default=6.0)
    parser.add_argument("--pause-s", type=float, default=0.0, help="of the flood, between five messages")
    options = parser.parse_args()
    if options.case == "flood":
        flood(options)
        return 0
    rows = CASES[options.case](options)
    print("| what | found | holds |\n|---|---|---|")
    for what, found, holds in rows:
        print(f"| {what} | {found} | {'yes' if holds else '**no**'} |")
    return 0 if all(holds for _, _, holds in rows) else 1


if __name__ == "__main__":
    raise SystemExit(main())
