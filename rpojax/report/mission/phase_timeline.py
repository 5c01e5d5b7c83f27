"""Share of the runs in each phase of a mission against time."""

from typing import Any, Final

import numpy as np

from rpojax.report.campaign_results import CampaignResults
from rpojax.report.figures.charts.plotly_charts import Chart, rounded_values
from rpojax.report.figures.charts.time_chart import MAX_POINTS, time_layout
from rpojax.report.figures.colours import BLUE, GREEN, ORANGE, PURPLE, SHADE, SKY_BLUE, VERMILLION, YELLOW
from rpojax.report.labels import ChannelLabel
from rpojax.report.mission.phase_visits import phase_visits

_SHARE: Final = ChannelLabel("phase_share", "Runs in each phase", "%")
_COLOURS: Final = (BLUE, ORANGE, GREEN, PURPLE, SKY_BLUE, YELLOW)


def chart(campaign: CampaignResults) -> Chart | None:
    """Shares of all runs [%], stacked in the order of the phases; None without phases.

    Runs that were frozen by then are in none.
    """
    if not campaign.phases:
        return None
    duration = float(campaign.info["scenario"]["duration_s"])
    step = max(1.0, np.ceil(duration / MAX_POINTS))
    time_s = np.append(np.arange(0.0, duration, step), duration)
    frozen_at_s = np.where(campaign.reached_end, np.nan, campaign.failed_at_s)
    present = phase_visits(campaign.phases).at(time_s, frozen_at_s)
    traces = []
    for number, name in enumerate(campaign.phase_names):
        share = 100.0 * np.mean(present == number, axis=0)
        if share.any():
            traces.append(_area(name, _colour(number, len(campaign.phase_names)), time_s, share))
    layout = time_layout(_SHARE, traces)
    layout["yaxis"]["range"] = [0, 100]
    layout["legend"]["traceorder"] = "normal"
    return {"data": traces, "layout": layout}


def _colour(number: int, count: int) -> str:
    """Colour of a phase; the last two are those of holding and of aborts."""
    built_in = {count - 2: SHADE, count - 1: VERMILLION}
    return built_in.get(number, _COLOURS[number % len(_COLOURS)])


def _area(name: str, colour: str, time_s: np.ndarray, share: np.ndarray) -> dict[str, Any]:
    return {
        "type": "scatter",
        "mode": "lines",
        "stackgroup": "phases",
        "x": rounded_values(time_s),
        "y": rounded_values(share),
        "name": name,
        "line": {"width": 0, "color": colour, "shape": "hv"},
        "fillcolor": colour,
        "hovertemplate": f"{name}: %{{y:.3g}} %<extra></extra>",
    }
