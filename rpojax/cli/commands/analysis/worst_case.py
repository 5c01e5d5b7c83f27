"""The command `rpojax worst-case`: the most likely combination of dispersions that breaks a requirement."""

from pathlib import Path
from typing import Annotated, Any

from tyro.conf import arg

from rpojax.analysis.reliability.search_settings import LimitChoice, SearchSettings
from rpojax.campaign.storage.atomic_outputs import check_replaceable
from rpojax.cli.arguments import FLAT, Out, Overrides, Seed, Session, Source, load
from rpojax.cli.console import show_unused_keys
from rpojax.cli.exit_status import Status
from rpojax.cli.output_paths import claim_folder
from rpojax.cli.standard_streams import print_json
from rpojax.runtime.jax_environment import prepare_jax, set_loop_fusion_flag

_SCENARIO, _RECORD, _FLIGHT = "worst_case.toml", "worst_case.json", "flight"


def worst_case(
    scenario: Source,
    choice: Annotated[LimitChoice, FLAT],
    settings: Annotated[SearchSettings, FLAT],
    session: Annotated[Session, FLAT],
    *,
    out: Out,
    seed: Seed = 0,
    overrides: Overrides = (),
    force: Annotated[bool, arg(help="Replace the files if they are there.")] = False,
) -> int:
    """The most likely combination of dispersions that breaks a requirement, as a scenario to simulate."""
    file = load(scenario, overrides)
    show_unused_keys(file, quiet=session.as_json)
    _claim(out, force)
    prepare_jax(cache=not session.no_cache)
    set_loop_fusion_flag(rendered=file.camera.model == "rendered")
    from rpojax.analysis.reliability import worst_case as analysis

    found = analysis.find_worst_case(
        file, choice, settings, seed, run_directory=out / _FLIGHT, force=force, progress=not session.as_json
    )
    found.write(out, force)
    content = found.to_dict()
    if session.as_json:
        print_json({"directory": str(out), **content})
    else:
        _show(content, out)
    return Status.DONE


def _claim(out: Path, force: bool) -> None:
    """Refuses a folder that cannot be written to or holds the results of another search."""
    claim_folder(out)
    check_replaceable((out / name for name in (_SCENARIO, _RECORD, _FLIGHT)), force)


def _show(content: dict[str, Any], out: Path) -> None:
    from rich.console import Console
    from rich.table import Table

    from rpojax.report.labels import format_number

    console = Console(highlight=False)
    rule = f"{content['metric']} {content['bound']} {content['limit']:g} {content['unit']}"
    distance, run = f"{content['distance_sigmas']:.2f} sigmas", f"run {content['run_id']} of seed {content['seed']}"
    if content["found"]:
        told = f"{rule}: broken {distance} from the median in {run}, first-order probability "
        console.print(told + f"{content['probability_first_order']:.2g} with that run's noise", soft_wrap=True)
        if content["undefined"]:
            console.print(f"there {content['metric']} has no value, which counts as broken", soft_wrap=True)
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
