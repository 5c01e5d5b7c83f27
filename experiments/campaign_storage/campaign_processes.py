"""Processes of short campaigns, and the comparison of their folders value by value."""

import argparse
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import zarr

SETTINGS = ("--set", "duration_s=200", "--seed", "0")
ONE_DEVICE = {"XLA_FLAGS": "--xla_force_host_platform_device_count=1"}


def options(about: str | None, **defaults: float) -> argparse.Namespace:
    """Options of a script: numbers with their defaults, and `--out`, a folder that is emptied."""
    parser = argparse.ArgumentParser(description=about)
    parser.add_argument("--out", type=Path, required=True)
    for name, value in defaults.items():
        parser.add_argument("--" + name.replace("_", "-"), type=type(value), default=value)
    found = parser.parse_args()
    shutil.rmtree(found.out, ignore_errors=True)
    found.out.mkdir(parents=True)
    return found


def command(verb: str, *words: object) -> list[str]:
    """Command line of a command of rpojax."""
    return [sys.executable, "-m", "rpojax", verb, *map(str, words)]


def campaign(out: Path, runs: int, block_size: int, *words: object) -> list[str]:
    """Command line of a campaign without a report."""
    shape = ("--runs", runs, "--block-size", block_size, "--no-report")
    return command("campaign", "inspection", *SETTINGS, *shape, "--out", out, *words)


def start(words: list[str], **environment: str) -> subprocess.Popen[str]:
    """Starts a process on one device."""
    environment = {**os.environ, **ONE_DEVICE, **environment}
    return subprocess.Popen(words, env=environment, text=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE)


def arrays(directory: Path) -> dict[str, np.ndarray]:
    """Path -> every array of a campaign folder."""
    root = zarr.open_group(str(directory / "results.zarr"), mode="r")
    return {name: np.asarray(node[:]) for name, node in root.members(max_depth=None) if isinstance(node, zarr.Array)}


def different(one: Path, other: Path) -> list[str]:
    """Paths of the arrays that differ in any bit, or that only one folder has."""
    a, b = arrays(one), arrays(other)
    unequal = [name for name in a.keys() & b.keys() if a[name].tobytes() != b[name].tobytes()]
    return sorted(unequal + list(a.keys() ^ b.keys()))


def partial_files(directory: Path) -> int:
    """Number of partial files of killed writers."""
    return len(list(directory.rglob("*.partial")))
