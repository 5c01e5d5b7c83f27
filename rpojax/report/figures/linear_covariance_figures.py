"""Figures of a linear covariance analysis, optionally compared with Monte Carlo samples."""

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from rpojax.analysis.linear_covariance.covariance_propagation import ErrorBudget, LinearCovariance
from rpojax.analysis.linear_covariance.monte_carlo_agreement import MonteCarloSample
from rpojax.campaign.storage.atomic_outputs import write_atomically
from rpojax.report.figures import png_export
from rpojax.report.figures.colours import BLUE, GREEN, GRID, INK, MUTED, ORANGE, SHADE, VERMILLION
from rpojax.report.figures.png_export import AXIS_NAMES

_BAND_SIGMAS = 2.0
_BAND_PERCENTILES = (2.275, 97.725)
"""Percentiles of a normal distribution two sigma to either side of its mean."""
_VISIBLE_FRACTION, _MARGIN = 0.98, 1.3
"""Fraction of the times at which the band of the estimation error is inside the axes, and the margin around it."""
_MAX_SOURCES = 8
"""Most sources shown as bars."""


def formation_error(linear: LinearCovariance, desired_H: np.ndarray, sampled: MonteCarloSample | None) -> Figure:
    """Formation error [m] per Hill axis: mean with two-sigma band, and standard deviation."""
    return _plot_three_axes(linear, "rho_H", desired_H, sampled, "Formation error")


def estimation_error(linear: LinearCovariance, sampled: MonteCarloSample | None) -> Figure:
    """Error of the estimated relative position [m] per Hill axis, with the filter's own sigma."""
    return _plot_three_axes(
        linear, "relative_error_H", np.zeros(3), sampled, "Error of the estimated relative position"
    )


def delta_v(linear: LinearCovariance, decisions_s: np.ndarray, sampled: MonteCarloSample | None) -> Figure:
    """Accumulated velocity change [mm/s], and probability of a burn at each decision."""
    figure = Figure(figsize=(10.8, 5.6), layout="constrained")
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=(2.0, 1.0))
    mean, sigma = 1e3 * linear.output_mean("delta_v_m_s")[:, 0], 1e3 * linear.sigma("delta_v_m_s")[:, 0]
    if sampled is not None:
        low, high = np.percentile(1e3 * sampled.values["delta_v_m_s"][:, :, 0], _BAND_PERCENTILES, axis=1)
        above.fill_between(sampled.time_s, low, high, color=SHADE, alpha=0.35, lw=0, label=_sample_label(sampled))
    above.plot(linear.time_s, mean, color=BLUE, lw=1.2, label="linear covariance: mean, two sigma")
    for side in (-_BAND_SIGMAS, _BAND_SIGMAS):
        above.plot(linear.time_s, mean + side * sigma, color=BLUE, lw=0.9, ls=(0, (4, 2)))
    _style_axes(above, "velocity change spent [mm/s]")
    above.legend(loc="lower right", frameon=False, fontsize=9)
    width = 0.7 * (decisions_s[1] - decisions_s[0] if len(decisions_s) > 1 else linear.time_s[-1])
    below.bar(decisions_s, linear.burn_probability, width=width, align="edge", color=ORANGE)
    below.set_ylim(0.0, 1.05)
    _style_axes(below, "probability of a burn")
    below.set_xlabel("time [s]", color=INK)
    figure.suptitle("Velocity change", color=INK, fontsize=12)
    return figure


def error_budget(budget: ErrorBudget) -> Figure:
    """Error budget at the end of the run: standard deviation [m] due to each source alone."""
    figure = Figure(figsize=(10.8, 4.6), layout="constrained")
    for axes, (title, table) in zip(figure.subplots(1, 2), budget.at_end.items(), strict=True):
        largest = sorted(table.items(), key=lambda item: item[1])[-_MAX_SOURCES:]
        bars = axes.barh([name for name, _ in largest], [value for _, value in largest], color=BLUE)
        axes.bar_label(bars, fmt="%.3f", padding=3, fontsize=8, color=MUTED)
        axes.margins(x=0.15)
        _style_axes(axes, "")
        axes.set_xlabel("standard deviation, three axes together [m]", color=INK)
        axes.set_title(f"{title}, {budget.total_at_end[title]:.3f} m in all", fontsize=10, color=INK)
    return figure


