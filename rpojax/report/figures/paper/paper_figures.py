"""Figures 6, 7 and 8 of the paper for one run with full history, as PNG files."""

from collections.abc import Callable
from pathlib import Path

from matplotlib.figure import Figure

from rpojax.campaign.storage.atomic_outputs import write_atomically
from rpojax.report.figures import png_export
from rpojax.report.figures.paper.bearing_and_range_figure import bearing_and_range
from rpojax.report.figures.paper.estimation_error_figure import estimation_error
from rpojax.report.figures.paper.history_axes import History
from rpojax.report.figures.paper.relative_position_figure import relative_position

_HEADINGS = {
    "bearing_and_range.png": "Bearing and range (as Figure 6 of the paper)",
    "estimation_error.png": "Estimation error (as Figure 7 of the paper)",
    "relative_position.png": "Relative position (as Figure 8 of the paper)",
}
FIGURES: dict[str, Callable[[History, str], Figure]] = {
    "bearing_and_range.png": bearing_and_range,
    "estimation_error.png": estimation_error,
    "relative_position.png": relative_position,
}
"""File name -> function that draws the figure from a history and a title."""
_COMMON_CHANNELS = ("time_s", "mode", "rho_H")
REQUIRED_CHANNELS: dict[str, tuple[str, ...]] = {
    "bearing_and_range.png": (*_COMMON_CHANNELS, "box_bearing_H", "box_range_m", "box_present", "box_accepted"),
    "estimation_error.png": (
        *_COMMON_CHANNELS,
        *(f"{name}_{part}_H" for name in ("target", "servicer", "relative") for part in ("error", "sigma")),
    ),
    "relative_position.png": (*_COMMON_CHANNELS, "rho_estimate_H", "rho_desired_H"),
}
"""Channels that each figure shows."""


def missing_channels(history: History) -> dict[str, list[str]]:
    """File name of each figure that cannot be drawn -> channels that the history lacks."""
    absent = {
        name: [channel for channel in needed if channel not in history] for name, needed in REQUIRED_CHANNELS.items()
    }
    return {name: channels for name, channels in absent.items() if channels}


def write_figures(history: History, directory: Path, title: str) -> dict[str, Path]:
    """Writes the figures whose channels a history contains into `directory` as PNG; returns file name -> path."""
    omitted = missing_channels(history)
    return {
        name: write_atomically(directory / name, png_export.png_bytes(draw(history, f"{_HEADINGS[name]}: {title}")))
        for name, draw in FIGURES.items()
        if name not in omitted
    }
