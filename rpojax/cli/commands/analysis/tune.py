"""The command `rpojax tune`: flight software tuned by gradient, validated on unseen runs."""

import math
import sys
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from rich.console import Console

from rpojax.analysis.gradients.tuning import tunable_parameters
from rpojax.analysis.gradients.tuning import tune as analysis
from rpojax.analysis.statistics.paired_comparison import MIN_PAIRS
from rpojax.cli.exit_status import Status
from rpojax.cli.options.analysis import TuneCommand
from rpojax.cli.output_paths import claim, resumable
from rpojax.cli.scenario_files import load, show_unused_keys
from rpojax.cli.standard_streams import print_json
from rpojax.cli.terminal_tables import print_table
from rpojax.errors import OutputError
from rpojax.report.labels import format_number, metric_label

SHOWN = (
    "nees_mean",
    "nees_relative_mean",
    "nis_box_mean",
    "nis_gps_mean",
    "nav_relative_position_error_rms_m",
    "nav_servicer_position_error_rms_m",
    "formation_error_rms_m",
    "delta_v_m_s",
    "pointing_error_p95_deg",
)
"""Metrics whose means are printed, beside those with a weight in the scenario."""


def tune(asked: TuneCommand) -> int:
    """Does the work of the command; returns its exit status."""
    settings = replace(asked.settings, parameters=_split_names(asked.parameters or asked.settings.parameters))
    report, progress = asked.out.with_suffix(".json"), asked.out.with_suffix(".progress.json")
    for path, suffix in ((asked.out, ".toml"), (report, ".json")):
        claim(path, asked.force, (suffix,))
    _check_progress(progress, asked.resume, asked.force)
    file = load(asked.scenario, asked.overrides)
    show_unused_keys(file, quiet=asked.session.as_json)

    warning = tunable_parameters.unreached_phases_warning(file, settings)
    if warning is not None and not asked.session.as_json:
        print(f"rpojax: warning: {warning}", file=sys.stderr)
    asked.out.parent.mkdir(parents=True, exist_ok=True)
    with resumable(progress):
        found = analysis.run_tuning(file, settings, progress, resume=asked.resume, progress=not asked.session.as_json)
    found.write(asked.out, asked.force, extends=asked.scenario)
    progress.unlink(missing_ok=True)
    content = found.to_dict()
    if asked.session.as_json:
        print_json(content)
    else:
        _show(content, asked.out, file.tuning.metrics or {})
    return Status.DONE


def _split_names(words: Sequence[str]) -> tuple[str, ...]:
    """Names of groups and keys, from words with commas between names."""
    return tuple(name for word in words for name in word.split(",") if name)


def _check_progress(progress: Path, resume: bool, force: bool) -> None:
    if resume and not progress.exists():
        raise OutputError(f"{progress}: found no tuning to resume, expected one")
    if progress.exists() and not resume and not force:
        raise OutputError(f"{progress}: a tuning is under way; --resume goes on with it, --force begins anew")


def _show(content: dict[str, Any], out: Path, weights: Mapping[str, float]) -> None:
    shown = Console(highlight=False)
    for key, change in content["changes"].items():
        shown.print(f"{key}: {_rounded(change['from'])} -> {_rounded(change['to'])}", markup=False, soft_wrap=True)
    first, last = content["steps"][0], content["steps"][-1]
    times = f"{content['tuning_s']:.0f} s, compilation {content['compile_s']:.0f} s beside it"
    told = f"objective of the first step {first['objective']:.4f}, of the last {last['objective']:.4f}"
    shown.print(f"{told}, which had other runs; {times}, {content['mode']} mode", soft_wrap=True)
    for line in _undefined_lines(content["steps"], content["settings"]["runs"]):
        shown.print(line, soft_wrap=True)
    if judged := content.get("judged"):
        rows = []
        of_sensors = [name for name in judged["means"] if name.startswith("nis_") and "@" not in name]
        for name in dict.fromkeys([*SHOWN, *of_sensors, *weights]):
            if change := judged["means"].get(name):
                label, ends = metric_label(name), change["ratio_95"]
                interval = " to ".join(format_number(end, 3) for end in ends) if ends else format_number(None)
                cells = (
                    format_number(change["first"]),
                    format_number(change["second"]),
                    format_number(change["ratio"], 3),
                    interval,
                )
                rows.append((label.title, label.unit, *cells))
        title = f"{judged['runs']} unseen runs, seed {judged['seed']}: means"
        print_table(
            shown, ("metric", "unit", "start", "tuned", "ratio", "95 % interval"), rows, title=title, words=("unit",)
        )
        shown.print(_failed_line(judged), soft_wrap=True)
        for name, (start, tuned) in judged["undefined"].items():
            if start != tuned:
                shown.print(
                    f"{name} has no value in {start} runs with the start and in {tuned} with the tuned scenario; "
                    "its mean is over the runs that have it in both",
                    soft_wrap=True,
                )
        if verdict := _verdict(judged["means"], weights):
            shown.print(verdict, soft_wrap=True)
    shown.print(f"tuned scenario: {out}")


def _undefined_lines(steps: Sequence[dict[str, Any]], runs: int) -> list[str]:
    """One line for each part of the objective that runs of the descent have no value of."""
    lines = []
    for part in steps[0]["undefined"]:
        counts = [step["undefined"][part] for step in steps]
        if any(counts):
            lines.append(
                f"{part}: no value in {counts[0]} of {runs} runs at the first step and {counts[-1]} at the last "
                f"({sum(counts)} of all {runs * len(steps)}); each counts as the worst"
            )
    return lines


def _failed_line(judged: Mapping[str, Any]) -> str:
    """How many of the judged runs failed with the start and with what was tuned."""
    start, tuned = judged["failed"]
    more = "; the tuned scenario fails in more of them" if tuned > start else ""
    return f"failed runs: {start} of {judged['runs']} with the start, {tuned} with the tuned scenario{more}"


def _verdict(means: dict[str, Any], weights: Mapping[str, float]) -> str:
    """A warning where means got worse, none of them changed significantly, or runs are too few to tell."""
    names = [name for name in SHOWN if not name.startswith(("nees", "nis"))]
    # Less is better, but of metrics with a negative weight.
    signs = {
        **dict.fromkeys(names, 1.0),
        **{name: math.copysign(1.0, weight) for name, weight in weights.items() if weight},
    }
    ends = {
        name: sorted(sign * (end - 1.0) for end in means[name]["ratio_95"])
        for name, sign in signs.items()
        if name in means and means[name]["ratio_95"]
    }
    if not ends:
        return f"No interval: it needs a value in {MIN_PAIRS} runs with both, so that nothing is said beyond chance."
    better = [name for name, (_, high) in ends.items() if high < 0.0]
    worse = [name for name, (low, _) in ends.items() if low > 0.0]
    if not better and not worse:
        widest = max(ends, key=lambda name: max(abs(math.log(end)) for end in means[name]["ratio_95"]))
        low, high = (format_number(end, 3) for end in means[widest]["ratio_95"])
        return (
            "No error or effort differs from the start's beyond chance; what these runs leave open is "
            f"{widest} of {low} to {high} times the start's."
        )
    if worse:
        return f"Beyond chance, worse than the start: {', '.join(worse)}."
    return ""


def _rounded(value: Any) -> Any:
    return [_rounded(each) for each in value] if isinstance(value, list) else float(f"{value:.4g}")
