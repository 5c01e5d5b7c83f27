"""Metrics of runs from their recorded channels; an undefined metric is NaN, and null in a report."""

from collections.abc import Callable, Mapping
from typing import Final

import numpy as np
from numpy.typing import NDArray

from rpojax.flight.guidance.pointing_modes import Mode
from rpojax.scenario import metric_catalogue
from rpojax.scenario.schema import ScenarioFile

Floats = NDArray[np.floating]
Records = Mapping[str, np.ndarray]

REQUIRED_CHANNELS: Final = (
    "rho_H",
    "relative_error_H",
    "relative_sigma_H",
    "servicer_error_H",
    "target_error_H",
    "nees",
    "nees_relative",
    "gps_innovation_sigmas",
    "box_innovation_sigmas",
    "range_m",
    "passive_range_m",
    "box_present",
    "box_accepted",
    "box_outlier",
    "observable",
    "mode",
    "pointing_error_deg",
    "wheel_speed_fraction",
    "delta_v_m_s",
)
"""Channels that the metrics read."""


def evaluate(file: ScenarioFile, records: Records) -> dict[str, Floats]:
    """Metrics (runs,) from channels of shape (runs, ticks) or (runs, ticks, components), at the camera rate.

    Errors are RMS of 3-D norms over all ticks, target visible or not: the formation error over the last 1000 s, the
    navigation errors from 1000 s on (a third of a run shorter than 3000 s in place of 1000 s).
    """
    tick_s = 1.0 / file.rates.camera_hz
    ticks = records["range_m"].shape[1]
    late, last = (slice(first, None) for first in metric_catalogue.window_starts(ticks, tick_s))
    desired = np.asarray(file.formation.desired_position_m)
    inside = np.abs(records["relative_error_H"]) <= 3.0 * records["relative_sigma_H"]
    return {
        "formation_error_rms_m": _rms((records["rho_H"] - desired)[:, last]),
        "nav_relative_position_error_rms_m": _rms(records["relative_error_H"][:, late]),
        "nav_servicer_position_error_rms_m": _rms(records["servicer_error_H"][:, late]),
        "nav_target_position_error_rms_m": _rms(records["target_error_H"][:, late]),
        "nees_mean": _mean(records["nees"]),
        "nees_relative_mean": _mean(records["nees_relative"]),
        **_innovations("gps", records["gps_innovation_sigmas"]),
        **_innovations("box", records["box_innovation_sigmas"]),
        "sigma3_coverage": inside.mean(axis=(1, 2), dtype=float),
        "delta_v_m_s": records["delta_v_m_s"][:, -1].astype(float),
        "min_range_m": records["range_m"].min(axis=1).astype(float),
        "passive_range_m": records["passive_range_m"].min(axis=1).astype(float),
        "error_over_sigma3_peak": _peak_ratio(records["relative_error_H"], 3.0 * records["relative_sigma_H"]),
        **_boxes(records, tick_s),
        **_pointing(file, records, tick_s),
    }


def _rms(vectors: Floats) -> Floats:
    x, y, z = np.moveaxis(vectors.astype(float), 2, 0)
    return np.sqrt(_mean(x * x + y * y + z * z))


def _mean(values: Floats) -> Floats:
    """Mean over time, summed in order of time.

    The order of summation of `numpy.sum` depends on the memory layout, so that the last bits would not be reproducible.
    """
    return _sum(values) / values.shape[1]


def _sum(values: Floats) -> Floats:
    return np.add.accumulate(values, axis=1, dtype=float)[:, -1]


def _innovations(name: str, sigmas: Floats) -> dict[str, Floats]:
    """Mean normalised innovation squared of the ticks with all rows, and the lag-1 autocorrelation.

    Rows are decorrelated, so that a consistent filter has a mean of 3, and an autocorrelation of 0 with a variance of
    one over the number of products (Bar-Shalom, Li and Kirubarajan, 5.4.2).
    """
    whole: NDArray[np.bool_] = np.all(np.isfinite(sigmas), axis=2)
    rows = np.where(whole[:, :, None], sigmas, 0.0).astype(float)
    square = _sum((rows * rows).sum(axis=2))
    pairs = whole[:, 1:] & whole[:, :-1]
    product = np.where(pairs, (rows[:, 1:] * rows[:, :-1]).sum(axis=2), 0.0)
    power = np.where(pairs, 0.5 * (rows[:, 1:] ** 2 + rows[:, :-1] ** 2).sum(axis=2), 0.0)
    return {
        f"nis_{name}_mean": _ratio(square, whole.sum(axis=1)),
        f"{name}_innovation_lag1": _ratio(_sum(product), _sum(power)),
    }


