"""A team of servicers: outcomes and phases of each, who saw the target, relative orbits, and the tables on the page."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle

from rpojax.campaign.storage.atomic_outputs import write_atomically
from rpojax.metrics import surface_coverage, team
from rpojax.report.campaign_results import CampaignResults, ChangedResults, nominal_keep_out_radii
from rpojax.report.figures.colours import (
    BLUE,
    GREEN,
    GRID,
    INK,
    MUTED,
    ORANGE,
    PURPLE,
    SKY_BLUE,
    VERMILLION,
    YELLOW,
)
from rpojax.report.figures.paper_figures import new_figure
from rpojax.report.figures.png_export import AXIS_NAMES, png_bytes
from rpojax.report.labels import format_number, heading, metric_label
from rpojax.report.sections import phase_section, phase_visits
from rpojax.report.sections.failure_section import outcomes_text
from rpojax.scenario import former_fault
from rpojax.simulation.outcomes import outcome_kinds
from rpojax.simulation.outcomes.outcome_kinds import REASONS, Outcome, count_outcomes

REQUIRED_CHANNELS: Final = ("rho_H",)
_COLOURS: Final = (BLUE, ORANGE, GREEN, PURPLE, VERMILLION, SKY_BLUE, YELLOW, INK)
_WIDTH_INCHES: Final = 10.8
_ALONG, _ACROSS, _RADIAL = 1, 2, 0
FIGURE_NAME: Final = "relative_orbits.png"
_FOR_GOOD_S: Final = 1e9
"""Duration from which on a fault does not end [s]."""
_DASH: Final = format_number(None)
_RELATIVE_COMPONENTS: Final = 6
_CONSISTENCY: Final = (
    ("nees_relative_mean", "mean", "Relative NEES / 6, mean", 1.0 / _RELATIVE_COMPONENTS),
    ("sigma3_coverage", "mean", "3-sigma coverage, mean", 1.0),
    ("nav_range_error_rms_m", "p50", "Range error, RMS, median [m]", 1.0),
    ("nav_relative_position_error_rms_m", "p50", "Relative position error, RMS, median [m]", 1.0),
)
"""Metric, statistic over runs, heading and factor."""
_SEEN: Final = (
    ("visible_fraction", None),
    ("longest_unseen_s", team.UNSEEN),
    (surface_coverage.SEEN_FRACTION, surface_coverage.SEEN_FRACTION),
    (surface_coverage.TIME_TO_90_PERCENT, surface_coverage.TIME_TO_90_PERCENT),
)
"""Metric of each servicer, and of all together."""
_NEVER_S: Final = 1e9
"""Interval between bursts from which on there are none: the default of the scenario."""
_SEPARATIONS: Final = (team.SEPARATION, team.PASSIVE_SEPARATION)


def of_servicer(campaign: CampaignResults, number: int) -> CampaignResults:
    """Results of the servicer `number` of a team, without what only teams have: events, surface maps, histories."""
    name = campaign.servicer_names[number]
    status = campaign.servicers("status")
    codes = status["failure"][:, number]
    outcomes = outcome_kinds.of_codes(codes)
    common = {key: values for key, values in campaign.drawn.items() if "/" not in key}
    own = {key.removesuffix(f"/{name}"): values for key, values in campaign.drawn.items() if key.endswith(f"/{name}")}
    # A team's run is frozen as a whole, by whichever servicer: `reached_end` is that of the team.
    failed_at_s = np.where(campaign.reached_end, status["failed_at_s"][:, number], campaign.failed_at_s)
    found: Any = ChangedResults(
        campaign,
        info=_with_own_tables(campaign.info, name),
        completed=codes == Outcome.COMPLETED.code,
        failed=outcome_kinds.is_failed(outcomes),
        outcomes=outcomes,
        failed_at_s=failed_at_s,
        failure_reason=np.array(REASONS)[codes],
        drawn=common | own,
        **{group: _of_one(campaign, group, number) for group in ("metrics", "traces", "phases", "signs")},
        **dict.fromkeys(("events", "history_ids", "servicer_names"), ()),
        coverage={},
        surface={},
        servicers=lambda group: {},
    )
    return found


def unfinished_details(campaign: CampaignResults) -> dict[int, str]:
    """Where each unfinished run stayed and why, by its number; of a team for each servicer that did not finish."""
    if not campaign.servicer_names:
        return phase_visits.unfinished_details(campaign)
    found: dict[int, list[str]] = {}
    for number, name in enumerate(campaign.servicer_names):
        for run_id, text in phase_visits.unfinished_details(of_servicer(campaign, number)).items():
            found.setdefault(run_id, []).append(f"{name} {text}")
    # A run has the outcome of its worst servicer.
    of_team = campaign.run_ids[np.asarray(campaign.outcomes) == Outcome.UNFINISHED].tolist()
    return {run_id: "; ".join(texts) for run_id, texts in found.items() if run_id in of_team}


def _with_own_tables(info: Mapping[str, Any], name: str) -> Mapping[str, Any]:
    """Information on the campaign with the goal and the limits of one servicer."""
    scenario = info.get("scenario", {})
    changes = next((servicer for servicer in scenario.get("servicers", []) if servicer.get("name") == name), {})
    own = {key: {**(scenario.get(key) or {}), **(changes.get(key) or {})} for key in ("goal", "limits")}
    return {**info, "scenario": {**scenario, **own}}


def _of_one(campaign: CampaignResults, group: str, number: int) -> dict[str, np.ndarray]:
    return {name: values[:, number] for name, values in campaign.servicers(group).items()}


def relative_orbits(
    history: Mapping[str, np.ndarray], names: Sequence[str], keep_out_m: Sequence[float], title: str
) -> Figure:
    """Along-track over radial and cross-track over radial position of all servicers, target in the middle.

    Args:
        history: of a team's run, `rho_H` (ticks, servicers, 3) the servicer from the target [m]
        names: of the servicers
        keep_out_m: radii of the keep-out spheres [m]
        title: of the figure
    """
    reach = _reach(history["rho_H"], keep_out_m)
    widths = [float(reach[across]) for across in (_ALONG, _ACROSS)]
    height = float(np.clip(1.5 + 0.9 * _WIDTH_INCHES * reach[_RADIAL] / sum(widths), 3.0, 9.0))
    figure = new_figure(title, (_WIDTH_INCHES, height))
    planes = figure.subplots(1, 2, width_ratios=widths)
    for axes, across in zip(planes, (_ALONG, _ACROSS), strict=True):
        for number, name in enumerate(names):
            _plot_orbit(axes, history["rho_H"][:, number], across, name, _COLOURS[number % len(_COLOURS)])
        axes.plot(0.0, 0.0, marker="+", ms=9, mew=1.4, ls="", color=INK, label="target")
        for number, radius in enumerate(keep_out_m):
            label = "" if number else "keep-out"
            axes.add_patch(Circle((0.0, 0.0), radius, fill=False, ls="--", lw=1.0, ec=MUTED, label=label))
        _style(axes, across, reach)
    planes[0].set_ylabel(f"{AXIS_NAMES[_RADIAL]} [m]", fontsize=9, color=INK)
    handles, labels = planes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=len(labels), fontsize=9, frameon=False)
    return figure


def _plot_orbit(axes: Axes, rho_H: np.ndarray, across: int, name: str, colour: str) -> None:
    """Path of a servicer, with a dot where it begins and a square where it ends."""
    path = rho_H[np.isfinite(rho_H).all(axis=1)]
    axes.plot(path[:, across], path[:, _RADIAL], color=colour, lw=1.1, label=name)
    for marker, point in (("o", path[:1]), ("s", path[-1:])):
        axes.plot(point[:, across], point[:, _RADIAL], marker=marker, ms=6, ls="", color=colour, mec="white", mew=0.8)


def _reach(rho_H: np.ndarray, keep_out_m: Sequence[float]) -> np.ndarray:
    """Half the extent of the figure along each Hill axis (3,) [m], with a margin around all that is drawn."""
    greatest = np.max(np.abs(rho_H), axis=(0, 1), where=np.isfinite(rho_H), initial=1.0)
    return 1.08 * np.maximum(greatest, max(keep_out_m, default=0.0))


def _style(axes: Axes, across: int, reach: np.ndarray) -> None:
    axes.set_aspect("equal", adjustable="box")
    axes.set_xlim(-reach[across], reach[across])
    axes.set_ylim(-reach[_RADIAL], reach[_RADIAL])
    axes.set_xlabel(f"{AXIS_NAMES[across]} [m]", fontsize=9, color=INK)
    axes.tick_params(labelsize=8, colors=MUTED)
    axes.grid(color=GRID, lw=0.6)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)
    axes.spines[["left", "bottom"]].set_color(MUTED)


def content(campaign: CampaignResults) -> dict[str, Any] | None:
    """Part of report.json; None for one servicer alone.

    Metrics of each servicer are in the part `metrics`, as `NAME/SERVICER`. Shares of ticks with an accepted box are
    means over the runs with a stored history, None if there are no such runs.
    """
    if not campaign.servicer_names:
        return None
    scenario = campaign.info.get("scenario", {})
    return {
        "servicers": [_servicer_content(campaign, number) for number in range(len(campaign.servicer_names))],
        "sharing": scenario.get("navigation", {}).get("sharing"),
        "link": scenario.get("link"),
        "gps_differences": scenario.get("gps_differences"),
        "boxes": _box_shares(campaign),
    }


def write_figure(campaign: CampaignResults, run_id: int | None) -> Path | None:
    """Writes the picture of the relative orbits of a run; None for one servicer alone and without their positions."""
    if not campaign.servicer_names or run_id is None:
        return None
    history = campaign.history(run_id)
    if any(name not in history for name in REQUIRED_CHANNELS):
        return None
    title = f"Relative orbits: {campaign.info.get('name', 'campaign')}, run {run_id}"
    figure = relative_orbits(history, campaign.servicer_names, nominal_keep_out_radii(campaign), title)
    return write_atomically(campaign.directory / "figures" / FIGURE_NAME, png_bytes(figure))


def _servicer_content(campaign: CampaignResults, number: int) -> dict[str, Any]:
    name, scenario = campaign.servicer_names[number], campaign.info.get("scenario", {})
    own = of_servicer(campaign, number)
    changes = next((servicer for servicer in scenario.get("servicers", []) if servicer.get("name") == name), {})
    own_faults = changes.get("faults") or {former_fault.NAME: changes.get("fault") or {}}
    faults = [{**each, **own_faults.get(each["name"], {})} for each in former_fault.declared(scenario)]
    return {
        "name": name,
        "outcomes": count_outcomes(own.outcomes),
        "faults": faults if scenario.get("effects", {}).get("faults") else [],
        "mission": phase_section.content(own),
    }


def _box_shares(campaign: CampaignResults) -> dict[str, Any] | None:
    """Shares of the ticks of a run in which each servicer, anybody and everybody accepted a box."""
    accepted = [_accepted_boxes(campaign.history(run)) for run in sorted(campaign.history_ids)]
    accepted = [flags for flags in accepted if flags is not None and len(flags)]
    if not accepted:
        return None
    return {
        "runs": len(accepted),
        "of_each": np.mean([each.mean(axis=0) for each in accepted], axis=0).tolist(),
        "of_anybody": float(np.mean([each.any(axis=1).mean() for each in accepted])),
        "of_everybody": float(np.mean([each.all(axis=1).mean() for each in accepted])),
    }


def _accepted_boxes(history: Mapping[str, np.ndarray]) -> np.ndarray | None:
    """Flags (ticks, servicers) of accepted boxes of the target, until a run is frozen; None if they were not kept."""
    if not {"box_accepted", "box_outlier", "range_m"} <= set(history):
        return None
    alive = np.isfinite(history["range_m"]).all(axis=1)
    return np.asarray(history["box_accepted"] & ~history["box_outlier"], dtype=bool)[alive]


def tables(content: Mapping[str, Any]) -> dict[str, Any] | None:
    """Names and tables of a team, None for one servicer alone; rows are a heading, a cell for each servicer, and one
    for all together.
    """
    found = content["team"]
    if found is None:
        return None
    names = [servicer["name"] for servicer in found["servicers"]]
    return {
        "names": names,
        "outcomes": _outcome_rows(content),
        "seen": _seen_rows(content, names),
        "links": _link_rows(content),
        "consistency": _consistency_rows(content, names),
        "separations": _separation_rows(content),
        "metrics": _metric_rows(content, names),
        "phases": _phase_rows(content),
    }


def _outcome_rows(content: Mapping[str, Any]) -> list[list[str]]:
    """Servicer, completed runs, failed runs by outcome, and equipment fault; the team last."""
    rows = []
    for servicer in content["team"]["servicers"]:
        outcomes = servicer["outcomes"]
        kind = "; ".join(_fault_text(each) for each in servicer["faults"] if each["kind"] != "none") or _DASH
        rows.append([servicer["name"], str(outcomes["completed"]), outcomes_text(outcomes) or _DASH, kind])
    of_team = content["runs"]["outcomes"]
    return [*rows, ["team", str(of_team["completed"]), outcomes_text(of_team) or _DASH, _DASH]]


def _fault_text(fault: Mapping[str, Any]) -> str:
    kind = str(fault["kind"]).replace("_", " ")
    lasting = f", for {format_number(fault['duration_s'])} s" if fault["duration_s"] < _FOR_GOOD_S else ""
    return f"{kind} from {format_number(fault['start_s'])} s{lasting}"


def _seen_rows(content: Mapping[str, Any], names: list[str]) -> list[list[str]]:
    boxes = content["team"]["boxes"]
    rows = []
    if boxes is not None:
        title = f"Share of time with an accepted box, {boxes['runs']} runs with history"
        rows.append([title, *(format_number(share, 3) for share in boxes["of_each"])])
        rows[0].append(f"anybody {format_number(boxes['of_anybody'])}, all {format_number(boxes['of_everybody'], 3)}")
    for own, of_all in _SEEN:
        if f"{own}/{names[0]}" in content["metrics"]:
            cells = [_quantiles(content, f"{own}/{name}") for name in names]
            rows.append([heading(metric_label(own)), *cells, _DASH if of_all is None else _quantiles(content, of_all)])
    return rows


def _link_rows(content: Mapping[str, Any]) -> list[tuple[str, str]]:
    """What is sent and how, and how much of it was used."""
    found, link, differences = content["team"], content["team"]["link"] or {}, content["team"]["gps_differences"]
    rows = [("Sharing", str(found["sharing"]))]
    if link:
        rows += [
            ("Period", f"{format_number(link['period_s'])} s"),
            ("Delay", f"{format_number(link['delay_s'])} s"),
            ("Loss outside of bursts", f"{100.0 * link['loss']:.3g} %"),
            ("Bursts", _burst_text(link)),
            ("Outages", ", ".join(f"{start:g} to {end:g} s" for start, end in link["outages_s"]) or "none"),
            ("Who hears whom", _hears_text(link.get("hears"))),
        ]
    if differences:
        noise, slow = differences["noise_m"], differences["slow_error_m"]
        rows.append(("GPS differences", f"{differences['kind']}, noise {noise:g} m, slow part {slow:g} m"))
    if team.DELIVERY in content["metrics"]:
        rows.append((heading(metric_label(team.DELIVERY)), _quantiles(content, team.DELIVERY)))
    return rows


def _burst_text(link: Mapping[str, Any]) -> str:
    if link["burst_interval_s"] >= _NEVER_S:
        return "none"
    share = f"{100.0 * link['burst_loss']:.3g} % lost"
    return f"one every {link['burst_interval_s']:g} s on average, {link['burst_duration_s']:g} s long, {share} in it"


def _hears_text(pairs: list[list[str]] | None) -> str:
    return "everybody" if pairs is None else ", ".join(f"{receiver} hears {sender}" for receiver, sender in pairs)


def _consistency_rows(content: Mapping[str, Any], names: list[str]) -> list[list[str]]:
    metrics = content["metrics"]
    return [
        [
            title,
            *(_scaled(metrics[each][statistic], factor) for each in (*(f"{metric}/{name}" for name in names), metric)),
        ]
        for metric, statistic, title, factor in _CONSISTENCY
        if f"{metric}/{names[0]}" in metrics
    ]


def _separation_rows(content: Mapping[str, Any]) -> list[list[str]]:
    """Distance, least over the runs, 1st and 50th percentile."""
    return [
        [heading(metric_label(name)), *(format_number(entry[key], 3) for key in ("min", "p1", "p50"))]
        for name in _SEPARATIONS
        if (entry := content["metrics"].get(name)) is not None
    ]


def _metric_rows(content: Mapping[str, Any], names: list[str]) -> list[list[str]]:
    """Every metric that each servicer has of its own: medians, 5th and 95th percentiles."""
    metrics = content["metrics"]
    own = [name for name in metrics if f"{name}/{names[0]}" in metrics]
    return [
        [
            heading(metric_label(name)),
            *(_quantiles(content, each) for each in (*(f"{name}/{one}" for one in names), name)),
        ]
        for name in own
    ]


def _phase_rows(content: Mapping[str, Any]) -> list[list[str]]:
    """Servicer, then the cells of its phases."""
    return [
        [servicer["name"], *cells]
        for servicer in content["team"]["servicers"]
        if servicer["mission"] is not None
        for cells in phase_section.time_rows(servicer["mission"])
    ]


def _quantiles(content: Mapping[str, Any], name: str) -> str:
    entry = content["metrics"].get(name)
    return _DASH if entry is None else phase_section.quantile_text({key: entry[key] for key in ("p5", "p50", "p95")})


def _scaled(value: float | None, factor: float) -> str:
    return _DASH if value is None else format_number(factor * value, 3)
