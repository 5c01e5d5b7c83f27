"""Speed of rpojax against Basilisk: both simulate the same mission alternately on the same cores.

python -m benchmarks.against_basilisk
"""

import argparse
import json
import math
import os
import platform
import sys
import time
from collections.abc import Iterator, Sequence
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from benchmarks import speed_comparison
from benchmarks.exit_statuses import exit_status
from benchmarks.speed_comparison import TimedPass
from rpojax.cli import output_paths
from rpojax.errors import RpojaxError
from rpojax.runtime.jax_environment import available_cores, prepare_jax, set_loop_fusion_flag
from rpojax.version import __version__

if TYPE_CHECKING:
    from benchmarks.basilisk_peer import BasiliskWorkers
    from rpojax.campaign.execution.batch_engine import BatchEngine
    from rpojax.scenario.schema import ScenarioFile

ROUNDS = 6
"""Passes of each simulator; the fastest one counts."""

CHECK_ORBITS = 3
"""Orbits that Basilisk simulates before anything is timed, to check its mission."""

DISTINCT_RUNS = 16
"""Dispersed runs of each Basilisk process, which are repeated in a cycle."""


def main(argv: Sequence[str] | None = None) -> int:
    """Exit status: 0, 1 if Basilisk's mission fails its check, 2 for a bad option or a missing package."""

    def run() -> int:
        options = parse_options(argv)
        peer_version = basilisk_version()
        restrict_to_cores(options.cores)
        return compare(options, peer_version)

    return exit_status("against_basilisk", run)


def parse_options(argv: Sequence[str] | None = None) -> argparse.Namespace:
    """Checked command-line options.

    Raises:
        RpojaxError: a value is out of range, or the file for JSON exists.
    """
    cores = available_cores()
    parser = argparse.ArgumentParser(prog="against_basilisk", description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--cores", type=int, default=cores, metavar="N", help="cores for both (default: all)")
    parser.add_argument("--runs", type=int, default=10, metavar="N", help="runs of Basilisk per core and pass")
    parser.add_argument("--duration-s", type=float, default=3000.0, metavar="T", help="simulated time of a run [s]")
    parser.add_argument("--batches", type=int, nargs="+", metavar="N", help="of rpojax (default: 128 and 256 per core)")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write all figures to a new file")
    options = parser.parse_args(argv)
    options.batches = sorted({128 * options.cores, 256 * options.cores}) if options.batches is None else options.batches
    speed_comparison.check_options(options.cores, cores, options.runs, options.duration_s, options.batches)
    if options.json is not None:
        if options.json.exists():
            raise RpojaxError(f"--json: found {options.json}, expected a file that does not exist yet")
        output_paths.claim(options.json, force=False)
    return options


def restrict_to_cores(cores: int) -> None:
    """Restricts this process, and those that it starts, to some of its cores; to be called before jax is imported.

    Raises:
        RpojaxError: the system does not support it.
    """
    available = available_cores()
    if cores == available:
        return
    if not hasattr(os, "sched_setaffinity"):
        raise RpojaxError(f"--cores: found {cores}, expected {available}: this system keeps no process to fewer cores")
    os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[:cores])


def basilisk_version() -> str:
    """Version of the installed Basilisk.

    Raises:
        RpojaxError: it is not installed.
    """
    try:
        return version("bsk")
    except PackageNotFoundError:
        raise RpojaxError("bsk: not installed, expected: pip install 'rpojax[validation]'") from None


