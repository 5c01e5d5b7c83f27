"""What verbs share: words of the command line, exit statuses, and work that gives way to an interrupt."""

import enum
import json
import os
import sys
import threading
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from tyro.conf import Positional, UseAppendAction, arg

from rpojax.cli import console

if TYPE_CHECKING:
    from rpojax.campaign.storage.campaign_folder import Campaign
    from rpojax.scenario.schema import ScenarioFile


class Status(enum.IntEnum):
    """Exit statuses; 1 is left to Python, for errors that nobody expected."""

    DONE = 0
    BAD_INPUT = 2
    SOME_FAILED = 3
    UNFINISHED = 4
    INTERRUPTED = 130


Source = Annotated[Positional[str], arg(metavar="SCENARIO", help="Packaged name or TOML file.")]
Folder = Annotated[Positional[Path], arg(metavar="DIR", help="Folder of a campaign.")]
Out = Annotated[Path, arg(metavar="DIR", help="Folder to make for the results.")]
Overrides = Annotated[
    UseAppendAction[tuple[str, ...]],
    arg(name="set", metavar="KEY=VALUE", help="Another value for a key of the scenario, in TOML; several may follow."),
]
Seed = Annotated[int, arg(metavar="S", help="Master seed.")]
Force = Annotated[bool, arg(help="Replace the folder if it holds a campaign.")]
AsJson = Annotated[bool, arg(name="json", help="JSON on stdout and no progress.")]
NoFilm = Annotated[bool, arg(help="Take no pictures of a rendered camera again for the report.")]
NoCache = Annotated[bool, arg(help="Compile anew and keep nothing of it.")]

_WORKER = "rpojax-worker"


def load(source: str, overrides: Sequence[str]) -> "ScenarioFile":
    """Scenario with its overrides."""
    from rpojax.scenario import scenario_file

    return scenario_file.load(source, overrides)


def fly(work: "Callable[[console.Watch], Campaign]", duration_s: float, as_json: bool) -> "Campaign":
    """Result of `work`, which tells its progress and gives way to an interrupt at once, even while compiling."""
    results: list[Campaign] = []
    errors: list[BaseException] = []

    def target(watch: console.Watch) -> None:
        try:
            results.append(work(watch))
        except BaseException as error:
            errors.append(error)

    with console.watching(duration_s, quiet=as_json) as watch:
        worker = threading.Thread(target=target, args=(watch,), name=_WORKER, daemon=True)
        worker.start()
        worker.join()
    if errors:
        raise errors[0]
    return results[0]


def abandon_worker() -> None:
    """Ends the process if a worker is still busy; an orderly end would wait for the compiler, or crash in it."""
    if any(thread.name == _WORKER for thread in threading.enumerate()):
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(Status.INTERRUPTED)


def print_json(content: object) -> None:
    """JSON on stdout."""
    print(json.dumps(content, indent=2, allow_nan=False))
