"""The closed loops of the default tests, by name, and the check that no default test traces another one.

To trace and compile a closed loop takes some ten seconds, so tests share few of them. Loops that differ in numbers,
length and batch alone are one. A test that needs another one is `slow`.
"""

import functools
import sys
from collections.abc import Callable
from dataclasses import replace
from typing import Any

from rpojax.scenario.static_settings import Scenario

LOOPS = {
    "inspection": "campaigns, the command line, gradients: the packaged scenario in any length",
    "short run": "stages, outcomes and external inputs: 90 s with a burn under the formation law of a user",
    "faults": "every fault of the equipment, sunset and sunrise as one batch",
    "phases": "four phases with their own values, commands and pointing",
    "pair": "two servicers that share nothing",
    "rendered": "images of the loop, films and their repetition",
    "replay": "a recorded run again, with both orbits",
    "coverage": "facets that are seen, with poses as channels",
}
"""Name -> what needs it."""

_named: dict[str, Scenario] = {}
_traced: list[Scenario] = []


def name_loop(name: str, scenario: Scenario) -> None:
    """Names the loop of a scenario: one of `LOOPS`, and one loop of that name in a session."""
    assert name in LOOPS, f"{name!r} is none of the named loops: {', '.join(LOOPS)}"
    loop = _without_numbers(scenario)
    assert _named.setdefault(name, loop) == loop, f"another loop is called {name!r}"


def unnamed_loops() -> list[Scenario]:
    """Loops traced since the last call that have no name."""
    found = [loop for loop in map(_without_numbers, _traced) if loop not in _named.values()]
    _traced.clear()
    return found


def watch_loops() -> None:
    """Notes the scenario of every trace of a tick, of one servicer or of a team, from now on."""
    import rpojax.simulation.step
    import rpojax.simulation.team.team_step  # noqa: F401

    for module in ("rpojax.simulation.step", "rpojax.simulation.team.team_step"):
        step = vars(sys.modules[module])["step"]
        for other in [each for name, each in sys.modules.items() if name.startswith("rpojax")]:
            for name in [name for name, value in vars(other).items() if value is step]:
                setattr(other, name, _noted(step))


def _noted(step: Callable[..., Any]) -> Callable[..., Any]:
    @functools.wraps(step)
    def noted(scenario: Scenario, *arguments: Any, **others: Any) -> Any:
        _traced.append(scenario)
        return step(scenario, *arguments, **others)

    return noted


def _without_numbers(scenario: Scenario) -> Scenario:
    return replace(scenario, ticks=0)
