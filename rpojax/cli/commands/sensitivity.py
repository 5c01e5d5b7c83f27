"""The command `rpojax sensitivity`: which dispersions make the spread of a metric, from derivatives."""

import dataclasses
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from tyro.conf import UseAppendAction, arg

from rpojax.cli.arguments import AsJson, NoCache, Overrides, Seed, Source, load
from rpojax.cli.console import print_json
from rpojax.cli.exit_status import Status
from rpojax.cli.output_paths import claim
from rpojax.runtime.jax_environment import prepare_jax, set_loop_fusion_flag
from rpojax.runtime.progress import busy

if TYPE_CHECKING:
    from rpojax.analysis.reliability.derivative_sensitivity import MetricSensitivity, RankingAgreement
    from rpojax.campaign.storage.campaign_folder import Campaign
    from rpojax.dispersions.standard_normal_space import StandardNormalSpace


def sensitivity(
    scenario: Source,
    *,
    metric: Annotated[
        UseAppendAction[tuple[str, ...]],
        arg(
            metavar="NAME",
            help="Metric; several may follow.",
            help_behavior_hint="(default: those of the scenario's requirements)",
        ),
    ] = (),
    runs: Annotated[int, arg(metavar="N", help="Runs with random dispersions, beside the median one.")] = 16,
    campaign: Annotated[
        Path | None, arg(metavar="DIR", help="Finished campaign whose ranking by sampling is put beside.")
    ] = None,
    seed: Seed = 0,
    overrides: Overrides = (),
    out: Annotated[
        Path | None, arg(metavar="FILE", help="JSON file to write.", help_behavior_hint="(default: none)")
    ] = None,
    force: Annotated[bool, arg(help="Replace the file if it is there.")] = False,
    as_json: AsJson = False,
    no_cache: NoCache = False,
) -> int:
    """Which dispersions make the spread of a metric, from derivatives of a handful of runs."""
    if out is not None:
        claim(out, force, (".json",))
    file = load(scenario, overrides)
    prepare_jax(cache=not no_cache)
    set_loop_fusion_flag(rendered=file.camera.model == "rendered")
    from rpojax.analysis.reliability import derivative_sensitivity as analysis
    from rpojax.campaign.storage.campaign_folder import Campaign
    from rpojax.campaign.storage.json_types import to_json_types
    from rpojax.campaign.storage.output_files import write_json
    from rpojax.dispersions import standard_normal_space

    metrics, space = analysis.select_metrics(file, metric), standard_normal_space.make_space(file)
    sampled = None if campaign is None else Campaign(campaign)
    with busy("compiling flights and their derivatives (a minute or two), then flying", quiet=as_json):
        found = analysis.derivative_sensitivities(space, metrics, runs, seed)
    beside = [None if sampled is None else _beside(one, space, sampled) for one in found]
    content = to_json_types(
        {
            "scenario": file.name,
            "seed": seed,
            "runs": runs,
            "held": list(space.unmapped),
            "metrics": [_entry(one, other) for one, other in zip(found, beside, strict=True)],
        }
    )
    if out is not None:
        write_json(out, content)
    if as_json:
        print_json(content)
    else:
        _show(found, beside, space)
    return Status.DONE


def _beside(found: "MetricSensitivity", space: "StandardNormalSpace", sampled: "Campaign") -> "RankingAgreement | None":
    import numpy as np

    from rpojax.analysis.reliability import derivative_sensitivity as analysis
    from rpojax.scenario import dispersion_keys

    if found.metric not in sampled.metrics:
        return None
    columns = {
        name: column
        for name, column in dispersion_keys.component_columns(sampled.drawn).items()
        if np.isfinite(column).all()
    }
    return analysis.compare_with_sampling(found, space, columns, sampled.metrics[found.metric])


def _entry(found: "MetricSensitivity", beside: "RankingAgreement | None") -> dict[str, Any]:
    """Part of the JSON about one metric."""
    import numpy as np

    return {
        "metric": found.metric,
        "unit": found.unit,
        "runs_used": len(found.values),
        "mean": float(np.mean(found.values)),
        "sigma_by_dispersions": found.sigma,
        "leading": list(found.leading),
        "kink": found.kink,
        "inputs": [dataclasses.asdict(share) for share in found.shares],
        "sampling": None if beside is None else dataclasses.asdict(beside),
    }


def _show(
    found: "tuple[MetricSensitivity, ...]", beside: "list[RankingAgreement | None]", space: "StandardNormalSpace"
) -> None:
    from rich.console import Console
    from rich.table import Table

    from rpojax.report.labels import format_number

    console = Console(highlight=False)
    for one, other in zip(found, beside, strict=True):
        table = Table(
            title=f"{one.metric}: {format_number(one.sigma)} {one.unit} by dispersions, {len(one.values)} runs"
        )
        table.add_column("input")
        for heading in (f"trend [{one.unit}]", "sigma", "median run", "most of one run", "by sampling"):
            table.add_column(heading, justify="right")
        for share in one.shares[:10]:
            strength = None if other is None else other.strengths.get(share.name)
            cells = (
                format_number(share.trend),
                format_number(share.sigma),
                format_number(share.nominal),
                f"{share.one_run:.0%}",
                format_number(strength, 2),
            )
            table.add_row(share.name, *cells)
        console.print(table)
        if other is not None:
            console.print(
                f"{other.runs} sampled runs: standard deviation {format_number(other.std)} {one.unit}, "
                f"{len(other.both)} of the {len(other.leading)} leading inputs agree, rank correlation of both orders "
                f"{format_number(other.rank_correlation, 2)}",
                soft_wrap=True,
            )
        if one.kink is not None:
            console.print(f"{one.metric} is {one.kink}", soft_wrap=True)
    if space.unmapped:
        console.print(f"held at what each run draws: {', '.join(space.unmapped)}", soft_wrap=True)
