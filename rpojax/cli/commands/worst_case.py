"""The command `rpojax worst-case`: the most likely combination of dispersions that breaks a requirement."""

from pathlib import Path
from typing import Annotated, Any

from tyro.conf import arg

from rpojax.cli.arguments import AsJson, NoCache, Out, Overrides, Seed, Source, load
from rpojax.cli.console import print_json
from rpojax.cli.exit_status import Status
from rpojax.cli.output_paths import claim_folder
from rpojax.errors import OutputError
from rpojax.runtime.jax_environment import prepare_jax, set_loop_fusion_flag

_SCENARIO, _RECORD, _FLIGHT = "worst_case.toml", "worst_case.json", "flight"


def worst_case(
    scenario: Source,
    *,
    out: Out,
    requirement: Annotated[
        str | None, arg(metavar="METRIC", help="Metric of a requirement of the scenario; or give --metric.")
    ] = None,
    metric: Annotated[str | None, arg(metavar="METRIC", help="Another metric, with --limit and --bound.")] = None,
    limit: Annotated[float | None, arg(metavar="X", help="Limit of --metric, in its unit.")] = None,
    bound: Annotated[str, arg(metavar="SIDE", help="'at most' or 'at least'.")] = "at most",
    starts: Annotated[int, arg(metavar="N", help="Searches at a time, each with the noise of another run.")] = 4,
    budget: Annotated[float, arg(metavar="N", help="Greatest cost of the search, in runs.")] = 400.0,
    seed: Seed = 0,
    overrides: Overrides = (),
    force: Annotated[bool, arg(help="Replace the files if they are there.")] = False,
    as_json: AsJson = False,
    no_cache: NoCache = False,
) -> int:
    """The most likely combination of dispersions that breaks a requirement, as a scenario to simulate."""
    file = load(scenario, overrides)
    _claim(out, force)
    prepare_jax(cache=not no_cache)
    set_loop_fusion_flag(rendered=file.camera.model == "rendered")
    from rpojax.analysis.reliability import worst_case as analysis

    found = analysis.worst_case(
        file,
        requirement=requirement,
        metric=metric,
        limit=limit,
        bound=bound,
        starts=starts,
        budget=budget,
        seed=seed,
        run_directory=out / _FLIGHT,
        force=force,
        progress=not as_json,
    )
    found.write(out, force)
    content = found.to_dict()
    if as_json:
        print_json({"directory": str(out), **content})
    else:
        _show(content, out)
    return Status.DONE


def _claim(out: Path, force: bool) -> None:
    """Refuses a folder that cannot be written to or holds the results of another search."""
    claim_folder(out)
    for name in (_SCENARIO, _RECORD, _FLIGHT):
        if (out / name).exists() and not force:
            raise OutputError(f"{out / name}: exists already; --force replaces it")


def _show(content: dict[str, Any], out: Path) -> None:
    from rich.console import Console
    from rich.table import Table

    from rpojax.report.number_format import format_number

    console = Console(highlight=False)
    rule = f"{content['metric']} {content['bound']} {content['limit']:g} {content['unit']}"
    distance, run = f"{content['distance_sigmas']:.2f} sigmas", f"run {content['run_id']} of seed {content['seed']}"
    if content["found"]:
        told = f"{rule}: broken {distance} from the median in {run}, first-order probability "
        console.print(told + f"{content['probability_first_order']:.2g} with that run's noise", soft_wrap=True)
    else:
        told = f"{rule}: no violation found; closest is {format_number(content['value'])} {content['unit']} "
        console.print(told + f"at {distance} in {run}", soft_wrap=True)
    table = Table()
    for heading in ("dispersion", "sigmas", "value", "nominal"):
        table.add_column(heading, justify="left" if heading == "dispersion" else "right")
    for entry in content["dispersions"]:
        sigmas = ", ".join(f"{value:+.2f}" for value in entry["sigmas"].values())
        cells = [_numbers(list(entry[side].values())) for side in ("values", "nominal")]
        table.add_row(entry["name"], sigmas, *cells)
    console.print(table)
    cost = content["cost"]
    console.print(
        f"cost: {cost['run_equivalents']:g} run-equivalents ({cost['flights']} runs, {cost['gradients']} gradients "
        f"at {cost['gradient_flights']}: {cost['gradient_s']:.3g} s against {cost['flight_s']:.3g} s a run in batches "
        f"of {cost['batch']}), compilation {cost['compile_s']:.0f} s",
        soft_wrap=True,
    )
    simulated = f"simulated: {format_number(content['value_flown'])} {content['unit']}, "
    simulated += f"the search had {format_number(content['value'])}"
    if content["found"]:
        simulated += "; confirmed" if content["confirmed"] else "; NOT confirmed: the run keeps the limit"
    console.print(simulated, soft_wrap=True)
    console.print(f"{out / _SCENARIO}, {out / _RECORD}, {out / _FLIGHT}", soft_wrap=True, markup=False)


def _numbers(values: list[Any]) -> str:
    import numpy as np

    return ", ".join(f"{value:.5g}" for value in np.concatenate([np.ravel(each) for each in values]))
