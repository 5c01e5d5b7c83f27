"""Stays of runs in the phases of a mission, from the recorded transitions."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rpojax.flight.mission.mission_state import Transition

Numbers = NDArray[np.integer]
Times = NDArray[np.floating]


@dataclass(frozen=True)
class PhaseVisits:
    """Stays of each run in order of time; (runs, stays), as many as the run with the most has.

    Attributes:
        phase: number of the phase, -1 for none
        begin_s: [s], NaN for none
        end_s: beginning of the next one [s], NaN for the last
        ended_by: the `Transition` that ended it, -1 for the last
        complete: (runs,) whether all stays of the run were recorded
    """

    phase: Numbers
    begin_s: Times
    end_s: Times
    ended_by: Numbers
    complete: NDArray[np.bool_]

    @property
    def is_last(self) -> NDArray[np.bool_]:
        """(runs, stays) whether it lasted as long as the run did."""
        return (self.phase >= 0) & (self.ended_by < 0) & self.complete[:, None]

    def phase_before_abort(self) -> Numbers:
        """(runs,) number of the phase that an abort ended, -1 without one."""
        rows, places = np.nonzero(self.ended_by == Transition.ABORT)
        found = np.full(len(self.phase), -1)
        found[rows] = self.phase[rows, places]
        return found

    def at(self, time_s: Times, frozen_at_s: Times) -> Numbers:
        """(runs, samples) number of the phase at each time [s], -1 after a run was frozen, if at all (runs,)."""
        found = np.full((len(self.phase), len(time_s)), -1)
        for place in range(self.phase.shape[1]):
            began = self.begin_s[:, place : place + 1] <= time_s
            found = np.where(began, self.phase[:, place : place + 1], found)
        return np.where(time_s > np.where(np.isnan(frozen_at_s), np.inf, frozen_at_s)[:, None], -1, found)


def phase_visits(stored: Mapping[str, np.ndarray]) -> PhaseVisits:
    """Stays from the arrays of `rpojax.simulation.metrics.phase_records.evaluate`."""
    kept = stored["transition_phase"].shape[1]
    shown = slice(int(np.clip(np.max(stored["transition_count"], initial=1), 1, kept)))
    phase, begin_s, by = (stored[f"transition_{name}"][:, shown] for name in ("phase", "at_s", "by"))
    none = np.full((len(phase), 1), -1)
    return PhaseVisits(
        phase=phase.astype(int),
        begin_s=begin_s,
        end_s=np.concatenate([begin_s[:, 1:], np.full(none.shape, np.nan)], axis=1),
        ended_by=np.concatenate([by[:, 1:].astype(int), none], axis=1),
        complete=stored["transition_count"] <= kept,
    )
