"""The command `rpojax bridge`: refusals in one line, and runs with the example nodes in other processes."""

import json
import os
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rpojax.cli import main
from rpojax.interop.cosimulation.live_settings import ExternalStage, LiveSettings
from rpojax.interop.cosimulation.live_topics import COMMAND_TOPICS
from rpojax.interop.ros2 import topics
from rpojax.interop.ros2.dds_participant import Participant

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "how_to" / "ros2_live.md").read_text(encoding="utf-8")
NODES = ROOT / "experiments" / "ros2_interop"
NODE, NAVIGATION = NODES / "example_node.py", NODES / "navigation_node.py"


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        (
            ["--external", "guidance"],
            "--external: found 'guidance', expected attitude, formation, navigation, all or none",
        ),
        (["--timeout-s", "0"], "--timeout-s: found 0, expected more than 0 and less than 1e+06"),
        (["--real-time", "-1"], "--real-time: found -1, expected more than 0 and at most 10000"),
        (["--run-id", "-1"], "--run-id: found -1, expected a whole number from 0 to 2147483646"),
        (["--domain-id", "1000"], "--domain-id: found 1000, expected 0 to 232"),
    ],
)
def test_bad_input_is_one_line(arguments: list[str], line: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main.main(["bridge", "inspection", *arguments]) == 2
    assert capsys.readouterr().err == f"rpojax: error: {line}\n"


def test_the_page_lists_every_command_topic_and_the_defaults() -> None:
    rows = [line.strip("|").split("|") for line in PAGE.splitlines() if line.startswith("| `")]
    listed = [tuple(cell.strip(" `") for cell in row[:3]) for row in rows if len(row) == 4 and "/servicer/" in row[1]]
    expected = [
        (stage.value, topic.name, topic.type.replace("/msg/", "/"))
        for stage in ExternalStage
        for topic in COMMAND_TOPICS[stage]
    ]
    assert listed == expected
    settings = LiveSettings()
    for option, value in (
        ("timeout", settings.timeout_s),
        ("patience", settings.patience_s),
        ("wait", settings.wait_s),
    ):
        assert f"`--{option}-s` ({value:g} s)" in PAGE


def start(*arguments: str) -> "subprocess.Popen[str]":
    return subprocess.Popen([sys.executable, *arguments], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def bridge(
    domain: int, duration_s: int, *options: str, external: str = "formation,attitude"
) -> "subprocess.Popen[str]":
    """Starts a simulator and returns once it waits for its node."""
    options = ("--external", external, "--domain-id", str(domain), "--wait-s", "600", "--json", *options)
    process = start("-m", "rpojax", "bridge", "inspection", "--set", f"duration_s={duration_s}", *options)
    read_until(process, "waiting")
    return process


def read_until(simulator: "subprocess.Popen[str]", word: str) -> None:
    """Reads the output of the simulator up to a line with this word."""
    assert simulator.stderr is not None
    assert any(word in line for line in simulator.stderr)


def kill(node: "subprocess.Popen[str]", simulator: "subprocess.Popen[str]") -> None:
    """Kills a node after one second of the run."""
    read_until(simulator, "running")
    time.sleep(1.0)
    node.kill()
    node.communicate()


def summary(process: "subprocess.Popen[str]") -> dict[str, Any]:
    return json.loads(process.communicate(timeout=1200)[0])


@pytest.fixture(autouse=True)
def loopback(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("CYCLONEDDS_URI", raising=False)
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(ROOT), *filter(None, [os.environ.get("PYTHONPATH")])]))


@pytest.mark.slow
def test_the_example_node_controls_a_run_without_losing_messages() -> None:
    simulator = bridge(151, 280, "--timeout-s", "60")
    node = start(str(NODE), "--domain-id", "151")
    found = summary(simulator)
    assert simulator.returncode == 0
    assert found["outcome"] == "not_judged"  # too short to arrive
    assert (found["late"], found["ignored"], found["unsent"]) == ({}, {}, 0)
    assert found["received"]["/servicer/wheels/command"] == found["steps"] == 1400
    assert found["received"]["/servicer/thruster/command"] == found["ticks"] == 280
    assert found["metrics"]["delta_v_m_s"] > 0.01
    assert found["metrics"]["pointing_error_p95_deg"] < 1.0  # half a minute of it before the target is well estimated
    received = json.loads(node.communicate(timeout=60)[0])["received"]
    assert {topic: found["sent"][topic] for topic in received} == received


