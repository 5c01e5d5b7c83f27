"""Histories of a campaign for as long as a report is made: each is read once, and the latest are kept."""

from collections import OrderedDict
from collections.abc import Mapping
from typing import Final

import numpy as np

from rpojax.campaign.storage.campaign_folder import of_servicer
from rpojax.report.campaign_results import CampaignResults, PassedOnResults

KEPT_BYTES: Final = 400_000_000
"""Memory beyond which the history that was not used for longest is read again."""


class KeptHistories(PassedOnResults):
    """Results of a campaign, with a memory of its histories.

    Args:
        campaign: results
        most_bytes: memory for histories; the latest is kept in any case
    """

    def __init__(self, campaign: CampaignResults, most_bytes: int = KEPT_BYTES) -> None:
        super().__init__(campaign)
        self._most_bytes = most_bytes
        self._kept: OrderedDict[int, Mapping[str, np.ndarray]] = OrderedDict()

    def history(self, run_id: int, servicer: int | None = None) -> Mapping[str, np.ndarray]:
        """Full history of a run, as the campaign has it."""
        if run_id not in self._kept:
            self._kept[run_id] = self._campaign.history(run_id)
            while len(self._kept) > 1 and sum(map(_bytes, self._kept.values())) > self._most_bytes:
                self._kept.popitem(last=False)
        self._kept.move_to_end(run_id)
        whole = self._kept[run_id]
        return whole if servicer is None or not self._campaign.servicer_names else of_servicer(whole, servicer)


def _bytes(history: Mapping[str, np.ndarray]) -> int:
    return sum(values.nbytes for values in history.values())
