"""Protocol of the campaign results that the report needs, independent of how they are stored."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

import numpy as np

from rpojax.simulation.outcomes.outcome_events import OutcomeEvent


@runtime_checkable
class CampaignResults(Protocol):
    """Results of a campaign as host arrays: one row per run, NaN where a value is undefined."""

    @property
    def directory(self) -> Path:
        """Folder of the campaign, where the report is written."""
        ...

    @property
    def info(self) -> Mapping[str, Any]:
        """Name, scenario, seed, versions and further provenance of the results."""
        ...

    @property
    def run_ids(self) -> np.ndarray:
        """(runs,) run number of each row."""
        ...

    @property
    def metrics(self) -> Mapping[str, np.ndarray]:
        """Metric name, of one servicer `NAME/SERVICER` -> (runs,), in the unit of `rpojax.metrics.metric_catalogue`."""
        ...

    @property
    def completed(self) -> np.ndarray:
        """(runs,) bool: the run did what it should: its outcome is `completed`."""
        ...

    @property
    def failed(self) -> np.ndarray:
        """(runs,) bool: the run failed: its outcome is neither `completed` nor `not_judged`."""
        ...

    @property
    def outcomes(self) -> np.ndarray:
        """(runs,) of str: how the run ended, such as `completed` or `lost`."""
        ...

    @property
    def reached_end(self) -> np.ndarray:
        """(runs,) bool: the run was simulated to its end, in whatever state, and so has metrics."""
        ...

    @property
    def is_judged(self) -> np.ndarray:
        """(runs,) bool: all outcomes were judged; older versions recorded only why a run was frozen."""
        ...

    @property
    def events(self) -> Sequence[OutcomeEvent]:
        """Flags of failure that were raised in the runs, and cleared in those that recovered."""
        ...

    @property
    def failed_at_s(self) -> np.ndarray:
        """(runs,) time since which a failed run has been in its final state [s], NaN for a run that did not fail."""
        ...

    @property
    def failure_reason(self) -> np.ndarray:
        """(runs,) of str, empty for a run that did not fail."""
        ...

    @property
    def drawn(self) -> Mapping[str, np.ndarray]:
        """Dispersion key -> (runs,) or (runs, k) drawn values in the unit of the key."""
        ...

    @property
    def trace_time_s(self) -> np.ndarray:
        """(m,) time of the traces [s]."""
        ...

    @property
    def traces(self) -> Mapping[str, np.ndarray]:
        """Channel -> (runs, m), NaN after the run was frozen."""
        ...

    @property
    def phases(self) -> Mapping[str, np.ndarray]:
        """Arrays of `rpojax.simulation.metrics.phase_records.evaluate` of the runs; empty without phases."""
        ...

    @property
    def phase_names(self) -> Sequence[str]:
        """Names of the phases in the order of those arrays, the two built-in ones last."""
        ...

    @property
    def coverage(self) -> Mapping[str, np.ndarray]:
        """`lit_samples` and `seen_samples` (runs, facets) of the target's surface; empty without coverage."""
        ...

    @property
    def surface(self) -> Mapping[str, np.ndarray]:
        """Facets of the target's surface: arrays of `rpojax.vision.surface.facets.Facets`; empty without coverage."""
        ...

    @property
    def history_ids(self) -> Sequence[int]:
        """Numbers of the runs with a stored full history."""
        ...

    def history(self, run_id: int, servicer: int | None = None) -> Mapping[str, np.ndarray]:
        """Full history of one of `history_ids`: channel -> array, time first; of a team that of all or one servicer."""
        ...

    @property
    def servicer_names(self) -> Sequence[str]:
        """Names of the servicers of a team; empty for one alone."""
        ...

    def servicers(self, group: str) -> Mapping[str, np.ndarray]:
        """Arrays (runs, servicers, ...) of a group, such as `status`, of a team; empty for one servicer alone."""
        ...


class PassedOnResults:
    """Results of a campaign that are those of another one, except for members that a subclass defines."""

    def __init__(self, campaign: CampaignResults) -> None:
        self._campaign = campaign


def _passed_on(name: str) -> property:
    return property(lambda results: getattr(results._campaign, name))


# Members, not `__getattr__`: a check against the protocol looks for them without calling anything.
for _name in vars(CampaignResults):
    if not _name.startswith("_"):
        setattr(PassedOnResults, _name, _passed_on(_name))
