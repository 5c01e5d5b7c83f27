"""The command `rpojax bench`: speed of the closed loop, its kernels and the rendered camera on this machine."""

import contextlib
import json
import subprocess
import sys
from collections.abc import Mapping, Sequence
from typing import Any

from rich.console import Console
from rich.table import Table
from rich.text import Text

from rpojax.benchmark import closed_loop_speed, filter_speed, suite
from rpojax.benchmark.platform_info import platform_info
from rpojax.cli.exit_status import Status
from rpojax.cli.options.campaigns import BENCH_DURATION_S, PARTS, BenchCommand
from rpojax.cli.scenario_files import load, show_unused_keys
from rpojax.cli.standard_streams import print_json
from rpojax.errors import RpojaxError, ScenarioError
from rpojax.runtime.jax_environment import environment_without_loop_fusion
from rpojax.runtime.progress import stage
from rpojax.scenario.schema import ScenarioFile


def bench(asked: BenchCommand) -> int:
    """Does the work of the command; returns its exit status."""
    parts = _chosen_parts(asked.only)
    if parts == ["vision"] and (asked.overrides or asked.scenario != "inspection"):
        expected = "loop or kernels, too: its pictures are those of the packaged target in any scenario"
        raise RpojaxError.of_argument("only", f"found 'vision' with a scenario or --set, expected {expected}")
    # XLA reads its fusion options once per process, and rendering is faster with others.
    rendered = True if parts == ["vision"] else None
    file = _load_for(asked, rendered)
    show_unused_keys(file, quiet=asked.as_json)
    apart = len(parts) > 1 and "vision" in parts
    batches = asked.runs or closed_loop_speed.default_batches(file)
    closed_loop_speed.check_batches(batches)
    if "kernels" in parts:
        filter_speed.check_filter(file)
    found: dict[str, Any] = {}
    for part in parts:
        with stage(f"measuring {PARTS[part]}", quiet=asked.as_json):
            found |= _vision_in_own_process() if apart and part == "vision" else suite.PARTS[part](file, batches)
    found |= platform_info()
    if asked.as_json:
        print_json(found)
    else:
        show(found)
    return Status.DONE


def _load_for(asked: BenchCommand, rendered: bool | None) -> ScenarioFile:
    """The scenario with runs of the asked duration, by default those of the benchmark, doubled until it accepts them.

    Raises:
        RpojaxError: it is invalid, or refuses that duration.
    """

    def with_duration(duration_s: float) -> ScenarioFile:
        return load(asked.scenario, (f"duration_s={duration_s}", *asked.overrides), rendered)

    try:
        return with_duration(BENCH_DURATION_S if asked.duration_s is None else asked.duration_s)
    except ScenarioError as error:
        own = load(asked.scenario, asked.overrides, rendered)
        if asked.duration_s is None:
            longer = 2.0 * BENCH_DURATION_S
            while longer < own.duration_s:
                with contextlib.suppress(ScenarioError):
                    return with_duration(longer)
                longer *= 2.0
            return own
        expected = f"one that the scenario accepts, such as its own {own.duration_s:g}"
        found = f"found {asked.duration_s:g}, expected {expected} ({error})"
        raise RpojaxError.of_argument("duration_s", found) from None


def _vision_in_own_process() -> dict[str, Any]:
    """Figures of rendering and detection, measured in a separate process."""
    words = [sys.executable, "-m", "rpojax", "bench", "--only", "vision", "--json"]
    done = subprocess.run(words, env=environment_without_loop_fusion(), capture_output=True, text=True, check=False)
    if done.returncode:
        raise RpojaxError(f"--only vision: found {done.stderr.strip()[-200:]!r}, expected figures")
    return {"vision": json.loads(done.stdout)["vision"]}


def _chosen_parts(only: str) -> list[str]:
    """Parts named in a comma-separated list, without repetition, in order of measurement."""
    names = [name.strip() for name in only.split(",")]
    for name in names:
        if name not in PARTS:
            raise RpojaxError.of_argument("only", f"found {name!r}, expected some of {','.join(PARTS)}")
    return [part for part in PARTS if part in names]


def show(found: Mapping[str, Any]) -> None:
    """Prints one table per measured part, and the machine."""
    to = Console(highlight=False)
    if "batches" in found:
        to.print(_loop(found))
    if "kernels" in found:
        to.print(_kernels(found["kernels"]))
    if "vision" in found:
        to.print(_vision(found["vision"]))
    if size := found.get("recommended_block_size"):
        to.print(f"a block size of {size} is faster here than {found['block_size']}: --block-size {size}")
    to.print(f"peak memory: {found['peak_memory_mib']:,.0f} MiB")
    to.print(f"machine: {found['machine']}", soft_wrap=True, markup=False)


def _loop(found: Mapping[str, Any]) -> Table:
    table = _table(
        f"closed loop, {found['scenario']}, {found['duration_s']:g} s",
        ("batch", "devices", "compile (loop) [s]", "cached [s]", "run [s]", "cpu [s]", "run-s/s", "runs of 3000 s/h"),
    )
    for entry in found["batches"]:
        table.add_row(
            str(entry["batch"]),
            str(entry["devices"]),
            f"{entry['compile_s']:.1f} ({entry['loop_compile_s']:.1f})",
            f"{entry['compile_cached_s']:.1f}",
            f"{entry['run_s']:.3g}",
            f"{entry['cpu_s']:.3g}",
            f"{entry['run_seconds_per_s']:,.0f}",
            f"{entry['runs_per_hour']:,.0f}",
        )
    return table


def _kernels(found: Mapping[str, Any]) -> Table:
    table = _table("kernels, float64", ("kernel", "batch", "devices", "compile [s]", "run [s]", "cpu [s]", "speed"))
    orbit, updates = found["orbit"], found["filter"]
    _row(table, "orbit, J2", orbit, orbit["vehicles"], f"{orbit['vehicle_steps_per_s'] / 1e6:,.1f} M steps/s")
    for entry in updates["batches"]:
        _row(table, "orbit filter", entry, entry["batch"], f"{entry['us_per_update']:.2f} us per update")
    return table


def _row(table: Table, name: str, entry: Mapping[str, Any], batch: int, speed: str) -> None:
    times = (f"{entry['compile_s']:.1f}", f"{entry['run_s']:.3g}", f"{entry['cpu_s']:.3g}")
    table.add_row(name, str(batch), str(entry["devices"]), *times, speed)


def _vision(found: Mapping[str, Any]) -> Table:
    title = f"rendered camera, {found['side_px']} x {found['side_px']} px, target at {found['range_m']:g} m"
    table = _table(title, ("work", "batch", "devices", "compile [s]", "run [s]", "cpu [s]", "pictures/s"))
    for name, verb, rate in (("picture", "render", "frames_per_s"), ("detection", "detect", "detections_per_s")):
        times = {"compile_s": found[f"{verb}_compile_s"], "run_s": found[f"{verb}_s"], "cpu_s": found[f"{verb}_cpu_s"]}
        _row(table, name, {**found, **times}, found["batch"], f"{found[rate]:,.0f}")
    return table


def _table(title: str, headings: Sequence[str]) -> Table:
    table = Table(title=Text(title))
    for number, heading in enumerate(headings):
        # Headings may wrap; a Text, since rich would read a unit in brackets as markup.
        side = "left" if number == 0 and heading in ("kernel", "work") else "right"
        table.add_column(Text(heading), justify=side)
    return table
