"""Outcome of a team's run: that of its worst servicer."""

from collections.abc import Sequence

import numpy as np

from rpojax.simulation.outcomes.judgement import JudgedRuns
from rpojax.simulation.outcomes.outcome_events import MAX_EVENTS, EventArrays
from rpojax.simulation.outcomes.outcome_kinds import FREEZING, RECOVERABLE, Outcome

_BY_SEVERITY = (*FREEZING, *RECOVERABLE, Outcome.UNFINISHED, Outcome.NOT_JUDGED, Outcome.COMPLETED)


def worst(servicers: Sequence[JudgedRuns]) -> JudgedRuns:
    """Outcome of each run by its worst servicer, the time since which that one is in it, and all their events."""
    rank = np.zeros(len(Outcome), dtype=int)
    rank[[kind.code for kind in _BY_SEVERITY]] = np.arange(len(_BY_SEVERITY))
    codes = np.stack([each.codes for each in servicers])
    since_s = np.stack([each.since_s for each in servicers])
    # Of several in the same state, the first one that came to it.
    order = np.lexsort((np.nan_to_num(since_s, nan=np.inf), rank[codes]), axis=0)[0]
    runs = np.arange(codes.shape[1])
    return JudgedRuns(codes[order, runs], since_s[order, runs], _joined([each.events for each in servicers]))


def _joined(servicers: Sequence[EventArrays]) -> EventArrays:
    """First events of all servicers, in order of time."""
    codes, raised, cleared = (
        np.concatenate([getattr(each, name) for each in servicers], axis=1)
        for name in ("code", "raised_at_s", "cleared_at_s")
    )
    order = np.argsort(np.nan_to_num(raised, nan=np.inf), axis=1, kind="stable")[:, :MAX_EVENTS]
    return EventArrays(
        count=np.asarray(np.sum([each.count for each in servicers], axis=0, dtype=np.int32)),
        code=np.take_along_axis(codes, order, axis=1),
        raised_at_s=np.take_along_axis(raised, order, axis=1),
        cleared_at_s=np.take_along_axis(cleared, order, axis=1),
    )
