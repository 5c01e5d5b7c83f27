"""The built documentation site, once for all tests of a session."""

import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]


def build(out: Path, *options: str) -> subprocess.CompletedProcess[str]:
    """Runs the command of CONTRIBUTING that builds the site into a folder; no proxy leads to the network."""
    command = [sys.executable, str(ROOT / "docs" / "build.py"), "--out", str(out), *options]
    blocked = {"http_proxy": "http://127.0.0.1:9", "https_proxy": "http://127.0.0.1:9"}
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, env={**os.environ, **blocked}, check=False)
