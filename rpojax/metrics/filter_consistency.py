"""Metrics of the consistency of the orbit filter: NEES, NIS, whiteness of innovations, and 3-sigma bounds."""

from dataclasses import replace
from types import ModuleType
from typing import Final

from rpojax.metrics import record_statistics
from rpojax.metrics.metric_definition import Metric, Quantity, WeightedValue


def _complete_innovation(xp: ModuleType, sigmas: Quantity) -> WeightedValue:
    """Decorrelated innovation in sigmas, of the ticks with all rows."""
    complete = xp.all(xp.isfinite(sigmas), axis=-1)
    return WeightedValue(xp.where(complete[..., None], sigmas, 0.0).astype(float), complete)


def _innovation_squared(xp: ModuleType, sigmas: Quantity) -> WeightedValue:
    """Normalised innovation squared, of the ticks with all rows."""
    rows, complete = _complete_innovation(xp, sigmas)
    return WeightedValue(xp.sum(rows * rows, axis=-1), complete)


def _nis(sensor: str, title: str, of: str, rows: int = 3) -> Metric:
    return Metric(
        f"nis_{sensor}_mean",
        "-",
        title=f"NIS, {title}",
        meaning=f"Mean normalised innovation squared of {of}; {rows} is consistent.",
        inputs=(f"{sensor}_innovation_sigmas",),
        value=_innovation_squared,
        reduction="mean",
        has_derivative=True,
        degrees_of_freedom=rows,
    )


def _whiteness(sensor: str, title: str, of: str) -> Metric:
    return Metric(
        f"{sensor}_innovation_lag1",
        "-",
        title=f"Whiteness, {title}",
        meaning=f"Correlation of normalised {of} one tick apart; 0 for a consistent filter.",
        inputs=(f"{sensor}_innovation_sigmas",),
        value=_complete_innovation,
        reduction=record_statistics.lag_1_autocorrelation,
    )


METRICS: Final = (
    Metric(
        "nees_mean",
        "-",
        title="NEES, both spacecraft",
        meaning="Mean normalised estimation error squared of the 12 position and velocity components; "
        "12 is consistent.",
        inputs=("nees",),
        reduction="mean",
        has_derivative=True,
        degrees_of_freedom=12,
    ),
    Metric(
        "nees_relative_mean",
        "-",
        title="NEES, relative",
        meaning="Mean normalised estimation error squared of the 6 components of the relative state; 6 is consistent.",
        inputs=("nees_relative",),
        reduction="mean",
        has_derivative=True,
        degrees_of_freedom=6,
    ),
    _nis("gps", "GPS", "the three GPS coordinates"),
    _nis("box", "box", "bearing and size of the accepted, untruncated boxes"),
    _whiteness("gps", "GPS", "GPS innovations"),
    _whiteness("box", "box", "box innovations"),
    Metric(
        "sigma3_coverage",
        "-",
        title="3-sigma coverage",
        meaning="Fraction of seconds and Hill axes in which the relative position error is inside 3 sigma; "
        "a normal error gives 0.9973.",
        inputs=("relative_error_H", "relative_sigma_H"),
        value=lambda xp, error, sigma: xp.abs(error) <= 3.0 * sigma,
        reduction="mean",
        low_is_bad=True,
    ),
    Metric(
        "error_over_sigma3_peak",
        "-",
        title="Worst error over 3 sigma",
        meaning="Largest relative position error over its own 3-sigma bound, any axis and time.",
        inputs=("relative_error_H", "relative_sigma_H"),
        value=lambda xp, error, sigma: xp.abs(error) / (3.0 * sigma),
        reduction="max",
    ),
)
"""Rows of an innovation are decorrelated, so that a consistent filter has a mean of its squared norm of 3."""


def sensor_metrics(sensor: str, rows: int) -> tuple[Metric, ...]:
    """Metrics of an additional sensor that the filter believes, with `rows` rows in a measurement."""
    title = sensor.replace("_", " ")
    of_innovations = (
        _nis(sensor, title, f"the measurements of {title} that were used", rows),
        _whiteness(sensor, title, f"innovations of {title}"),
    )
    used = Metric(
        f"{sensor}_used_fraction",
        "-",
        title=f"Used, {title}",
        meaning=f"Measurements of {title} that the filter used, per tick.",
        inputs=(f"{sensor}_accepted",),
        reduction="mean",
        low_is_bad=True,
    )
    return tuple(replace(each, source="plugin") for each in (*of_innovations, used))
