"""The closed loops of the default tests, by name, and the check that no default test traces another one.

To trace and compile a closed loop takes some ten seconds, so tests share few of them. Loops that differ in numbers,
length and batch alone are one. A test that needs another one is `slow`, or only `traces` it.
"""

import functools
import sys
from collections.abc import Callable
from dataclasses import replace
from typing import Any

from rpojax.scenario.schema import ScenarioFile
from rpojax.scenario.static_settings import Scenario, static_settings

LOOPS = {
    "inspection": "campaigns, the command line and benchmarks: the packaged mission in any length",
    "short run": "stages, outcomes and external inputs: 90 s with a burn under the formation law of a user",
    "faults": "each fault of the equipment, sunset and sunrise as one batch; running metrics",
    "phases": "four phases with their own values, commands and pointing",
    "pair": "two servicers that share nothing",
    "rendered": "images of the loop, films, and images again",
    "coverage": "maps of facets, and poses as channels",
    "replay": "a recorded run again, with the values of messages and of the viewer",
}
"""Name -> what needs it."""

_named: dict[str, Scenario] = {}
_traced: list[Scenario] = []


def name_loop(name: str, file: ScenarioFile) -> ScenarioFile:
    """Gives the loop of a scenario one of the names, which no other loop of the session may have; returns the file."""
    assert name in LOOPS, f"found {name!r}, expected one of the named loops: {', '.join(LOOPS)}"
    loop = _without_length(static_settings(file, allow_single=True, allow_team=True))
    assert _named.setdefault(name, loop) == loop, f"another loop is called {name!r}"
    return file


def unnamed_loops() -> list[Scenario]:
    """Loops that have been traced since the last call and have no name."""
    found = [loop for loop in map(_without_length, _traced) if loop not in _named.values()]
    _traced.clear()
    return found


def watch_loops() -> None:
    """Notes every trace of a tick, of one servicer or of a team, from now on."""
    import rpojax.simulation.step
    import rpojax.simulation.team.team_step  # noqa: F401

    for module in ("rpojax.simulation.step", "rpojax.simulation.team.team_step"):
        step = vars(sys.modules[module])["step"]
        noted = _noted(step)
        for each in [each for name, each in sys.modules.items() if name.startswith("rpojax")]:
            for name in [name for name, value in vars(each).items() if value is step]:
                setattr(each, name, noted)


def _noted(step: Callable[..., Any]) -> Callable[..., Any]:
    @functools.wraps(step)
    def noted(scenario: Scenario, *arguments: Any, **others: Any) -> Any:
        _traced.append(scenario)
        return step(scenario, *arguments, **others)

    return noted


def _without_length(scenario: Scenario) -> Scenario:
    return replace(scenario, ticks=0)
