"""Figures of a campaign for consoles and notebooks: envelopes, histograms, scatter plots and paths."""

import io
from collections.abc import Iterable, Mapping, Sequence
from typing import Final, SupportsIndex

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle
from matplotlib.ticker import MaxNLocator

from rpojax.analysis.statistics.intervals import percentiles_over_runs
from rpojax.campaign.storage.campaign_folder import Campaign, of_servicer
from rpojax.errors import RpojaxError
from rpojax.metrics import metric_catalogue
from rpojax.report.campaign_results import dispersed_scalars, nominal_keep_out_radii
from rpojax.report.figures.axis_scale import axis_ends
from rpojax.report.figures.colours import BLUE, GREEN, GRID, INK, MUTED, ORANGE, PURPLE, SKY_BLUE, VERMILLION
from rpojax.report.figures.requirement_limits import Limit, limits_of_channels, limits_of_metrics
from rpojax.report.labels import CHANNEL_LABELS, FURTHER_CHANNEL_LABELS, ChannelLabel, heading, metric_label
from rpojax.scenario.checks.validation_errors import did_you_mean
from rpojax.scenario.numbers import key_units
from rpojax.scenario.plugins import plugin_registry
from rpojax.simulation.metrics.decimated_traces import TRACE_UNITS
from rpojax.value_types import whole_number

_SIZE_INCHES: Final = (8.0, 4.6)
_DOTS_PER_INCH: Final = 110
_MAX_FAILED_LINES, _MAX_PATHS, _MAX_NAMES = 20, 8, 12
_TEAM_COLOURS: Final = (BLUE, ORANGE, GREEN, PURPLE, SKY_BLUE)
_CHANNELS: Final = {label.name: label for label in (*CHANNEL_LABELS, *FURTHER_CHANNEL_LABELS)}


class ShownFigure(Figure):
    """A figure that notebooks show without pyplot."""

    def _repr_png_(self) -> bytes:
        """The picture for a notebook."""
        stream = io.BytesIO()
        self.savefig(stream, format="png", dpi=_DOTS_PER_INCH)
        return stream.getvalue()


def envelope(campaign: Campaign, channel: str, servicer: SupportsIndex | str | None = None) -> Figure:
    """Figure of `CampaignPlots.envelope`."""
    values, title = _trace(campaign, channel, servicer)
    label = _CHANNELS.get(
        channel, ChannelLabel(channel, channel.replace("_", " "), _unit(TRACE_UNITS.get(channel, "-")))
    )
    figure, axes = _new(campaign, f"{label.title}{title}")
    shown, time_s = np.isfinite(values).any(axis=0), campaign.trace_time_s
    time_s, values = time_s[shown], values[:, shown].astype(float)
    if label.logarithmic:
        values = np.where(values > 0.0, values, np.nan)
        axes.set_yscale("log")
    lowest, low, near, middle, far, high, highest = percentiles_over_runs(
        values, (0.0, 5.0, 25.0, 50.0, 75.0, 95.0, 100.0)
    )
    axes.fill_between(time_s, low, high, color=BLUE, alpha=0.18, lw=0.0, label="90 % of runs")
    axes.fill_between(time_s, near, far, color=BLUE, alpha=0.32, lw=0.0, label="50 % of runs")
    axes.plot(time_s, middle, color=BLUE, lw=1.6, label="median")
    for ends, name in ((lowest, "extremes"), (highest, "")):
        axes.plot(time_s, ends, color=MUTED, lw=0.7, ls=":", label=name or None)
    failed = np.flatnonzero(campaign.failed)[:_MAX_FAILED_LINES]
    for number, row in enumerate(failed):
        axes.plot(time_s, values[row], color=VERMILLION, lw=0.7, alpha=0.7, label="failed runs" if not number else None)
    for limit in limits_of_channels(_requirements(campaign)).get(channel, []):
        axes.axhline(limit.value, color=INK, lw=1.0, ls="--", label=limit.channel_text)
    if not label.logarithmic:
        _clip(axes, values, "y", _limit_values(limits_of_channels(_requirements(campaign)).get(channel, [])))
    axes.set_xlabel("time [s]")
    axes.set_ylabel(f"{channel} [{label.unit}]" if label.unit else channel)
    _legend(figure, axes)
    return figure


