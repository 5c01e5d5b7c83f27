"""The command `rpojax lincov`: mean and spread of a scenario's runs without sampling them."""

from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from rpojax.analysis.linear_covariance import linear_covariance as analysis
from rpojax.analysis.linear_covariance.linear_covariance import LinearCovarianceAnalysis
from rpojax.cli.exit_status import Status
from rpojax.cli.options.analysis import LincovCommand
from rpojax.cli.output_paths import claim
from rpojax.cli.scenario_files import load, show_unused_keys
from rpojax.cli.standard_streams import print_json
from rpojax.report.figures import linear_covariance_figures as figures
from rpojax.runtime.progress import stage

_RECORD, _ARRAYS = "lincov.json", "lincov.npz"
_FIGURES = ("formation_error.png", "estimation_error.png", "delta_v.png", "error_budget.png")


def lincov(asked: LincovCommand) -> int:
    """Does the work of the command; returns its exit status."""
    for name in (_RECORD, _ARRAYS, *_FIGURES):
        claim(asked.out / name, asked.force)
    file = load(asked.scenario, asked.overrides, rendered=False)
    show_unused_keys(file, quiet=asked.as_json)
    found = analysis.linear_covariance(
        file, members=asked.members, runs=asked.runs, seed=asked.seed, progress=not asked.as_json
    )
    with stage("drawing figures", quiet=asked.as_json, announce=False):
        _write_figures(found, asked.out)
    found.write(asked.out, asked.force)
    content = found.to_dict()
    if asked.as_json:
        print_json(content)
    else:
        _show(content, asked.out)
    return Status.DONE


def _write_figures(found: LinearCovarianceAnalysis, out: Path) -> None:
    covariance, sample = found.covariance, found.sample
    desired = np.asarray(found.file.formation.desired_position_m)
    decisions = np.arange(len(covariance.burn_probability)) * found.file.rates.formation_period_s
    drawn = (
        figures.formation_error(covariance, desired, sample),
        figures.estimation_error(covariance, sample),
        figures.delta_v(covariance, decisions, sample),
        figures.error_budget(found.budget),
    )
    for name, figure in zip(_FIGURES, drawn, strict=True):
        figures.write_png(figure, out / name)


def _show(content: dict[str, Any], out: Path) -> None:
    console = Console(highlight=False)
    console.print(
        f"{content['scenario']}: linear covariance of {content['settings']['duration_s']:g} s, "
        f"compiled in {content['compile_s']:.1f} s, computed in {content['run_s']:.1f} s"
    )
    for title, table in content["budget"]["at_end"].items():
        shown = Table(title=f"{title} at the end: {content['budget']['total_at_end'][title]:.3f} m, by source")
        shown.add_column("source")
        shown.add_column(r"1 sigma \[m]", justify="right")
        for name, value in sorted(table.items(), key=lambda item: -item[1])[:8]:
            shown.add_row(name, f"{value:.4f}")
        console.print(shown)
    if content["agreement"]:
        shown = Table(title="linear over sampled standard deviation")
        for heading in ("channel", "median", "least", "largest", "within 15 %", "disagrees"):
            shown.add_column(heading, justify="left" if heading == "channel" else "right")
        for row in content["agreement"]:
            numbers = (f"{row['median']:.2f}", f"{row['least']:.2f}", f"{row['largest']:.2f}")
            shown.add_row(
                f"{row['channel']} {row['component']}", *numbers, f"{row['within']:.0%}", f"{row['disagrees']:.0%}"
            )
        console.print(shown)
    for warning in content["warnings"]:
        console.print(f"warning: {warning}", markup=False, soft_wrap=True)
    console.print(f"written: {out}", markup=False, soft_wrap=True)
