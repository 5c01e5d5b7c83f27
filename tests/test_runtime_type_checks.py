"""Types and shapes of every call, not of a sample, in the named closed loops."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

TESTS = Path(__file__).parent
FILES = (
    "campaign/test_coverage_campaign.py",
    "campaign/test_rerender.py",
    "campaign/test_run_and_resume.py",
    "interop/test_run_replay.py",
    "simulation/metrics/test_running_metrics.py",
    "simulation/team/test_team_run.py",
    "simulation/test_mission_phases.py",
    "simulation/test_rollout.py",
)
"""Tests that trace each loop of `named_loops`."""


@pytest.mark.slow
def test_the_named_loops_pass_with_every_call_checked() -> None:
    environment = os.environ | {"RPOJAX_CHECK_EVERY_CALL": "1"}
    words = [sys.executable, "-m", "pytest", "-q", "-n0", *(str(TESTS / name) for name in FILES)]
    done = subprocess.run(words, env=environment, cwd=TESTS.parent, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout[-4000:]
