"""The command `rpojax bridge`: a run simulated live with external ROS 2 nodes."""

import math
import sys
from dataclasses import replace
from typing import Any

from rich.console import Console
from rich.table import Table

from rpojax.campaign import argument_checks
from rpojax.cli.exit_status import Status
from rpojax.cli.options.output import BridgeCommand
from rpojax.cli.scenario_files import load, show_unused_keys
from rpojax.cli.standard_streams import print_json
from rpojax.interop.cosimulation import live_run
from rpojax.interop.cosimulation.live_run import LiveRunResult
from rpojax.interop.cosimulation.live_settings import LiveSettings
from rpojax.report.labels import format_number, in_display_order, metric_label
from rpojax.scenario.schema import ScenarioFile


def bridge(asked: BridgeCommand) -> int:
    """Does the work of the command; returns its exit status."""
    file = load(asked.scenario, asked.overrides)
    show_unused_keys(file, quiet=asked.session.as_json)
    argument_checks.check_numbers(1, asked.run_id, asked.seed, None)
    settings = replace(asked.settings, send_images=not asked.no_pictures)

    outcome = live_run.simulate_live(
        file, asked.seed, asked.run_id, settings, lambda line: print(f"rpojax: {line}", file=sys.stderr, flush=True)
    )
    content = _content(file, asked.seed, asked.run_id, settings, outcome)
    if asked.session.as_json:
        print_json(content)
    else:
        _show(content)
    if outcome.failure:
        return Status.SOME_FAILED
    return Status.DONE if outcome.outcome is not None else Status.UNFINISHED


def _content(
    file: ScenarioFile, seed: int, run_id: int, settings: LiveSettings, outcome: LiveRunResult
) -> dict[str, Any]:
    events = outcome.events
    ignored: dict[str, dict[str, int]] = {}
    for (topic, reason), count in sorted(events.ignored.items()):
        ignored.setdefault(topic, {})[reason] = count
    return {
        "scenario": file.name,
        "seed": seed,
        "run_id": run_id,
        "external": sorted(settings.external_stages),
        "real_time": settings.real_time_factor,
        "completed": outcome.outcome == "completed",
        "outcome": outcome.outcome,
        "failure": outcome.failure or None,
        "stopped": outcome.stop_reason or None,
        "ticks": outcome.ticks,
        "steps": outcome.steps,
        "simulated_s": outcome.simulated_s,
        "wall_s": outcome.wall_s,
        "cpu_s": outcome.cpu_s,
        "times_real_time": outcome.simulated_s / outcome.wall_s if outcome.wall_s > 0.0 else None,
        "lag_s": outcome.lag_s,
        "late": dict(sorted(events.late.items())),
        "ignored": ignored,
        "limited": dict(sorted(events.limited.items())),
        "sent": {name: count for name, count in outcome.sent.items() if count},
        "unsent": outcome.unsent,
        "received": dict(outcome.received),
        "metrics": {name: _number(value) for name, value in outcome.metrics.items()} or None,
    }


def _number(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _show(content: dict[str, Any]) -> None:
    console = Console(highlight=False)
    end = content["failure"] or content["stopped"] or str(content["outcome"]).replace("_", " ")
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
