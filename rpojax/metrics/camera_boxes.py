"""Metrics of the camera's bounding boxes: acquisition, detection, and decisions of the filter's gate."""

from typing import Final

from rpojax.metrics import record_statistics
from rpojax.metrics.metric_definition import Metric, WeightedValue

METRICS: Final = (
    Metric(
        "reacquisition_peak_s",
        "s",
        title="Longest reacquisition",
        meaning="Longest time from the target's exit from shadow to the next accepted box.",
        of_events=True,
        inputs=("observable", "box_accepted", "box_outlier"),
        value=lambda xp, observable, accepted, outlier: xp.stack([observable, accepted & ~outlier], axis=-1),
        reduction=record_statistics.longest_wait,
    ),
    Metric(
        "longest_unseen_s",
        "s",
        title="Longest time unseen",
        meaning="Longest time without an accepted box, look-aways included.",
        inputs=("box_accepted",),
        value=lambda _, accepted: ~accepted,
        reduction=record_statistics.longest_streak,
    ),
    Metric(
        "time_to_acquire_s",
        "s",
        title="Time to acquire",
        meaning="Time until the first accepted box.",
        inputs=("box_accepted",),
        reduction=record_statistics.time_to_first,
    ),
    Metric(
        "visible_fraction",
        "-",
        title="Tracked fraction",
        meaning="Fraction of all frames with an accepted box.",
        inputs=("box_accepted",),
        reduction="mean",
        low_is_bad=True,
    ),
    Metric(
        "detection_rate",
        "-",
        title="Detection rate",
        meaning="Boxes per frame in which the light allows the target to be seen, look-aways included.",
        inputs=("box_present", "observable"),
        value=lambda _, present, observable: WeightedValue(present, observable),
        reduction="mean",
        low_is_bad=True,
    ),
    Metric(
        "boxes_rejected",
        "-",
        title="Boxes rejected",
        meaning="Number of boxes that the filter's gate rejected.",
        inputs=("box_present", "box_accepted"),
        value=lambda _, present, accepted: present & ~accepted,
        reduction="sum",
    ),
    Metric(
        "good_boxes_rejected_fraction",
        "-",
        title="Good boxes rejected",
        meaning="Fraction of true boxes that the gate rejected.",
        inputs=("box_present", "box_accepted", "box_outlier"),
        value=lambda _, present, accepted, outlier: WeightedValue(~accepted, present & ~outlier),
        reduction="mean",
    ),
    Metric(
        "outliers_accepted",
        "-",
        title="Outliers accepted",
        meaning="Number of false boxes that passed the gate.",
        inputs=("box_accepted", "box_outlier"),
        value=lambda _, accepted, outlier: accepted & outlier,
        reduction="sum",
    ),
)
