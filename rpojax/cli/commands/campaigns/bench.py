"""The command `rpojax bench`: speed of the closed loop, its kernels and the rendered camera on this machine."""

import contextlib
import json
import subprocess
import sys
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Annotated, Any

from tyro.conf import arg

from rpojax.cli.arguments import AsJson, Overrides, Source, load
from rpojax.cli.console import show_unused_keys
from rpojax.cli.exit_status import Status
from rpojax.cli.standard_streams import print_json
from rpojax.errors import RpojaxError, ScenarioError
from rpojax.runtime.jax_environment import environment_without_loop_fusion, prepare_jax, set_loop_fusion_flag
from rpojax.runtime.progress import stage

if TYPE_CHECKING:
    from rich.table import Table

    from rpojax.scenario.schema import ScenarioFile

_DURATION_S = 800.0
"""Simulated time of a run where a scenario accepts it [s]."""

PARTS = {
    "loop": "the closed loop",
    "kernels": "bare orbits and the orbit filter",
    "vision": "pictures of the packaged target and the detector",
}
"""Part of the benchmark -> what it measures."""


def bench(
    scenario: Source = "inspection",
    *,
    overrides: Overrides = (),
    runs: Annotated[
        tuple[int, ...],
        arg(
            metavar="N",
            help="Batch sizes of the closed loop.",
            help_behavior_hint="(default: 1, 64, 512, 2048 and what a campaign takes at once)",
        ),
    ] = (),
    duration_s: Annotated[
        float | None,
        arg(
            metavar="T",
            help="Simulated time of a run [s].",
            help_behavior_hint=f"(default: {_DURATION_S:g}, doubled as often as the scenario's phases need)",
        ),
    ] = None,
    only: Annotated[str, arg(metavar="PARTS", help="Parts to measure.")] = ",".join(PARTS),
    as_json: AsJson = False,
) -> int:
    """Measure the speed of the closed loop (without metrics and storage), its kernels and rendered pictures.

    Programs are compiled anew.
    """
    parts = _chosen_parts(only)
    if parts == ["vision"] and (overrides or scenario != "inspection"):
        expected = "loop or kernels, too: its pictures are those of the packaged target in any scenario"
        raise RpojaxError.of_argument("only", f"found 'vision' with a scenario or --set, expected {expected}")
    file = _load_for(duration_s, scenario, overrides)
    show_unused_keys(file, quiet=as_json)
    prepare_jax(cache=False)
    # XLA reads its fusion options once per process, and rendering is faster with others.
    apart = len(parts) > 1 and "vision" in parts
    set_loop_fusion_flag(rendered=parts == ["vision"] or file.camera.model == "rendered")
    from rpojax.benchmark import closed_loop_speed, filter_speed, suite
    from rpojax.benchmark.platform_info import platform_info

    batches = runs or closed_loop_speed.default_batches(file)
    closed_loop_speed.check_batches(batches)
    if "kernels" in parts:
        filter_speed.check_filter(file)
    found: dict[str, Any] = {}
    for part in parts:
        with stage(f"measuring {PARTS[part]}", quiet=as_json):
            found |= _vision_in_own_process() if apart and part == "vision" else suite.PARTS[part](file, batches)
    found |= platform_info()
    if as_json:
        print_json(found)
    else:
        show(found)
    return Status.DONE


def _load_for(duration_s: float | None, scenario: str, overrides: Sequence[str]) -> "ScenarioFile":
    """The scenario with runs of a duration [s], by default those of the benchmark, doubled until it accepts them.

    Raises:
        RpojaxError: it is invalid, or refuses that duration.
    """
    try:
        return load(scenario, (f"duration_s={_DURATION_S if duration_s is None else duration_s}", *overrides))
    except ScenarioError as error:
        own = load(scenario, overrides)
        if duration_s is None:
            longer = 2.0 * _DURATION_S
            while longer < own.duration_s:
                with contextlib.suppress(ScenarioError):
                    return load(scenario, (f"duration_s={longer}", *overrides))
                longer *= 2.0
            return own
        expected = f"one that the scenario accepts, such as its own {own.duration_s:g}"
        raise RpojaxError.of_argument("duration_s", f"found {duration_s:g}, expected {expected} ({error})") from None


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
    from rich.console import Console

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


def _loop(found: Mapping[str, Any]) -> "Table":
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


def _kernels(found: Mapping[str, Any]) -> "Table":
    table = _table("kernels, float64", ("kernel", "batch", "devices", "compile [s]", "run [s]", "cpu [s]", "speed"))
    orbit, updates = found["orbit"], found["filter"]
    _row(table, "orbit, J2", orbit, orbit["vehicles"], f"{orbit['vehicle_steps_per_s'] / 1e6:,.1f} M steps/s")
    for entry in updates["batches"]:
        _row(table, "orbit filter", entry, entry["batch"], f"{entry['us_per_update']:.2f} us per update")
    return table


def _row(table: "Table", name: str, entry: Mapping[str, Any], batch: int, speed: str) -> None:
    times = (f"{entry['compile_s']:.1f}", f"{entry['run_s']:.3g}", f"{entry['cpu_s']:.3g}")
    table.add_row(name, str(batch), str(entry["devices"]), *times, speed)


def _vision(found: Mapping[str, Any]) -> "Table":
    title = f"rendered camera, {found['side_px']} x {found['side_px']} px, target at {found['range_m']:g} m"
    table = _table(title, ("work", "batch", "devices", "compile [s]", "run [s]", "cpu [s]", "pictures/s"))
    for name, verb, rate in (("picture", "render", "frames_per_s"), ("detection", "detect", "detections_per_s")):
        times = {"compile_s": found[f"{verb}_compile_s"], "run_s": found[f"{verb}_s"], "cpu_s": found[f"{verb}_cpu_s"]}
        _row(table, name, {**found, **times}, found["batch"], f"{found[rate]:,.0f}")
    return table


def _table(title: str, headings: Sequence[str]) -> "Table":
    from rich.table import Table
    from rich.text import Text

    table = Table(title=Text(title))
    for number, heading in enumerate(headings):
        # Headings may wrap; a Text, since rich would read a unit in brackets as markup.
        side = "left" if number == 0 and heading in ("kernel", "work") else "right"
        table.add_column(Text(heading), justify=side)
    return table
