"""Notes on parts of a report that extreme numbers make impossible: the report says so, and the rest is written.

A campaign may record any finite number. Where squares or ratios of them leave the range of floating-point numbers, a
part of the report is made as if nothing were recorded, and a note is kept.
"""

from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np

from rpojax.report.campaign_results import CampaignResults, ChangedResults

Part = TypeVar("Part")
_OF_NUMBERS = (ArithmeticError, ValueError, TypeError, IndexError, np.linalg.LinAlgError)


def _without_numbers(campaign: CampaignResults) -> CampaignResults:
    """Results of a campaign in which no metric, trace, draw or history is defined; all else is as it was."""
    undefined = {
        group: {name: np.full(np.shape(values), np.nan) for name, values in getattr(campaign, group).items()}
        for group in ("metrics", "traces")
    }
    found: Any = ChangedResults(campaign, **undefined, drawn={}, history_ids=[])
    return found


class Notes:
    """Sentences on parts that extreme numbers made impossible, each once.

    Attributes:
        sentences: in the order in which they arose
    """

    def __init__(self) -> None:
        self.sentences: list[str] = []

    def part(self, title: str, work: Callable[[CampaignResults], Part], campaign: CampaignResults) -> Part:
        """Part of a report made from a campaign; if its numbers are too extreme, the part without numbers, and a note.

        Errors of the package, such as of a damaged folder, are raised.
        """
        try:
            return work(campaign)
        except _OF_NUMBERS as error:
            part = work(_without_numbers(campaign))
            self._note(title, error)
            return part

    def derived(self, title: str, work: Callable[[], Part], otherwise: Part) -> Part:
        """Part of a report made from other parts; if their numbers are too extreme, `otherwise`, and a note."""
        try:
            return work()
        except _OF_NUMBERS as error:
            self._note(title, error)
            return otherwise

    def _note(self, title: str, error: Exception) -> None:
        sentence = f"{title} could not be worked out: numbers of this campaign are too large or too small for it"
        sentence += f" ({type(error).__name__})."
        if sentence not in self.sentences:
            self.sentences.append(sentence)
