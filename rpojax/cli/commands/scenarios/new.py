"""The command `rpojax new`: a commented scenario file to begin with."""

import re
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

from rpojax.cli.arguments import load
from rpojax.cli.exit_status import Status
from rpojax.cli.output_paths import claim
from rpojax.errors import RpojaxError


def new(
    name: Annotated[Positional[str], arg(metavar="NAME", help="Name of the scenario; the file is NAME.toml.")],
    *,
    extends: Annotated[str, arg(metavar="SCENARIO", help="Packaged scenario that it extends.")] = "inspection",
    force: Annotated[bool, arg(help="Replace the file if it is there.")] = False,
) -> int:
    """Write a commented scenario with the keys that people change first."""
    if not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9_-]{0,59}", name):
        raise RpojaxError.of_argument("name", f"found {name!r:.60}, expected letters, digits, - and _")
    path = Path(f"{name}.toml")
    claim(path, force)
    from rpojax.campaign.storage.atomic_outputs import write_atomically
    from rpojax.scenario.loading.scenario_loader import packaged_names
    from rpojax.scenario.loading.scenario_template import template

    if name in packaged_names() or extends not in packaged_names():
        expected = "a name that no packaged scenario has" if name in packaged_names() else "a packaged scenario"
        argument, found = ("name", name) if name in packaged_names() else ("extends", extends)
        raise RpojaxError.of_argument(argument, f"found {found!r}, expected {expected}")
    print(write_atomically(path, template(name, extends, load(extends, ())).encode()))
    return Status.DONE