def write_png(figure: Figure, path: Path) -> Path:
    """Writes a figure as PNG; returns `path`."""
    return write_atomically(path, png_export.png_bytes(figure))


def _plot_three_axes(
    linear: LinearCovariance, output: str, offset: np.ndarray, sampled: MonteCarloSample | None, title: str
) -> Figure:
    figure = Figure(figsize=(10.8, 6.8), layout="constrained")
    cells = figure.subplots(3, 2, sharex=True)
    for axis, (bands, sigmas) in enumerate(cells):
        _plot_bands(bands, linear, output, offset, axis, sampled)
        _plot_sigmas(sigmas, linear, output, axis, sampled)
        _style_axes(bands, f"{AXIS_NAMES[axis]} [m]")
        _style_axes(sigmas, "1 sigma [m]")
    for axes in cells[-1]:
        axes.set_xlabel("time [s]", color=INK)
    for axes, heading in zip(cells[0], ("Two sigma to either side of the mean", "Standard deviation"), strict=True):
        axes.set_title(heading, fontsize=10, color=INK, loc="left")
        axes.legend(loc="upper right", frameon=False, fontsize=8)
    figure.suptitle(title, color=INK, fontsize=12)
    return figure


def _plot_bands(
    axes: Axes, linear: LinearCovariance, output: str, offset: np.ndarray, axis: int, sampled: MonteCarloSample | None
) -> None:
    mean = linear.output_mean(output)[:, axis] - offset[axis]
    sigma = linear.sigma(output)[:, axis]
    if sampled is not None:
        low, high = np.percentile(sampled.values[output][:, :, axis] - offset[axis], _BAND_PERCENTILES, axis=1)
        axes.fill_between(sampled.time_s, low, high, color=SHADE, alpha=0.4, lw=0, label=_sample_label(sampled))
    axes.plot(linear.time_s, mean, color=BLUE, lw=1.1, label="linear covariance: mean, two sigma")
    for side in (-_BAND_SIGMAS, _BAND_SIGMAS):
        axes.plot(linear.time_s, mean + side * sigma, color=BLUE, lw=0.9, ls=(0, (4, 2)))
    if output == "relative_error_H":
        # The large errors before the first boxes would set the scale.
        edge = _MARGIN * np.quantile(np.abs(mean) + _BAND_SIGMAS * sigma, _VISIBLE_FRACTION)
        axes.set_ylim(-edge, edge)


def _plot_sigmas(
    axes: Axes, linear: LinearCovariance, output: str, axis: int, sampled: MonteCarloSample | None
) -> None:
    if sampled is not None:
        low, high = (bound[:, axis] for bound in sampled.sigma_interval(output))
        axes.fill_between(sampled.time_s, low, high, color=VERMILLION, alpha=0.35, lw=0)
        axes.plot(
            sampled.time_s, sampled.sigma(output)[:, axis], color=VERMILLION, lw=1.2, label="sampled, 95 % interval"
        )
    axes.plot(linear.time_s, linear.sigma(output)[:, axis], color=BLUE, lw=1.1, label="linear covariance")
    if output == "relative_error_H":
        shown = linear.filter_sigma_H[:, axis]
        axes.plot(linear.time_s, shown, color=GREEN, lw=1.0, ls=(0, (2, 1.5)), label="filter's own, nominal run")
    axes.set_yscale("log")


def _sample_label(sampled: MonteCarloSample) -> str:
    return f"{sampled.runs} sampled runs: 2.3 to 97.7 %"


def _style_axes(axes: Axes, label: str) -> None:
    axes.set_ylabel(label, color=INK, fontsize=9)
    axes.grid(color=GRID, lw=0.6)
    axes.set_axisbelow(True)
    axes.tick_params(which="both", colors=MUTED, labelsize=8)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