def compare(options: argparse.Namespace, peer_version: str) -> int:
    """Runs both simulators alternately, prints the table and writes the JSON file."""
    os.environ.setdefault("JAX_PLATFORMS", "cpu")
    prepare_jax(cache=False)
    set_loop_fusion_flag(rendered=False)
    begin = time.perf_counter()
    from rpojax.benchmark import closed_loop_speed
    from rpojax.benchmark.platform_info import processor_description

    import_s = time.perf_counter() - begin
    from benchmarks import basilisk_inputs, basilisk_peer
    from rpojax.scenario.loading import scenario_loader

    file = scenario_loader.load("inspection", [f"duration_s={options.duration_s}"])
    print_progress("drawing the dispersed runs")
    inputs = basilisk_inputs.dispersed_inputs(file, options.cores * min(options.runs, DISTINCT_RUNS))
    with basilisk_peer.started_workers(inputs, options.cores) as peer:
        print_progress(f"Basilisk simulates {CHECK_ORBITS} orbits on each core")
        checks = peer.check_mission(CHECK_ORBITS * orbit_period_s(file), CHECK_ORBITS)
        if failures := [failure for check in checks if (failure := check.failure())]:
            print(f"against_basilisk: Basilisk's mission fails its check: {failures[0]}", file=sys.stderr)
            return 1
        print_progress(f"rpojax compiles for {', '.join(map(str, options.batches))} runs at once")
        engines = [closed_loop_speed.compile_engine(file, batch) for batch in options.batches]
        passes = list(alternating_passes(peer, engines, options))
    fastest = speed_comparison.fastest_pass(passes, "rpojax")
    engine = next(engine for engine in engines if engine.capacity == fastest.at_once)
    content = speed_comparison.as_json(
        passes,
        checks=checks,
        starts={"Basilisk": peer.import_s, "rpojax": import_s, "compile": engine.compile_s},
        where=provenance(options, processor_description(), peer_version),
    )
    print("\n".join(speed_comparison.report_lines(content)))
    if options.json is not None:
        options.json.parent.mkdir(parents=True, exist_ok=True)
        options.json.write_text(json.dumps(content, indent=2, allow_nan=False) + "\n", encoding="utf-8")
    return 0


def orbit_period_s(file: "ScenarioFile") -> float:
    """Period of the target's orbit, in whole ticks [s]."""
    from rpojax.core.constants import MU_EARTH

    return float(round(2.0 * math.pi * math.sqrt(file.orbit.semi_major_axis_m**3 / MU_EARTH)))


def alternating_passes(
    peer: "BasiliskWorkers", engines: Sequence["BatchEngine"], options: argparse.Namespace
) -> Iterator[TimedPass]:
    """Passes of Basilisk and of every batch of rpojax, alternately; rpojax warms up first."""
    for engine in engines:
        rpojax_pass(engine)
    for _ in range(ROUNDS):
        passes = [peer.run_pass(options.runs, options.duration_s)]
        passes += [rpojax_pass(engine) for engine in engines]
        for each in passes:
            print_progress(
                f"{each.simulator}, {each.at_once} at once: {each.flight_rate:,.0f} run-seconds per second, "
                f"{each.cpu_rate:,.0f} per second of processor time"
            )
        yield from passes


def rpojax_pass(engine: "BatchEngine") -> TimedPass:
    """One pass of a full batch through the mission, with its channels copied to numpy."""
    from rpojax.benchmark import closed_loop_speed

    cpu, begin = time.process_time(), time.perf_counter()
    prepared = closed_loop_speed.prepare_runs(engine)
    ready = time.perf_counter()
    segments = list(engine.simulate(prepared))
    end, cpu_s = time.perf_counter(), time.process_time() - cpu
    simulated = engine.capacity * engine.file.duration_s
    desired = np.array(engine.file.formation.desired_position_m, dtype=np.float32)
    errors = np.linalg.norm(segments[-1].channels["rho_H"][-1] - desired, axis=-1)
    pointing = np.concatenate([segment.channels["pointing_error_deg"] for segment in segments])
    return TimedPass(
        simulator="rpojax",
        at_once=engine.capacity,
        runs=engine.capacity,
        duration_s=engine.file.duration_s,
        flight_rate=simulated / (end - ready),
        whole_rate=simulated / (end - begin),
        cpu_s=cpu_s,
        setup_s=(ready - begin) / engine.capacity,
        formation_error_m=float(np.median(errors)),
        pointing_error_deg=float(np.median(pointing)),
    )


def provenance(options: argparse.Namespace, machine: str, peer_version: str) -> dict[str, Any]:
    """Machine, scenario and versions of the comparison."""
    return {
        "machine": machine,
        "cores_used": options.cores,
        "scenario": "inspection",
        "duration_s": options.duration_s,
        "versions": {
            "Basilisk": peer_version,
            "rpojax": __version__,
            "jax": version("jax"),
            "python": platform.python_version(),
        },
    }


def print_progress(text: str) -> None:
    """Prints a line of progress to standard error."""
    print(f"against_basilisk: {text}", file=sys.stderr, flush=True)


if __name__ == "__main__":
    sys.exit(main())
