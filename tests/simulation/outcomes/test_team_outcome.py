"""Outcome of a team by its worst servicer."""

import numpy as np

from rpojax.simulation.outcomes import team_outcome
from rpojax.simulation.outcomes.judgement import JudgedRuns
from rpojax.simulation.outcomes.outcome_events import MAX_EVENTS, EventArrays
from rpojax.simulation.outcomes.outcome_kinds import Outcome


def judged(outcomes: list[Outcome], since_s: list[float], raised_s: list[float]) -> JudgedRuns:
    """Runs with an outcome each, and one event each."""
    runs = len(outcomes)
    raised, code = np.full((runs, MAX_EVENTS), np.nan), np.zeros((runs, MAX_EVENTS), dtype=np.int8)
    raised[:, 0], code[:, 0] = raised_s, Outcome.LOST.code
    events = EventArrays(np.ones(runs, dtype=np.int32), code, raised, np.full((runs, MAX_EVENTS), np.nan))
    return JudgedRuns(np.array([each.code for each in outcomes]), np.array(since_s), events)


def test_the_worst_servicer_decides_and_events_are_in_order() -> None:
    nan = np.nan
    first = judged([Outcome.COMPLETED, Outcome.OFF_STATION, Outcome.LOST], [nan, 50.0, 70.0], [9.0, 2.0, 3.0])
    second = judged([Outcome.COMPLETED, Outcome.KEEP_OUT, Outcome.LOST], [nan, 90.0, 60.0], [8.0, 4.0, 1.0])
    found = team_outcome.worst([first, second])
    assert found.codes.tolist() == [0, Outcome.KEEP_OUT.code, Outcome.LOST.code]
    np.testing.assert_array_equal(found.since_s, [nan, 90.0, 60.0])
    assert found.events.count.tolist() == [2, 2, 2]
    np.testing.assert_array_equal(found.events.raised_at_s[:, :3], [[8, 9, nan], [2, 4, nan], [1, 3, nan]])
    assert found.events.raised_at_s.shape == (3, MAX_EVENTS)