def histogram(campaign: Campaign, metric: str) -> Figure:
    """Figure of `CampaignPlots.histogram`."""
    with metric_catalogue.metrics_of_scenario(plugin_registry.recorded_metrics(campaign.info)):
        values = _known("metric", metric, campaign.metrics)
        label = metric_label(metric)
    figure, axes = _new(campaign, label.title)
    limits = limits_of_metrics(_requirements(campaign)).get(metric, [])
    defined = values[np.isfinite(values)].astype(float)
    low, high = axis_ends(defined, _limit_values(limits))
    inside = defined[(defined >= low) & (defined <= high)]
    bins = int(np.clip(np.sqrt(len(inside)) * 2, 8, 50))
    if low == high:
        low, high = low - 0.5, high + 0.5
    axes.hist(inside, bins=np.linspace(low, high, bins + 1).tolist(), color=BLUE, alpha=0.75, edgecolor="white")
    if len(defined):
        axes.axvline(float(np.median(defined)), color=INK, lw=1.4, label="median")
    for limit in limits:
        axes.axvline(limit.value, color=VERMILLION, lw=1.4, ls="--", label=limit.text)
    notes = [
        f"{count} {what}"
        for count, what in (
            (len(values) - len(defined), "without a value"),
            (len(defined) - len(inside), "beyond the scale"),
        )
        if count
    ]
    _note(axes, "; ".join(notes))
    axes.set_xlabel(f"{metric} [{label.unit}]" if label.unit else metric)
    axes.set_ylabel("runs")
    axes.yaxis.set_major_locator(MaxNLocator(integer=True))
    _legend(figure, axes)
    return figure


def scatter(campaign: Campaign, x: str, y: str) -> Figure:
    """Figure of `CampaignPlots.scatter`."""
    numbers = {**dispersed_scalars(campaign), **campaign.metrics}
    columns = [_known(argument, name, numbers).astype(float) for argument, name in (("x", x), ("y", y))]
    figure, axes = _new(campaign, f"{y} against {x}")
    failed, defined = campaign.failed, np.isfinite(columns[0]) & np.isfinite(columns[1])
    for chosen, colour, marker, name in ((~failed, BLUE, "o", "not failed"), (failed, VERMILLION, "X", "failed")):
        rows = chosen & defined
        if rows.any():
            axes.scatter(
                columns[0][rows], columns[1][rows], s=22, c=colour, marker=marker, alpha=0.75, lw=0.0, label=name
            )
    limits = limits_of_metrics(_requirements(campaign))
    for name, draw in ((x, axes.axvline), (y, axes.axhline)):
        for limit in limits.get(name, []):
            draw(limit.value, color=INK, lw=1.0, ls="--", label=f"{limit.text} on {name}")
    for name, values, side in ((x, columns[0], "x"), (y, columns[1], "y")):
        _clip(axes, values[defined], side, _limit_values(limits.get(name, [])))
    if lacking := int(np.sum(~defined)):
        _note(axes, f"{lacking} without a value")
    with metric_catalogue.metrics_of_scenario(plugin_registry.recorded_metrics(campaign.info)):
        axes.set_xlabel(_with_unit(campaign, x))
        axes.set_ylabel(_with_unit(campaign, y))
    _legend(figure, axes)
    return figure


def path(campaign: Campaign, run_ids: Iterable[SupportsIndex] | SupportsIndex | None = None) -> Figure:
    """Figure of `CampaignPlots.path`."""
    stored = campaign.history_ids
    chosen = stored[:_MAX_PATHS] if run_ids is None else _run_numbers(run_ids)
    if not chosen:
        raise RpojaxError.of_argument("run_ids", "found no run with a history, expected one: histories= keeps them")
    figure = ShownFigure(figsize=(10.0, 5.0), layout="constrained", facecolor="white")
    panels = figure.subplots(1, 2)
    names = campaign.servicer_names
    failed = dict(zip(campaign.run_ids.tolist(), campaign.failed.tolist(), strict=True))
    for run_id in chosen:
        history = campaign.history(run_id)
        each = [of_servicer(history, number)["rho_H"] for number in range(len(names))] or [history["rho_H"]]
        for number, rho in enumerate(each):
            colour = _TEAM_COLOURS[number % len(_TEAM_COLOURS)] if names else VERMILLION if failed.get(run_id) else BLUE
            name = names[number] if names else "failed run" if failed.get(run_id) else "run"
            for axes, vertical in zip(panels, (0, 2), strict=True):
                axes.plot(rho[:, 1], rho[:, vertical], color=colour, lw=1.0, alpha=0.8, label=name)
                axes.plot(rho[0, 1], rho[0, vertical], "o", color=colour, ms=4, label="start" if not names else None)
    radii = nominal_keep_out_radii(campaign)
    for axes, vertical in zip(panels, ("x, radial [m]", "z, normal [m]"), strict=True):
        for radius in radii:
            axes.add_patch(
                Circle((0.0, 0.0), radius, fill=False, ec=VERMILLION, ls="--", label=f"keep-out, {radius:g} m")
            )
        axes.plot(0.0, 0.0, "s", color=INK, ms=6, label="target")
        axes.set_aspect("equal", adjustable="datalim")
        axes.set_xlabel("y, along the track [m]")
        axes.set_ylabel(vertical)
        _style(axes)
    runs = f"run {chosen[0]}" if len(chosen) == 1 else f"{len(chosen)} runs"
    _title(figure, f"{campaign.configuration.name}: paths in the Hill frame, {runs}")
    _legend(figure, panels[0])
    return figure


