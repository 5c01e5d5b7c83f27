"""The verb `rpojax bridge`: a run flown live with other people's ROS 2 nodes."""

import math
import sys
from typing import TYPE_CHECKING, Annotated, Any, Literal

from tyro.conf import arg

from rpojax.cli.arguments import AsJson, NoCache, Overrides, Seed, Source, load
from rpojax.cli.console import print_json
from rpojax.cli.exit_status import Status
from rpojax.runtime.jax_environment import prepare_jax, set_loop_fusion_flag

if TYPE_CHECKING:
    from rpojax.interop.cosimulation.live_run import LiveRunResult
    from rpojax.interop.cosimulation.live_settings import LiveSettings
    from rpojax.scenario.schema import ScenarioFile


def bridge(
    scenario: Source,
    *,
    seed: Seed = 0,
    run_id: Annotated[int, arg(metavar="I", help="Number of the run in its campaign.")] = 0,
    overrides: Overrides = (),
    external: Annotated[
        str,
        arg(metavar="A,B,...", help="Flight software left to others: attitude, formation, navigation, all."),
    ] = "none",
    domain_id: Annotated[int, arg(metavar="N", help="DDS domain, as ROS_DOMAIN_ID.")] = 0,
    on_late: Annotated[
        Literal["hold", "zero", "stop"],
        arg(help="What becomes of a late command: the last one holds, there is none, or the run stops."),
    ] = "hold",
    timeout_s: Annotated[float, arg(metavar="T", help="After which a command is late, by the wall clock [s].")] = 1.0,
    wait_s: Annotated[
        float, arg(metavar="T", help="How long to wait for the other side at the start [s]; 0 to start at once.")
    ] = 30.0,
    patience_s: Annotated[float, arg(metavar="T", help="Without any command for so long the run ends [s].")] = 30.0,
    real_time: Annotated[
        float | None,
        arg(
            metavar="FACTOR",
            help="Follow the wall clock, so many times faster.",
            help_behavior_hint="(default: in lockstep, as fast as the answers come)",
        ),
    ] = None,
    no_pictures: Annotated[bool, arg(help="Send no pictures of a rendered camera.")] = False,
    as_json: AsJson = False,
    no_cache: NoCache = False,
) -> int:
    """Fly one run live over DDS, in the words of ROS 2, with parts of the flight software left to other nodes.

    Exit status beside the usual: 3 the run failed, 4 it was not flown to its end, as the other side fell silent.
    """
    file = load(scenario, overrides)
    prepare_jax(cache=not no_cache)
    set_loop_fusion_flag(rendered=file.camera.model == "rendered")
    from rpojax.interop.cosimulation import live_settings

    settings = live_settings.LiveSettings(
        external_stages=live_settings.parse_external_stages(external),
        domain_id=domain_id,
        on_late=on_late,
        timeout_s=timeout_s,
        wait_s=wait_s,
        patience_s=patience_s,
        real_time_factor=real_time,
        pictures=not no_pictures,
    )
    from rpojax.campaign import preflight

    preflight.check_numbers(1, run_id, seed, None)
    from rpojax.interop.cosimulation import live_run

    outcome = live_run.simulate_live(
        file, seed, run_id, settings, lambda line: print(f"rpojax: {line}", file=sys.stderr, flush=True)
    )
    content = _content(file, seed, run_id, settings, outcome)
    if as_json:
        print_json(content)
    else:
        _show(content)
    if outcome.failure:
        return Status.SOME_FAILED
    return Status.DONE if outcome.completed else Status.UNFINISHED


def _content(
    file: "ScenarioFile", seed: int, run_id: int, settings: "LiveSettings", outcome: "LiveRunResult"
) -> dict[str, Any]:
    ledger = outcome.events
    ignored: dict[str, dict[str, int]] = {}
    for (topic, reason), count in sorted(ledger.ignored.items()):
        ignored.setdefault(topic, {})[reason] = count
    return {
        "scenario": file.name,
        "seed": seed,
        "run_id": run_id,
        "external": sorted(settings.external_stages),
        "real_time": settings.real_time_factor,
        "completed": outcome.completed,
        "failure": outcome.failure or None,
        "stopped": outcome.stop_reason or None,
        "ticks": outcome.ticks,
        "steps": outcome.steps,
        "simulated_s": outcome.simulated_s,
        "wall_s": outcome.wall_s,
        "cpu_s": outcome.cpu_s,
        "times_real_time": outcome.simulated_s / outcome.wall_s if outcome.wall_s > 0.0 else None,
        "lag_s": outcome.lag_s,
        "late": dict(sorted(ledger.late.items())),
        "ignored": ignored,
        "limited": dict(sorted(ledger.limited.items())),
        "sent": {name: count for name, count in outcome.sent.items() if count},
        "unsent": outcome.unsent,
        "received": dict(outcome.received),
        "metrics": {name: _number(value) for name, value in outcome.metrics.items()} or None,
    }


def _number(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _show(content: dict[str, Any]) -> None:
    from rich.console import Console
    from rich.table import Table

    from rpojax.report.labels import format_number, in_display_order, metric_label

    console = Console(highlight=False)
    end = content["failure"] or content["stopped"] or "flown to its end"
    speed = content["times_real_time"] or 0.0
    console.print(f"{content['scenario']}: {content['simulated_s']:g} s, {speed:.0f} times real time, {end}")
    for topic, count in content["late"].items():
        console.print(f"{topic}: {count} commands late", markup=False)
    for topic, reasons in content["ignored"].items():
        told = ", ".join(f"{count} {reason}" for reason, count in reasons.items())
        console.print(f"{topic}: ignored {told}", markup=False)
    for topic, count in content["limited"].items():
        console.print(f"{topic}: {count} commands beyond the limit of the drive", markup=False)
    if content["metrics"] is None:
        return
    table = Table()
    for heading in ("metric", "value", "unit"):
        table.add_column(heading, justify="right" if heading == "value" else "left")
    for name in in_display_order(content["metrics"]):
        shown = metric_label(name)
        table.add_row(shown.title, format_number(content["metrics"][name]), shown.unit)
    console.print(table)
