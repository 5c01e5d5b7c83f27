"""The command `rpojax new`: a scenario file to begin with, from what is known of a mission or as comments."""

import dataclasses
import re
import sys
from pathlib import Path
from typing import Any, Final

from rpojax.campaign.storage.atomic_outputs import write_atomically
from rpojax.cli.console import show_lines
from rpojax.cli.exit_status import Status
from rpojax.cli.options.scenarios import NewCommand
from rpojax.cli.output_paths import claim
from rpojax.cli.scenario_files import load
from rpojax.errors import RpojaxError
from rpojax.scenario.loading.scenario_loader import packaged_names
from rpojax.scenario.loading.scenario_template import template
from rpojax.scenario.own_mission.facts import MissionFacts, check_fact
from rpojax.scenario.own_mission.mission_file import BASE, own_mission

_ASKED: Final = (
    "mass_kg", "thrust_n", "target_m", "span_m", "altitude_km", "local_time_h", "hold_m", "approach_m", "lens_deg",
    "pixels",
)  # fmt: skip
"""What is asked for in a terminal; the rest are flags alone."""


def new(asked: NewCommand) -> int:
    """Does the work of the command; returns its exit status."""
    name = asked.name.removesuffix(".toml")
    if not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9_-]{0,59}", name):
        raise RpojaxError.of_argument("name", f"found {asked.name!r:.60}, expected letters, digits, - and _")
    path = Path(f"{name}.toml")
    claim(path, asked.force)
    _check_names(name, asked.extends)

    known = {key: value for key, value in dataclasses.asdict(asked.facts).items() if value not in (None, False)}
    if known and asked.extends is not None:
        found = f"found {asked.extends!r} beside {min(known)}, expected one of them"
        raise RpojaxError.of_argument("extends", found)
    if not known and asked.extends is None and _is_terminal():
        known = _answers() or {"mass_kg": MissionFacts().mass_kg}
    if not known:
        base = asked.extends or BASE
        print(write_atomically(path, template(name, base, load(base, ())).encode()))
        return Status.DONE
    mission = own_mission(name, MissionFacts(**known))
    print(write_atomically(path, mission.text.encode()))
    show_lines(mission.problems)
    return Status.DONE


def _is_terminal() -> bool:
    return sys.stdin.isatty() and sys.stderr.isatty()


def _check_names(name: str, extends: str | None) -> None:
    packaged = packaged_names()
    if name in packaged:
        raise RpojaxError.of_argument("name", f"found {name!r}, expected a name that no packaged scenario has")
    if extends is not None and extends not in packaged:
        raise RpojaxError.of_argument("extends", f"found {extends!r}, expected a packaged scenario")


def _answers() -> dict[str, Any]:
    """Facts that a user types; nothing typed takes what stands in brackets."""
    print("Enter takes what stands in brackets.", file=sys.stderr)
    fields = {each.name: each for each in dataclasses.fields(MissionFacts)}
    found: dict[str, Any] = {}
    for name in _ASKED:
        default = fields[name].default
        shown = " ".join(map(str, default)) if isinstance(default, tuple) else "derived" if default is None else default
        while True:
            print(f"{fields[name].metadata['question']} [{shown}]: ", end="", file=sys.stderr, flush=True)
            line = sys.stdin.readline()
            if not line:
                raise RpojaxError.of_argument(
                    "stdin", f"found its end, expected the {fields[name].metadata['question']}"
                )
            if not line.strip():
                break
            try:
                found[name] = _parsed(name, line)
            except RpojaxError as error:
                print(error, file=sys.stderr)
                continue
            break
    return found


def _parsed(name: str, line: str) -> Any:
    """Value of a typed answer.

    Raises:
        RpojaxError: it is no number, or outside of its limits.
    """
    try:
        numbers = tuple(float(word) for word in line.replace(",", " ").split())
    except ValueError:
        raise RpojaxError.of_argument(name, f"found {line.strip()!r:.60}, expected numbers") from None
    if name == "target_m":
        value: Any = numbers
    elif len(numbers) != 1:
        raise RpojaxError.of_argument(name, f"found {len(numbers)} numbers, expected one")
    else:
        value = round(numbers[0]) if name == "pixels" else numbers[0]
    check_fact(name, value)
    return value