def _boxes(records: Records, tick_s: float) -> dict[str, Floats]:
    present, accepted = records["box_present"], records["box_accepted"]
    outlier, observable = records["box_outlier"], records["observable"]
    rejected = present & ~accepted
    good = present & ~outlier
    ever = accepted.any(axis=1)
    return {
        "detection_rate": _ratio((present & observable).sum(axis=1), observable.sum(axis=1)),
        "visible_fraction": accepted.mean(axis=1, dtype=float),
        "boxes_rejected": rejected.sum(axis=1).astype(float),
        "good_boxes_rejected_fraction": _ratio((rejected & good).sum(axis=1), good.sum(axis=1)),
        "outliers_accepted": (accepted & outlier).sum(axis=1).astype(float),
        "time_to_acquire_s": np.where(ever, accepted.argmax(axis=1) * tick_s, np.nan),
        "longest_unseen_s": tick_s * _longest_streak(~accepted),
        "reacquisition_peak_s": tick_s * _longest_wait(observable, accepted & ~outlier),
    }


def _pointing(file: ScenarioFile, records: Records, tick_s: float) -> dict[str, Floats]:
    mode = records["mode"]
    settle = round(file.pointing.settle_time_s / tick_s)
    looking = mode == Mode.LOOK
    settled = looking.copy()
    for shift in range(1, settle + 1):
        settled[:, shift:] &= looking[:, :-shift]
    error = np.where(settled, records["pointing_error_deg"], np.nan).astype(float)
    away = (mode == Mode.TURN) | (mode == Mode.BURN) | (mode == Mode.TURN_BACK)
    period = round(file.rates.formation_period_s / tick_s)
    return {
        "pointing_error_p95_deg": _reduce_defined_rows(lambda rows: np.nanpercentile(rows, 95.0, axis=1), error),
        "wheel_speed_peak_fraction": np.abs(records["wheel_speed_fraction"]).max(axis=(1, 2)).astype(float),
        "look_away_peak_s": tick_s
        * np.add.reduceat(away, np.arange(0, away.shape[1], period), axis=1, dtype=float).max(1),
    }


def _ratio(part: NDArray[np.number], whole: NDArray[np.number]) -> Floats:
    return np.where(whole > 0, part / np.where(whole > 0, whole, 1), np.nan)


def _reduce_defined_rows(reduce: Callable[[Floats], Floats], rows: Floats) -> Floats:
    """`reduce` of the rows with at least one finite number; NaN for the others."""
    result = np.full(rows.shape[0], np.nan)
    some = np.isfinite(rows).any(axis=1)
    if some.any():
        result[some] = reduce(rows[some])
    return result


def _longest_streak(flags: NDArray[np.bool_]) -> Floats:
    """Length of the longest run of true values in each row [ticks]."""
    streak = np.zeros(flags.shape[0])
    longest = np.zeros(flags.shape[0])
    for column in flags.T:
        streak = np.where(column, streak + 1.0, 0.0)
        longest = np.maximum(longest, streak)
    return longest


def _longest_wait(visible: NDArray[np.bool_], accepted: NDArray[np.bool_]) -> Floats:
    """Longest time in each row from `visible` becoming true to the next accepted box or the end [ticks]."""
    waits = np.full(visible.shape[0], np.nan)
    waiting = np.zeros(visible.shape[0], dtype=bool)
    clock = np.zeros(visible.shape[0])
    for before, now, seen in zip(visible.T[:-1], visible.T[1:], accepted.T[1:], strict=True):
        clock = np.where(now & ~before, 0.0, clock + 1.0)
        waiting = (waiting | (now & ~before)) & now
        waits = np.where(waiting, np.fmax(waits, clock), waits)
        waiting &= ~seen
    return waits


def _peak_ratio(error: Floats, bound: Floats) -> Floats:
    """Largest ratio of an error to its bound, over axes and time."""
    return (np.abs(error) / bound).max(axis=(1, 2)).astype(float)
