"""Longest silence of every verb and public function: seconds without a character on stderr or stdout.

    python experiments/report/longest_silence.py --out out/silence [--only VERB,VERB]

Each is called in a process of its own, at a small size and without the cache of compiled programs, so that compiling
is part of it. The time before the first character, in which Python imports JAX, and that after the last one count too;
a Python program prints a line of its own when it has imported what it calls.
"""

import argparse
import json
import os
import re
import select
import subprocess
import sys
import time
from pathlib import Path

SHORT = ("--set", "duration_s=200")
RUN = ("--run-id", "0")

VERBS: dict[str, tuple[str, ...]] = {
    "campaign": ("campaign", "inspection", "--runs", "4", *SHORT, "--no-cache", "--out", "runs"),
    "run": ("run", "inspection", *SHORT, "--no-cache", "--out", "one"),
    "resume": ("resume", "runs"),
    "status": ("status", "runs"),
    "rerun": ("rerun", "runs", "--run-id", "1", "--no-cache", "--out", "again"),
    "compare": ("compare", "runs", "runs", "--out", "compare.html"),
    "report": ("report", "runs"),
    "report --brief": ("report", "runs", "--brief"),
    "lincov": ("lincov", "inspection", *SHORT, "--no-cache", "--out", "linear"),
    "sensitivity": ("sensitivity", "inspection", *SHORT, "--runs", "4", "--no-cache"),
    "worst-case": (
        *("worst-case", "inspection", *SHORT, "--requirement", "min_range_m", "--starts", "2", "--budget", "60"),
        *("--no-cache", "--out", "worst"),
    ),
    "tune": (
        *("tune", "inspection", "--parameters", "navigation.gps_noise_m", "--runs", "4", "--steps", "2"),
        *("--horizon", "120", "--judge", "0", "--no-cache", "--out", "tuned.toml"),
    ),
    "probability": (
        *("probability", "inspection", *SHORT, "--outcome", "keep_out", "--budget", "1000", "--no-cache"),
        *("--out", "rare"),
    ),
    "export czml": ("export", "runs", "--format", "czml", *RUN, "--no-cache", "--out", "run.czml"),
    "export csv": ("export", "runs", "--format", "csv", "--out", "results.csv"),
    "export oem": ("export", "runs", "--format", "oem", *RUN, "--no-cache", "--out", "run.oem"),
    "export-bag": ("export-bag", "runs", *RUN, "--no-cache", "--out", "bag"),
    "export-rrd": ("export-rrd", "runs", *RUN, "--no-cache", "--out", "run.rrd"),
    "run rendered": (
        *("run", "inspection", "--set", "camera.model=rendered", "--set", "duration_s=60"),
        *("--no-cache", "--out", "pixels"),
    ),
    "film": ("film", "pixels", "--out", "film.mp4"),
    "field render": ("field", "render", "--out", "picture.png"),
    "detect": ("detect", "picture.png"),
    "bench": ("bench", "--only", "kernels"),
    "validate": ("validate", "inspection"),
    "schema": ("schema",),
    "new": ("new", "mine"),
}
"""Commands after `rpojax`, in an order in which each finds what it needs."""

FUNCTIONS: dict[str, str] = {
    "simulate": "rpojax.simulate(file)",
    "run_campaign": "rpojax.run_campaign(file, runs=2, out='python')",
    "write_report": "rpojax.write_report(rpojax.Campaign('runs'))",
    "resume_campaign": "rpojax.resume_campaign('python')",
    "compare": "rpojax.compare(rpojax.Campaign('runs'), rpojax.Campaign('runs'))",
    "export": "rpojax.export(rpojax.Campaign('runs'), 'python.oem', 'oem', run_id=0)",
    "gradient": "rpojax.gradient(file, ['navigation.edge_noise_px'], runs=2)",
    "linear_covariance": "rpojax.linear_covariance(file)",
    "sensitivity": "rpojax.sensitivity(file, ['delta_v_m_s'], runs=2)",
    "worst_case": "rpojax.worst_case(file, requirement='min_range_m', budget=60)",
    "tune": "rpojax.tune(file, ['navigation.gps_noise_m'], runs=4, steps=2, horizon_s=120, validation_runs=0)",
}
"""Calls of a Python program that prepares nothing."""


def _import(call: str) -> str:
    """Python that imports what a call needs, then prints a line."""
    names = sorted(set(re.findall(r"rpojax[.]\w+", call)))
    return "; ".join([*names, "print('imported')"])


def longest_silence(command: list[str], folder: Path) -> dict[str, float | int]:
    """Longest silence and total time [s] of a process, and its exit status."""
    environment = {**os.environ, "PYTHONUNBUFFERED": "1"}
    begin = last = time.monotonic()
    silence = 0.0
    process = subprocess.Popen(
        command, cwd=folder, env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, bufsize=0
    )
    assert process.stdout is not None
    while True:
        select.select([process.stdout], [], [])
        text = os.read(process.stdout.fileno(), 65536)
        now = time.monotonic()
        silence, last = max(silence, now - last), now
        if not text:
            break
    return {"silence_s": round(silence, 1), "total_s": round(last - begin, 1), "status": process.wait()}


def main() -> None:
    """Calls everything, and prints the silences as JSON."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--only", default="")
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    wanted = set(filter(None, arguments.only.split(",")))
    found = {}
    for name, words in VERBS.items():
        if not wanted or name in wanted:
            found[name] = longest_silence([sys.executable, "-m", "rpojax", *words], arguments.out)
            print(name, found[name], file=sys.stderr, flush=True)
    for name, call in FUNCTIONS.items():
        if not wanted or name in wanted:
            code = f"import rpojax; file = rpojax.load('inspection', ['duration_s=200']); {_import(call)}; {call}"
            found[f"rpojax.{name}"] = longest_silence([sys.executable, "-c", code], arguments.out)
            print(name, found[f"rpojax.{name}"], file=sys.stderr, flush=True)
    print(json.dumps(found, indent=2))


if __name__ == "__main__":
    main()