def _run_numbers(run_ids: object) -> list[int]:
    """Numbers of runs, from one or several of Python or NumPy, each once."""
    given = [run_ids] if whole_number(run_ids) is not None else run_ids
    numbers = list(map(whole_number, given)) if isinstance(given, Iterable) and not isinstance(given, str) else [None]
    if None in numbers:
        raise RpojaxError.of_argument("run_ids", f"found {run_ids!r}, expected a number of a run or several")
    return list(dict.fromkeys(number for number in numbers if number is not None))


def _trace(campaign: Campaign, channel: str, servicer: SupportsIndex | str | None) -> tuple[np.ndarray, str]:
    """Channel (runs, samples) of the traces, of a servicer of a team where one is named, and what the title adds."""
    values = _known("channel", channel, campaign.traces)
    number = None if servicer is None else campaign.servicer_number(servicer)
    if number is None or not campaign.servicer_names:
        return values, ""
    own = _known("channel", channel, campaign.servicers("traces"))
    return own[:, number], f", {campaign.servicer_names[number]}"


def _known(argument: str, name: object, numbers: Mapping[str, np.ndarray]) -> np.ndarray:
    """Values of a name; one that is unknown is refused with the nearest, or the first names."""
    if isinstance(name, str) and name in numbers:
        return np.asarray(numbers[name])
    if not numbers:
        raise RpojaxError.of_argument(argument, f"found {name!r}, but no run is finished yet")
    raise RpojaxError.of_argument(argument, f"found {name!r}, expected one of {_expected(name, numbers)}")


def _expected(name: object, known: Iterable[str]) -> str:
    """The nearest known name, or the first ones."""
    names = list(known)
    hint = did_you_mean(str(name), names)
    if hint:
        return f"the {len(names)} names there are{hint}"
    return ", ".join(names[:_MAX_NAMES]) + (f" and {len(names) - _MAX_NAMES} more" if len(names) > _MAX_NAMES else "")


def _requirements(campaign: Campaign) -> list[dict[str, object]]:
    return [{**each.model_dump(), "of": each.metric_name} for each in campaign.requirements]


def _limit_values(limits: Iterable[Limit]) -> list[float]:
    return [limit.value for limit in limits]


def _with_unit(campaign: Campaign, name: str) -> str:
    """Title of a metric, or the key of a dispersed number, with its unit."""
    if name in campaign.metrics:
        return heading(metric_label(name))
    unit = _unit(key_units.unit_symbol(name.partition("[")[0].partition("/")[0]))
    return f"{name} [{unit}]" if unit else name


def _unit(symbol: str) -> str:
    return "" if symbol in ("-", "1") else symbol


def _new(campaign: Campaign, title: str) -> tuple[Figure, Axes]:
    """Figure with one pair of axes, and a title that says which campaign and how many runs."""
    runs, failed = len(campaign.run_ids), int(np.sum(campaign.failed))
    if not runs:
        raise RpojaxError(f"{campaign.directory}: found no finished run, expected one to draw")
    figure = ShownFigure(figsize=_SIZE_INCHES, layout="constrained", facecolor="white")
    axes = figure.subplots()
    _style(axes)
    count = f"{runs} run{'s' * (runs != 1)}" + (f", {failed} failed" if failed else "")
    _title(figure, f"{campaign.configuration.name}: {title} ({count})")
    return figure, axes


def _title(figure: Figure, text: str) -> None:
    # A name of a user may have a dollar sign, which does not start a formula.
    figure.suptitle(text, x=0.01, ha="left", fontsize=11, fontweight="bold", color=INK, parse_math=False)


def _style(axes: Axes) -> None:
    axes.grid(color=GRID, lw=0.6)
    axes.set_axisbelow(True)
    axes.tick_params(labelsize=9, colors=MUTED)
    axes.spines[["top", "right"]].set_visible(False)
    axes.spines[["left", "bottom"]].set_color(MUTED)


def _clip(axes: Axes, values: np.ndarray, side: str, limits: Sequence[float]) -> None:
    """Sets the scale of an axis so that a few runs far away do not flatten the others, and says how many are beyond."""
    finite = np.isfinite(values)
    low, high = axis_ends(values[finite], limits)
    margin = 0.05 * (high - low) or 0.5
    (axes.set_ylim if side == "y" else axes.set_xlim)(low - margin, high + margin)
    beyond = finite & ((values < low) | (values > high))
    if count := int(np.sum(beyond if values.ndim == 1 else beyond.any(axis=1))):
        _note(axes, f"{count} run{'s' * (count != 1)} beyond the scale")


def _note(axes: Axes, text: str) -> None:
    """Small text above the right end of the axes, after what stands there."""
    before = axes.get_title(loc="right")
    axes.set_title("; ".join(filter(None, (before, text))), loc="right", fontsize=9, color=MUTED)


def _legend(figure: Figure, axes: Axes) -> None:
    """One legend below the axes, each label once."""
    handles, labels = axes.get_legend_handles_labels()
    entries = dict(zip(labels, handles, strict=True))
    if entries:
        figure.legend(
            list(entries.values()), list(entries), loc="outside lower center", ncols=min(6, len(entries)), fontsize=9,
            frameon=False,
        )  # fmt: skip