@pytest.mark.slow
def test_a_run_with_a_plugin_has_its_metrics_and_says_what_it_does() -> None:
    example = ROOT / "docs" / "examples" / "plugin" / "scenario.toml"
    options = ("--external", "none", "--domain-id", "158", "--wait-s", "600", "--json", "--no-cache")
    simulator = start("-m", "rpojax", "bridge", str(example), "--allow-plugin", "--set", "duration_s=120", *options)
    read_until(simulator, "compiling")
    listener = Participant(158).subscriber(topics.RELATIVE_ESTIMATE)
    found = summary(simulator)
    assert found["outcome"] == "not_judged"  # too short to arrive
    assert 0.0 < found["metrics"]["docking_angle_deg"] < 20.0
    assert found["metrics"]["ranger_hit_fraction"] == 0.0  # the run begins beyond the reach of 40 m
    del listener


@pytest.mark.slow
def test_a_second_node_replaces_a_killed_one() -> None:
    simulator = bridge(152, 1500, "--timeout-s", "0.5", "--patience-s", "300")
    kill(start(str(NODE), "--domain-id", "152"), simulator)
    time.sleep(3.0)
    second = start(str(NODE), "--domain-id", "152")
    found = summary(simulator)
    assert found["outcome"] == "not_judged"  # too short to arrive
    assert found["late"]
    assert json.loads(second.communicate(timeout=60)[0])["received"]["/servicer/estimate/attitude"] > 0


@pytest.mark.slow
def test_a_late_command_stops_the_run_under_the_stop_policy() -> None:
    simulator = bridge(153, 1500, "--timeout-s", "2", "--on-late", "stop")
    kill(start(str(NODE), "--domain-id", "153"), simulator)
    found = summary(simulator)
    assert simulator.returncode == 4
    assert (found["completed"], found["outcome"]) == (False, None)
    assert "found no command" in found["stopped"]
    assert found["metrics"] is None


@pytest.mark.slow
def test_external_navigation_determines_the_errors() -> None:
    simulator = bridge(154, 280, "--timeout-s", "60", external="navigation")
    node = start(str(NAVIGATION), "--domain-id", "154")
    found = summary(simulator)
    assert (found["outcome"], found["late"], found["ignored"]) == ("not_judged", {}, {})
    assert set(found["received"].values()) == {280}
    # The node's estimates have errors of 0.1 m along each axis, as their covariance says.
    assert found["metrics"]["nav_relative_position_error_rms_m"] == pytest.approx(np.sqrt(3.0) * 0.1, rel=0.15)
    assert found["metrics"]["nav_servicer_position_error_rms_m"] == pytest.approx(np.sqrt(3.0), rel=0.15)
    assert found["metrics"]["nees_relative_mean"] == pytest.approx(6.0, rel=0.15)
    assert json.loads(node.communicate(timeout=60)[0])["last_s"] == 279.0


@pytest.mark.slow
def test_real_time_follows_the_wall_clock_and_sends_images() -> None:
    rendered = ("--set", "camera.model=rendered")
    simulator = bridge(155, 40, *rendered, "--real-time", "1", "--timeout-s", "30", external="attitude")
    images = Participant(155).subscriber(topics.IMAGE)
    node = start(str(NODE), "--stages", "attitude", "--domain-id", "155")
    found = summary(simulator)
    assert found["outcome"] == "not_judged"  # too short to arrive
    assert found["ignored"] == {}
    assert found["wall_s"] > 39.9
    assert len(images.take_messages()) == found["sent"]["/servicer/camera/image_raw"] == found["ticks"] == 40
    assert topics.GPS.name not in found["sent"]  # no subscriber
    # On a busy machine a step may end before its answer arrives.
    assert 0 < found["received"]["/servicer/wheels/command"] <= found["steps"] == 200
    assert sum(found["late"].values()) < found["steps"]
    node.communicate(timeout=60)
