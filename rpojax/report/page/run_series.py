"""Channels of one run over time, thinned so that no peak is lost."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final

import numpy as np

from rpojax.report.campaign_results import CampaignResults, nominal_keep_out_radii
from rpojax.report.figures.plotly_charts import rounded_values
from rpojax.report.labels import ChannelLabel
from rpojax.report.page.shown_mesh import shown_mesh

History = Mapping[str, np.ndarray]
MAX_SAMPLES: Final = 400
"""Most samples of a channel on the page."""
_MAX_POINTS: Final = 240
"""Most points of a path."""
_MAX_RUNS: Final = 24
HistoryReader = Callable[[int], Mapping[str, np.ndarray]]
"""Reads the history of a run."""


def formation_error(history: History) -> np.ndarray:
    """Distance [m] of the servicer from its desired position (ticks,)."""
    return np.linalg.norm(history["rho_H"] - history["rho_desired_H"], axis=-1)


def relative_error(history: History) -> np.ndarray:
    """Error [m] of the estimated relative position (ticks,)."""
    return np.linalg.norm(history["relative_error_H"], axis=-1)


def relative_bound(history: History) -> np.ndarray:
    """Root sum of squares of the three 3-sigma bounds of the relative position [m] (ticks,)."""
    return 3.0 * np.linalg.norm(history["relative_sigma_H"], axis=-1)


def fastest_wheel(history: History) -> np.ndarray:
    """Speed of the fastest wheel over its limit (ticks,)."""
    return np.max(np.abs(history["wheel_speed_fraction"]), axis=-1)


SERIES: Final[tuple[tuple[ChannelLabel, tuple[str, ...], Callable[[History], np.ndarray]], ...]] = (
    (ChannelLabel("range_m", "Range to the target", "m", low_is_bad=True), ("range_m",), lambda h: h["range_m"]),
    (
        ChannelLabel("formation_error_m", "Formation error", "m", logarithmic=True),
        ("rho_H", "rho_desired_H"),
        formation_error,
    ),
    (
        ChannelLabel("nav_relative_error_m", "Relative navigation error", "m", logarithmic=True),
        ("relative_error_H",),
        relative_error,
    ),
    (
        ChannelLabel("nees_relative", "NEES of the 6 relative components", "", logarithmic=True),
        ("nees_relative",),
        lambda h: h["nees_relative"],
    ),
    (ChannelLabel("delta_v_m_s", "Delta-v applied", "m/s"), ("delta_v_m_s",), lambda h: h["delta_v_m_s"]),
    (
        ChannelLabel("pointing_error_deg", "Angle from the boresight to the target", "deg", logarithmic=True),
        ("pointing_error_deg",),
        lambda h: h["pointing_error_deg"],
    ),
    (
        ChannelLabel("wheel_speed_fraction", "Speed of the fastest wheel over its limit", ""),
        ("wheel_speed_fraction",),
        fastest_wheel,
    ),
)
"""Channels shown of a run: label, the recorded channels that it is made of, and its values."""


def run_series(history: History) -> dict[str, list[float | None]]:
    """`time_s` and every channel of `SERIES` that the history has, as peaks of equal spans of time.

    The peak is the smallest value where low values are bad, else the largest.
    """
    found = {"time_s": thinned_time(history["time_s"])}
    for label, needed, values in SERIES:
        if all(name in history for name in needed):
            found[label.name] = rounded_values(thinned_peaks(values(history), label.low_is_bad))
    if "relative_sigma_H" in history:
        found["nav_relative_sigma3_m"] = rounded_values(thinned_peaks(relative_bound(history), True))
    return found


def thinned_time(time_s: np.ndarray) -> list[float | None]:
    """First time [s] of each span."""
    return rounded_values(time_s[:: _stride(len(time_s))])


def thinned_peaks(values: np.ndarray, low_is_bad: bool) -> np.ndarray:
    """Largest, or smallest, finite value (spans,) of each span of `values` (ticks,); NaN if none is finite."""
    stride = _stride(len(values))
    padded = np.full(-(-len(values) // stride) * stride, np.nan)
    padded[: len(values)] = values
    spans = padded.reshape(-1, stride)
    filled = np.where(np.isfinite(spans), spans, np.inf if low_is_bad else -np.inf)
    peaks = filled.min(axis=1) if low_is_bad else filled.max(axis=1)
    return np.where(np.isfinite(peaks), peaks, np.nan)


def series_channels() -> list[dict[str, Any]]:
    """Name, title, unit and kind of axis of every channel, in display order."""
    return [
        {"name": label.name, "title": label.title, "unit": label.unit, "log": label.logarithmic}
        for label, _, _ in SERIES
    ]


def _stride(ticks: int) -> int:
    return max(1, -(-ticks // MAX_SAMPLES))


def path_scene(
    campaign: CampaignResults, median_run: int | None, worst: Sequence[int], read: HistoryReader | None = None
) -> dict[str, Any] | None:
    """Content of the 3-D view in Hill axes [m]; None if no history holds relative positions.

    Paths are those of the runs with a history, the median one and the `worst` ones named, the others as context.
    Histories come from `read`, by default from the campaign.
    """
    history_of = read or campaign.history
    kept = sorted(campaign.history_ids)
    chosen = [run for run in dict.fromkeys([*([] if median_run is None else [median_run]), *worst]) if run in kept]
    shown = [*chosen, *(run for run in kept if run not in chosen)][:_MAX_RUNS]
    paths = [path for run in shown for path in _paths(campaign, history_of(run), run, _kind(run, median_run, worst))]
    if not paths:
        return None
    scenario = campaign.info.get("scenario", {})
    return {
        "paths": paths,
        "target": shown_mesh(scenario),
        "keep_out_m": max(radii := nominal_keep_out_radii(campaign), default=None),
        "spheres_m": radii,
        "desired": _desired(campaign, history_of(shown[0])),
    }


def _kind(run: int, median_run: int | None, worst: Sequence[int]) -> str:
    if run in worst and run != median_run:
        return "worst"
    return "median" if run == median_run else "other"


def _paths(campaign: CampaignResults, history: Mapping[str, np.ndarray], run: int, kind: str) -> list[dict[str, Any]]:
    """Paths of a run, one for each servicer."""
    if "rho_H" not in history:
        return []
    rho = np.asarray(history["rho_H"], dtype=np.float64)
    names = list(campaign.servicer_names) or [""]
    columns = [rho[:, number] for number in range(len(names))] if campaign.servicer_names else [rho]
    return [
        {"run": run, "kind": kind, "servicer": name, "points": _thinned(column)}
        for name, column in zip(names, columns, strict=True)
    ]


def _thinned(points: np.ndarray) -> list[float]:
    """Coordinates of at most `_MAX_POINTS` finite points, the last one included, in a row."""
    finite = points[np.isfinite(points).all(axis=1)]
    if not len(finite):
        return []
    rows = np.unique(np.linspace(0, len(finite) - 1, min(len(finite), _MAX_POINTS)).astype(int))
    return [float(f"{value:.4g}") for value in finite[rows].ravel()]


def _desired(campaign: CampaignResults, history: Mapping[str, np.ndarray]) -> list[list[float]]:
    """Desired positions [m]: one for each servicer; none where it moves."""
    desired = np.asarray(history.get("rho_desired_H", np.zeros(0)), dtype=np.float64)
    if campaign.servicer_names and desired.shape == (len(campaign.servicer_names), 3):
        return desired.round(3).tolist()
    return [desired.round(3).tolist()] if desired.shape == (3,) else []
