"""What the report needs of a campaign, said as a type, so that the report does not depend on how results are stored."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

import numpy as np


@runtime_checkable
class CampaignResults(Protocol):
    """Results of a campaign on the host: one row per run, NaN where a value is undefined."""

    @property
    def directory(self) -> Path:
        """Folder of the campaign, where the report is written."""
        ...

    @property
    def info(self) -> Mapping[str, Any]:
        """Name, scenario, seed, versions and what else says where the results come from."""
        ...

    @property
    def run_ids(self) -> np.ndarray:
        """(runs,) number of the run of each row."""
        ...

    @property
    def metrics(self) -> Mapping[str, np.ndarray]:
        """Name of a metric -> (runs,), in the unit that `rpojax.scenario.metric_catalogue.UNITS` gives."""
        ...

    @property
    def completed(self) -> np.ndarray:
        """(runs,) bool: the run reached its end."""
        ...

    @property
    def failed_at_s(self) -> np.ndarray:
        """(runs,) time of failure [s], NaN for a completed run."""
        ...

    @property
    def failure_reason(self) -> np.ndarray:
        """(runs,) of str, empty for a completed run."""
        ...

    @property
    def drawn(self) -> Mapping[str, np.ndarray]:
        """Key of a dispersion -> (runs,) or (runs, k) drawn values in the unit of the key."""
        ...

    @property
    def trace_time_s(self) -> np.ndarray:
        """(m,) time of the traces [s]."""
        ...

    @property
    def traces(self) -> Mapping[str, np.ndarray]:
        """Channel -> (runs, m), NaN after a failure."""
        ...

    @property
    def history_ids(self) -> Sequence[int]:
        """Runs whose full history is kept."""
        ...

    def history(self, run_id: int) -> Mapping[str, np.ndarray]:
        """Full history of a kept run, time first."""
        ...
