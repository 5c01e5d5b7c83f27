"""Basilisk and rpojax fly the same mission in turn on the same cores; prints by how much one of them is faster.

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

from benchmarks import comparison
from benchmarks.comparison import Pass
from rpojax.cli import output_paths
from rpojax.cli.arguments import Status
from rpojax.errors import RpojaxError
from rpojax.runtime.jax_environment import available_cores, prepare_jax, prepare_loop
from rpojax.version import __version__

if TYPE_CHECKING:
    from benchmarks.basilisk_peer import Peer
    from rpojax.campaign.execution.batch_engine import Engine
    from rpojax.scenario.schema import ScenarioFile

ROUNDS = 6
"""Turns of each simulator; the faster one counts."""

ORBITS = 3
"""Flown by Basilisk before anything is timed, to show that its mission is one."""

DISTINCT = 16
"""Dispersed runs that each of Basilisk's processes knows; it begins again with the first after the last."""


def main(argv: Sequence[str] | None = None) -> int:
    """Exit status: 0, 1 where Basilisk does not fly the mission, 2 for a bad option or a missing package."""
    try:
        given = options(argv)
        peer_version = basilisk_version()
        keep_to(given.cores)
        return compare(given, peer_version)
    except RpojaxError as error:
        print(f"against_basilisk: {error}", file=sys.stderr)
        return Status.BAD_INPUT
    except KeyboardInterrupt:
        print("against_basilisk: interrupted", file=sys.stderr)
        return Status.INTERRUPTED


def options(argv: Sequence[str] | None = None) -> argparse.Namespace:
    """Command line, checked.

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
    given = parser.parse_args(argv)
    given.batches = sorted({128 * given.cores, 256 * given.cores}) if given.batches is None else given.batches
    comparison.check_options(given.cores, cores, given.runs, given.duration_s, given.batches)
    if given.json is not None:
        if given.json.exists():
            raise RpojaxError(f"--json: found {given.json}, expected a file that does not exist yet")
        output_paths.claim(given.json, force=False)
    return given


def keep_to(cores: int) -> None:
    """Keeps this process, and those that it starts, to some of its cores; to be called before jax is imported.

    Raises:
        RpojaxError: the system cannot do so.
    """
    available = available_cores()
    if cores == available:
        return
    if not hasattr(os, "sched_setaffinity"):
        raise RpojaxError(f"--cores: found {cores}, expected {available}: this system keeps no process to fewer cores")
    os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[:cores])


def basilisk_version() -> str:
    """Version of the installed package.

    Raises:
        RpojaxError: there is none.
    """
    try:
        return version("bsk")
    except PackageNotFoundError:
        raise RpojaxError("bsk: not installed, expected: pip install 'rpojax[validation]'") from None


def compare(given: argparse.Namespace, peer_version: str) -> int:
    """Flies both in turn, prints the table and writes the JSON."""
    os.environ.setdefault("JAX_PLATFORMS", "cpu")
    prepare_jax(cache=False)
    prepare_loop(rendered=False)
    begin = time.perf_counter()
    from rpojax.benchmark import closed_loop_speed, suite

    import_s = time.perf_counter() - begin
    from benchmarks import basilisk_inputs, basilisk_peer
    from rpojax.scenario import scenario_file

    file = scenario_file.load("inspection", [f"duration_s={given.duration_s}"])
    tell("drawing the runs")
    inputs = basilisk_inputs.draw(file, given.cores * min(given.runs, DISTINCT))
    with basilisk_peer.started(inputs, given.cores) as peer:
        tell(f"Basilisk flies {ORBITS} orbits on each core")
        proofs = peer.prove(ORBITS * orbit_s(file), ORBITS)
        if faults := [fault for proof in proofs if (fault := proof.fault())]:
            print(f"against_basilisk: Basilisk does not fly the mission: {faults[0]}", file=sys.stderr)
            return 1
        tell(f"rpojax compiles for {', '.join(map(str, given.batches))} runs at once")
        engines = [closed_loop_speed.prepare(file, batch) for batch in given.batches]
        passes = list(in_turn(peer, engines, given))
    ours = comparison.best(passes, "rpojax")
    used = next(engine for engine in engines if engine.capacity == ours.at_once)
    content = comparison.as_json(
        passes,
        proofs=proofs,
        starts={"Basilisk": peer.import_s, "rpojax": import_s, "compile": used.compile_s},
        where=whereabouts(given, suite.machine(), peer_version),
    )
    print("\n".join(comparison.report(content)))
    if given.json is not None:
        given.json.parent.mkdir(parents=True, exist_ok=True)
        given.json.write_text(json.dumps(content, indent=2, allow_nan=False) + "\n", encoding="utf-8")
    return 0


def orbit_s(file: "ScenarioFile") -> float:
    """Period of the target's orbit, in whole ticks [s]."""
    from rpojax.core.constants import MU_EARTH

    return float(round(2.0 * math.pi * math.sqrt(file.orbit.semi_major_axis_m**3 / MU_EARTH)))


def in_turn(peer: "Peer", engines: Sequence["Engine"], given: argparse.Namespace) -> Iterator[Pass]:
    """Passes of Basilisk and of every batch of rpojax, again and again; the first ones of rpojax do not count."""
    for engine in engines:
        rpojax_pass(engine)
    for _ in range(ROUNDS):
        flown = [peer.fly(given.runs, given.duration_s)]
        flown += [rpojax_pass(engine) for engine in engines]
        for one in flown:
            tell(
                f"{one.simulator}, {one.at_once} at once: {one.flight_rate:,.0f} run-seconds per second, "
                f"{one.cpu_rate:,.0f} per second of processor time"
            )
        yield from flown


def rpojax_pass(engine: "Engine") -> Pass:
    """A full batch through the mission, with its channels brought to numpy."""
    from rpojax.benchmark import closed_loop_speed

    cpu, begin = time.process_time(), time.perf_counter()
    block = closed_loop_speed.block(engine)
    ready = time.perf_counter()
    segments = list(engine.run(block))
    end, cpu_s = time.perf_counter(), time.process_time() - cpu
    simulated = engine.capacity * engine.file.duration_s
    wanted = np.array(engine.file.formation.desired_position_m, dtype=np.float32)
    errors = np.linalg.norm(segments[-1].channels["rho_H"][-1] - wanted, axis=-1)
    pointing = np.concatenate([segment.channels["pointing_error_deg"] for segment in segments])
    return Pass(
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


def whereabouts(given: argparse.Namespace, machine: str, peer_version: str) -> dict[str, Any]:
    """What was used."""
    return {
        "machine": machine,
        "cores_used": given.cores,
        "scenario": "inspection",
        "duration_s": given.duration_s,
        "versions": {
            "Basilisk": peer_version,
            "rpojax": __version__,
            "jax": version("jax"),
            "python": platform.python_version(),
        },
    }


def tell(text: str) -> None:
    """Progress, on stderr."""
    print(f"against_basilisk: {text}", file=sys.stderr, flush=True)


if __name__ == "__main__":
    sys.exit(main())
