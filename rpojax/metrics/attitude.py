"""Metrics of the attitude: pointing error, reaction wheels, and time turned away from the target."""

from typing import Final

from rpojax.flight.guidance.pointing_modes import Mode
from rpojax.metrics import record_statistics
from rpojax.metrics.metric_definition import Metric, WeightedValue

METRICS: Final = (
    Metric(
        "pointing_error_p95_deg",
        "deg",
        title="Pointing error, p95",
        meaning="95th percentile of the angle from boresight to target while target pointing is commanded and settled.",
        inputs=("pointing_error_deg", "is_settled"),
        value=lambda _, error, settled: WeightedValue(error, settled),
        reduction=record_statistics.percentile(95.0),
    ),
    Metric(
        "pointing_error_rms_deg",
        "deg",
        title="Pointing error, RMS",
        meaning="RMS angle from boresight to target while target pointing is commanded and settled, "
        "from 1000 s (or a third of a shorter run) to the end.",
        # The angle is small while the camera points at the target: its sine approximates it.
        inputs=("pointing_error_sine_N", "is_settled"),
        value=lambda xp, sine, settled: WeightedValue(xp.rad2deg(sine), settled),
        reduction="rms",
        window="late",
        has_derivative=True,
        source="simulation",
    ),
    Metric(
        "wheel_speed_peak_fraction",
        "-",
        title="Peak wheel speed",
        meaning="Highest reaction wheel speed as a fraction of its limit.",
        inputs=("wheel_speed_fraction",),
        value=lambda xp, fraction: xp.abs(fraction),
        reduction="max",
        has_derivative=True,
    ),
    Metric(
        "look_away_peak_s",
        "s",
        title="Look-away in a burn period",
        meaning="Longest total time turned away from the target (turn, burn, turn back) in one burn period.",
        inputs=("mode",),
        value=lambda _, mode: (mode == Mode.TURN) | (mode == Mode.BURN) | (mode == Mode.TURN_BACK),
        reduction=record_statistics.longest_total_between_decisions,
    ),
)
