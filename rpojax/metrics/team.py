"""Metrics of a team of servicers: how near they come to each other, and how long nobody sees the target."""

from typing import Final

from rpojax.metrics.metric_definition import Metric

SEPARATION: Final = "min_separation_m"
PASSIVE_SEPARATION: Final = "passive_separation_m"
UNSEEN: Final = "team_unseen_peak_s"
DELIVERY: Final = "news_fraction"
CHANGED_BURNS: Final = "burns_changed_for_others"

METRICS: Final = (
    Metric(
        SEPARATION,
        "m",
        title="Least distance between servicers",
        meaning="Least true distance between any two servicers of a team.",
        low_is_bad=True,
        source="team",
    ),
    Metric(
        PASSIVE_SEPARATION,
        "m",
        title="Least distance between servicers in free drift",
        meaning="Least distance between any two servicers of a team if both drift freely from any instant, over the "
        "longest horizon of passive safety.",
        low_is_bad=True,
        source="team",
    ),
    Metric(
        UNSEEN,
        "s",
        title="Longest time without a box of anybody",
        meaning="Longest time, after the first accepted box, in which no servicer of a team has accepted a box.",
        source="team",
    ),
    Metric(
        DELIVERY,
        "-",
        title="Share of used messages",
        meaning="Share of ticks and pairs of servicers in which what one sent was used by the other.",
        low_is_bad=True,
        source="team",
    ),
    Metric(
        CHANGED_BURNS,
        "-",
        title="Burns changed for other servicers",
        meaning="Number of burn decisions that were changed since the free drift after the burn would have come too "
        "near to that of another servicer.",
        source="team",
    ),
)
"""Metrics of teams."""
