"""Figures of a campaign for consoles and notebooks; the drawing loads on first use."""

import pkgutil
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any, SupportsIndex

if TYPE_CHECKING:
    from matplotlib.figure import Figure


class CampaignPlots:
    """Figures of the finished runs of a `Campaign`, each a `matplotlib.figure.Figure`, with units and limits."""

    def __init__(self, campaign: Any) -> None:
        self._campaign = campaign

    def envelope(self, channel: str = "range_m", servicer: SupportsIndex | str | None = None) -> "Figure":
        """Median, bands of 50 % and 90 % of the runs, and extremes of a channel of the traces over time.

        Args:
            channel: one of `campaign.traces`
            servicer: number or name of a servicer of a team; None for the channel of the team, or of a single servicer

        Raises:
            RpojaxError: there is no such channel or servicer, or no finished run.
        """
        return _draw("envelope", self._campaign, channel, servicer)

    def histogram(self, metric: str) -> "Figure":
        """Distribution of a metric over the runs, with the limits of requirements on it.

        Args:
            metric: one of `campaign.metrics`

        Raises:
            RpojaxError: there is no such metric, or no finished run.
        """
        return _draw("histogram", self._campaign, metric)

    def scatter(self, x: str, y: str) -> "Figure":
        """One point a run: two metrics or dispersed numbers against each other, failed runs marked.

        Args:
            x: one of `campaign.metrics`, or a key of `campaign.drawn`, of a vector with its component as `KEY[0]`
            y: the same

        Raises:
            RpojaxError: there is no such number, or no finished run.
        """
        return _draw("scatter", self._campaign, x, y)

    def path(self, run_ids: Iterable[SupportsIndex] | SupportsIndex | None = None) -> "Figure":
        """Paths of servicers around the target in the Hill frame [m], of runs with a stored history, with keep-out.

        Args:
            run_ids: numbers of the runs; None for the first eight with a history

        Raises:
            RpojaxError: a run has no history.
        """
        return _draw("path", self._campaign, run_ids)

    def __repr__(self) -> str:
        return "figures of a campaign: envelope(channel), histogram(metric), scatter(x, y), path(run_ids)"


def _draw(name: str, *arguments: Any) -> "Figure":
    """Figure of a function of the report, which is above the storage of campaigns."""
    return pkgutil.resolve_name(f"rpojax.report.figures.campaign_figures:{name}")(*arguments)
