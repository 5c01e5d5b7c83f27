"""Time windows of metrics."""

from rpojax.metrics.metric_definition import Window


def first_tick(window: Window, ticks: int, tick_s: float) -> int:
    """First tick of a window of a run of `ticks`: `late` is from 1000 s to the end, `last` the final 1000 s.

    A run shorter than 3000 s has a third of its duration in place of 1000 s.
    """
    third = max(1, min(round(1000.0 / tick_s), ticks // 3))
    match window:
        case "all":
            return 0
        case "late":
            return min(third, ticks - 1)
        case "last":
            return ticks - third
