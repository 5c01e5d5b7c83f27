"""Every command that a page prints runs from another folder: for a plugin, phases, a team, another target."""

import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest
from report_page_parser import shown_commands

from rpojax.cli.exit_status import Status

ROOT = Path(__file__).parents[2]
PLUGIN = '''"""A metric and a controller."""

import numpy as np

import rpojax


@rpojax.metric(None, unit="min")
def minutes_off_station(rho_H, rho_desired_H):
    """Minutes more than 2 m from the desired position."""
    return (np.linalg.norm(rho_H - rho_desired_H, axis=1) > 2.0).sum() / 60.0


def half_law(gain, deviation):
    """Half of the packaged feedback."""
    return -0.5 * gain @ deviation


def setup():
    """What the scenario gets."""
    stages = rpojax.Stages(formation_law=half_law)
    return rpojax.Plugin(metrics={"minutes_off_station": minutes_off_station}, stages=stages)
'''
REQUIREMENTS = """
[[requirements]]
metric = "formation_error_rms_m"
bound = "at most"
limit = 1e-3
probability = 0.9
consumer_risk = 0.1

[[requirements]]
metric = "delta_v_m_s"
bound = "at most"
limit = 100.0
probability = 0.99
consumer_risk = 0.1
"""
WITH_PLUGIN = (
    """
extends = "inspection"
name = "a mission of Anna's"
description = "Plugin, phases and another target"
plugin = "my laws.py:setup"
duration_s = 300.0

[target]
hull_m = [
  [-0.4, -0.4, -0.5], [-0.4, -0.4, 0.5], [-0.4, 0.4, -0.5], [-0.4, 0.4, 0.5],
  [0.4, -0.4, -0.5], [0.4, -0.4, 0.5], [0.4, 0.4, -0.5], [0.4, 0.4, 0.5],
]

[[phases]]
name = "first"
reference = { kind = "hold", position_m = [0.0, -50.0, 0.0] }
until = { time_s = 100.0 }

[[phases]]
name = "second"
reference = { kind = "hold", position_m = [0.0, -45.0, 0.0] }

[[requirements]]
metric = "minutes_off_station"
bound = "at most"
limit = 0.5
probability = 0.99999
consumer_risk = 0.1
"""
    + REQUIREMENTS
)
TEAM = (
    """
extends = "cooperative_far"
name = "two of Anna's"
description = "A team"
duration_s = 300.0
"""
    + REQUIREMENTS
)
VERBS = {"plugin": {"rerun", "campaign", "probability"}, "team": {"rerun", "campaign"}}
SETS = {"plugin": ["--set", "servicer.mass_kg=31.0"], "team": []}


def call(words: list[str], folder: Path) -> subprocess.CompletedProcess[str]:
    """Runs the package's command line in a folder."""
    environment = {key: value for key, value in os.environ.items() if key not in ("XLA_FLAGS", "JAX_ENABLE_X64")}
    command = [sys.executable, "-m", "rpojax", *words]
    environment |= {"PYTHONPATH": str(ROOT)}
    return subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=False)


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "scenario"), [("plugin", WITH_PLUGIN), ("team", TEAM)])
def test_every_command_of_the_pages_of_a_campaign_runs_from_another_folder(
    kind: str, scenario: str, tmp_path: Path
) -> None:
    home, elsewhere = tmp_path / "Anna's place", tmp_path / "elsewhere"
    for folder in (home, elsewhere):
        folder.mkdir()
    (home / "my laws.py").write_text(PLUGIN)
    (home / "my mission.toml").write_text(scenario)
    allowed = ["--allow-plugin"] if kind == "plugin" else []
    words = ["campaign", "my mission.toml", *allowed, *SETS[kind], "--runs", "4", "--seed", "3", "--no-film"]
    made = call([*words, "--out", "out/a b"], home)
    assert made.returncode in (Status.DONE, Status.SOME_FAILED), made.stderr[-2000:]
    assert call(["report", "out/a b", "--brief"], home).returncode == Status.DONE
    pages = [home / "out" / "a b" / name for name in ("report.html", "brief.html")]
    commands = {shlex.split(each)[1]: each for page in pages for each in reversed(shown_commands(page))}
    assert commands.keys() >= VERBS[kind]
    commands["resume"] = shlex.join(["rpojax", "resume", str(home / "out" / "a b"), *allowed])
    for verb, command in commands.items():
        done = call(shortened(verb, command), elsewhere)
        assert done.returncode in (Status.DONE, Status.SOME_FAILED), f"{command}\n{done.stderr[-2000:]}"
    for page in sorted((home / "out" / "a b" / "probability").rglob("probability.html")):
        for command in shown_commands(page)[:1]:
            done = call(shortened("run", command), elsewhere)
            assert done.returncode in (Status.DONE, Status.SOME_FAILED), f"{command}\n{done.stderr[-2000:]}"


def shortened(verb: str, command: str) -> list[str]:
    """Words of a command without its name, with few runs and with numbers and folders in the place of capital words."""
    words = shlex.split(command.replace(" I ", " 2 "))[1:]
    if verb == "campaign":
        words[words.index("--runs") + 1] = "3"
    if verb == "probability":
        words += ["--budget", "1000"]
    return [re.sub(r"^DIR$", f"{verb} again", word) for word in words]
