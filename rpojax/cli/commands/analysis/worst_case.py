"""The command `rpojax worst-case`: the most likely combination of dispersions that breaks a requirement."""

from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console

from rpojax.analysis.reliability import worst_case as analysis
from rpojax.campaign.storage.atomic_outputs import check_replaceable
from rpojax.cli.exit_status import Status
from rpojax.cli.options.analysis import WorstCaseCommand
from rpojax.cli.output_paths import claim_folder
from rpojax.cli.scenario_files import load, show_unused_keys
from rpojax.cli.standard_streams import print_json
from rpojax.cli.terminal_tables import print_table
from rpojax.report.labels import format_number

_SCENARIO, _RECORD, _FLIGHT = "worst_case.toml", "worst_case.json", "flight"


def worst_case(asked: WorstCaseCommand) -> int:
    """Does the work of the command; returns its exit status."""
    file = load(asked.scenario, asked.overrides)
    show_unused_keys(file, quiet=asked.session.as_json)
    _claim(asked.out, asked.force)

    found = analysis.find_worst_case(
        file,
        asked.choice,
        asked.settings,
        asked.seed,
        run_directory=asked.out / _FLIGHT,
        force=asked.force,
        progress=not asked.session.as_json,
    )
    found.write(asked.out, asked.force)
    content = found.to_dict()
    if asked.session.as_json:
        print_json({"directory": str(asked.out), **content})
    else:
        _show(content, asked.out)
    return Status.DONE


def _claim(out: Path, force: bool) -> None:
    """Refuses a folder that cannot be written to or holds the results of another search."""
    claim_folder(out)
    check_replaceable((out / name for name in (_SCENARIO, _RECORD, _FLIGHT)), force)


def _show(content: dict[str, Any], out: Path) -> None:
    console = Console(highlight=False)
    rule = f"{content['metric']} {content['bound']} {content['limit']:g} {content['unit']}"
    distance, run = f"{content['distance_sigmas']:.2f} sigmas", f"run {content['run_id']} of seed {content['seed']}"
    if content["breaks_at_median"]:
        told = f"{rule}: the median run is beyond it already, {run}: nothing is searched, and there is no probability; "
        console.print(told + "another --limit or --bound may be meant", soft_wrap=True)
    elif content["found"]:
        told = f"{rule}: broken {distance} from the median in {run}, first-order probability "
        console.print(told + f"{content['probability_first_order']:.2g} with that run's noise", soft_wrap=True)
    else:
        told = f"{rule}: no violation found; closest is {format_number(content['value'])} {content['unit']} "
        console.print(told + f"at {distance} in {run}", soft_wrap=True)
    if content["lack_of_gradients"]:
        console.print(f"warning: {content['lack_of_gradients']}; a larger --budget has them", soft_wrap=True)
    if content["undefined"]:
        console.print(f"there {content['metric']} has no value, which counts as broken", soft_wrap=True)
    rows = []
    for entry in content["dispersions"]:
        sigmas = ", ".join(f"{value:+.2f}" for value in entry["sigmas"].values())
        cells = [_numbers(list(entry[side].values())) for side in ("values", "nominal")]
        rows.append((entry["name"], sigmas, *cells))
    print_table(console, ("dispersion", "sigmas", "value", "nominal"), rows, optional=("nominal",))
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
    return ", ".join(f"{value:.5g}" for value in np.concatenate([np.ravel(each) for each in values]))
