"""Events of runs: when flags of failure were raised, and when they were cleared again."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from rpojax.simulation.outcomes.outcome_kinds import RECOVERABLE, Outcome

MAX_EVENTS: Final = 16
"""Most events that are stored of a run: the first ones. A choice of storage: the report tells how many there were."""


@dataclass(frozen=True)
class OutcomeEvent:
    """A flag of a run.

    Attributes:
        run_id: number of the run
        outcome: what the flag stands for
        raised_at_s: when it was raised [s]
        cleared_at_s: when it was cleared [s], None if it was up to the end
    """

    run_id: int
    outcome: Outcome
    raised_at_s: float
    cleared_at_s: float | None


@dataclass(frozen=True)
class EventArrays:
    """Events of runs in order of time.

    Attributes:
        count: (runs,) number of all events of the run
        code: (runs, events) code of the outcome, 0 for none
        raised_at_s: (runs, events) [s], NaN for none
        cleared_at_s: (runs, events) [s], NaN if the flag was up to the end
    """

    count: np.ndarray
    code: np.ndarray
    raised_at_s: np.ndarray
    cleared_at_s: np.ndarray

    def stored(self, rows: slice) -> dict[str, np.ndarray]:
        """Arrays of some runs by the names under which they are stored."""
        return {name: getattr(self, name)[rows] for name in ("count", "code", "raised_at_s", "cleared_at_s")}


def collect_events(flags: Mapping[Outcome, np.ndarray], running: np.ndarray, tick_s: float) -> EventArrays:
    """Events from flags (runs, ticks) at ticks of `tick_s` [s], as long as a run is `running` (runs, ticks)."""
    runs = len(running)
    found: list[list[tuple[float, int, float]]] = [[] for _ in range(runs)]
    for kind in RECOVERABLE:
        now = flags[kind]
        before = np.concatenate([np.zeros((runs, 1), dtype=bool), now[:, :-1]], axis=1)
        raised, cleared = np.argwhere(now & ~before & running), np.argwhere(before & ~now & running)
        # Both are sorted by run and time, and a run's flag is raised before it is cleared.
        ends: dict[int, list[int]] = {}
        for row, tick in reversed(cleared.tolist()):
            ends.setdefault(row, []).append(tick)
        for row, tick in raised.tolist():
            end = ends[row].pop() if ends.get(row) else np.nan
            found[row].append((tick * tick_s, kind.code, end * tick_s))
    arrays = EventArrays(
        count=np.array([len(events) for events in found], dtype=np.int32),
        code=np.zeros((runs, MAX_EVENTS), dtype=np.int8),
        raised_at_s=np.full((runs, MAX_EVENTS), np.nan),
        cleared_at_s=np.full((runs, MAX_EVENTS), np.nan),
    )
    for row, events in enumerate(found):
        for place, (raised_s, code, cleared_s) in enumerate(sorted(events)[:MAX_EVENTS]):
            arrays.code[row, place] = code
            arrays.raised_at_s[row, place], arrays.cleared_at_s[row, place] = raised_s, cleared_s
    return arrays


def listed_events(run_ids: np.ndarray, stored: Mapping[str, np.ndarray]) -> list[OutcomeEvent]:
    """Events of runs as a list, by run and time, from their stored arrays; empty without these."""
    if not stored:
        return []
    rows = np.argwhere(stored["code"] > 0)
    return [
        OutcomeEvent(
            int(run_ids[row]),
            list(Outcome)[int(stored["code"][row, place])],
            float(stored["raised_at_s"][row, place]),
            None if np.isnan(cleared := stored["cleared_at_s"][row, place]) else float(cleared),
        )
        for row, place in rows.tolist()
    ]
