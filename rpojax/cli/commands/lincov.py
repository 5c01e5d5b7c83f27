"""The command `rpojax lincov`: mean and spread of a scenario's runs without sampling them."""

import dataclasses
import io
import os
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from tyro.conf import arg

from rpojax.cli.arguments import AsJson, NoCache, Out, Overrides, Seed, Source, load
from rpojax.cli.console import print_json
from rpojax.cli.exit_status import Status
from rpojax.cli.output_paths import claim
from rpojax.errors import RpojaxError
from rpojax.runtime.jax_environment import prepare_jax, set_loop_fusion_flag
from rpojax.runtime.progress import busy

if TYPE_CHECKING:
    import numpy as np

    from rpojax.analysis.linear_covariance.error_budget import ErrorBudget
    from rpojax.analysis.linear_covariance.linear_covariance import LinearCovariance
    from rpojax.analysis.linear_covariance.monte_carlo_agreement import ChannelAgreement, MonteCarloSample
    from rpojax.scenario.schema import ScenarioFile

_JSON, _ARRAYS = "lincov.json", "lincov.npz"
_FIGURES = ("formation_error.png", "estimation_error.png", "delta_v.png", "error_budget.png")
_LEAST_RUNS = 10


def lincov(
    scenario: Source,
    *,
    out: Out,
    overrides: Overrides = (),
    runs: Annotated[int, arg(metavar="N", help="Runs to fly for comparison; 0 for none.")] = 0,
    seed: Seed = 0,
    members: Annotated[int, arg(metavar="N", help="Tumbling targets in the ensemble of outlines.")] = 256,
    force: Annotated[bool, arg(help="Replace the files if they are there.")] = False,
    as_json: AsJson = False,
    no_cache: NoCache = False,
) -> int:
    """Mean, spread and error budget of a scenario's runs by linear covariance, without sampling."""
    if runs != 0 and runs < _LEAST_RUNS:
        raise RpojaxError(f"--runs: found {runs}, expected 0 or at least {_LEAST_RUNS}")
    if members < 2:
        raise RpojaxError(f"--members: found {members}, expected at least 2")
    for name in (_JSON, _ARRAYS, *_FIGURES):
        claim(out / name, force)
    # The matrices are small: threads of the linear algebra would only wait for each other.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    file = load(scenario, overrides)
    prepare_jax(cache=not no_cache)
    set_loop_fusion_flag(rendered=False)
    from rpojax.analysis.linear_covariance import error_budget, linear_covariance, monte_carlo_agreement
    from rpojax.campaign import preflight

    preflight.check_numbers(max(runs, 1), 0, seed, None)
    linear_covariance.check_scenario(file)
    with busy("linear covariance", quiet=as_json):
        found = linear_covariance.analyse_scenario(file, members)
    sampled, agreement = None, []
    if runs:
        with busy(f"flying {runs} runs", quiet=as_json):
            sampled = monte_carlo_agreement.simulate_sample(file, runs, seed)
        agreement = monte_carlo_agreement.compare_with_sample(found, sampled)
    budget = error_budget.error_budget(found)
    content = _content(file, members, found, budget, sampled, agreement, seed)
    _write(out, file, found, budget, sampled, content)
    if as_json:
        print_json(content)
    else:
        _show(content, out)
    return Status.DONE


def _content(
    file: "ScenarioFile",
    members: int,
    found: "LinearCovariance",
    budget: "ErrorBudget",
    sampled: "MonteCarloSample | None",
    agreement: "list[ChannelAgreement]",
    seed: int,
) -> dict[str, Any]:
    from rpojax.analysis.linear_covariance.monte_carlo_agreement import CHANNELS

    return {
        "scenario": file.name,
        "settings": {
            "duration_s": file.duration_s,
            "members": members,
            "runs": None if sampled is None else sampled.runs,
            "failed_runs": None if sampled is None else sampled.failed,
            "seed": seed,
        },
        "compile_s": found.compile_s,
        "run_s": found.run_s,
        "run_cpu_s": found.run_cpu_s,
        "sampling_s": None if sampled is None else sampled.run_s,
        "at_end": {
            name: {"mean": found.output_mean(name)[-1].tolist(), "sigma": found.sigma(name)[-1].tolist()}
            for name in CHANNELS
        },
        "left_out": found.left_out,
        "burn_probability": found.burn_probability.tolist(),
        "budget": dataclasses.asdict(budget),
        "agreement": [dataclasses.asdict(row) for row in agreement],
        "warnings": _warnings(found, agreement),
    }


def _warnings(found: "LinearCovariance", agreement: "list[ChannelAgreement]") -> list[str]:
    """What a reader should know before trusting the numbers."""
    warnings = [f"{name}: its spread is too large for a derivative; left out" for name in found.left_out]
    return warnings + [
        f"{row.channel} {row.component}".strip()
        + f": off by more than 15 % and sampling together at {row.disagrees:.0%} of the times, "
        f"ratio {row.least:.2f} at {row.least_at_s:g} s to {row.largest:.2f} at {row.largest_at_s:g} s; "
        "the loop is not linear there"
        for row in agreement
        if row.disagrees > 0.0
    ]


def _write(
    out: Path,
    file: "ScenarioFile",
    found: "LinearCovariance",
    budget: "ErrorBudget",
    sampled: "MonteCarloSample | None",
    content: dict[str, Any],
) -> None:
    import numpy as np

    from rpojax.campaign.storage.output_files import write_atomically, write_json
    from rpojax.report.figures import linear_covariance_figures as figures

    desired = np.asarray(file.formation.desired_position_m)
    decisions = np.arange(len(found.burn_probability)) * file.rates.formation_period_s
    drawn = (
        figures.formation_error(found, desired, sampled),
        figures.estimation_error(found, sampled),
        figures.delta_v(found, decisions, sampled),
        figures.error_budget(budget),
    )
    for name, figure in zip(_FIGURES, drawn, strict=True):
        figures.write_png(figure, out / name)
    stream = io.BytesIO()
    np.savez_compressed(stream, allow_pickle=False, **_arrays(found))
    write_atomically(out / _ARRAYS, stream.getvalue())
    write_json(out / _JSON, content)


def _arrays(found: "LinearCovariance") -> "dict[str, np.ndarray]":
    import numpy as np

    from rpojax.analysis.linear_covariance.linearised_loop import OUTPUTS

    names = ("rho_H", "rho_dot_H", "relative_error_H", "relative_rate_error_H", "servicer_error_H", "delta_v_m_s")
    return {
        "time_s": found.time_s,
        **{name: found.output_mean(name) for name in names},
        **{f"{name}_sigma": found.sigma(name) for name in names},
        # Six of truth, six of the error of the estimate.
        "covariance": found.covariance[:, : OUTPUTS["servicer_error_H"].start, : OUTPUTS["servicer_error_H"].start],
        "filter_sigma_H": found.filter_sigma_H,
        "sources": np.array(found.sources),
        "share_time_s": found.share_time_s,
        "shares": found.shares,
    }


def _show(content: dict[str, Any], out: Path) -> None:
    from rich.console import Console
    from rich.table import Table

    console = Console(highlight=False)
    console.print(
        f"{content['scenario']}: linear covariance of {content['settings']['duration_s']:g} s, "
        f"compiled in {content['compile_s']:.1f} s, worked out in {content['run_s']:.1f} s"
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
