"""Tables of a team on the page, from the content of report.json."""

from collections.abc import Mapping
from typing import Any, Final

from rpojax.metrics import surface_coverage, team
from rpojax.report.labels import metric_label
from rpojax.report.mission import phase_section
from rpojax.report.number_format import format_number
from rpojax.report.sections.failure_section import outcomes_text

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
        outcomes, fault = servicer["outcomes"], servicer["fault"]
        kind = _DASH if fault is None or fault.get("kind", "none") == "none" else _fault_text(fault)
        rows.append([servicer["name"], str(outcomes["completed"]), outcomes_text(outcomes) or _DASH, kind])
    of_team = content["runs"]["outcomes"]
    return [*rows, ["team", str(of_team["completed"]), outcomes_text(of_team) or _DASH, _DASH]]


def _fault_text(fault: Mapping[str, Any]) -> str:
    kind = str(fault["kind"]).replace("_", " ")
    return f"{kind} from {format_number(fault['start_s'])} s, for {format_number(fault['duration_s'])} s"


def _seen_rows(content: Mapping[str, Any], names: list[str]) -> list[list[str]]:
    boxes = content["team"]["boxes"]
    rows = []
    if boxes is not None:
        heading = f"Share of time with an accepted box, {boxes['runs']} runs with history"
        rows.append([heading, *(format_number(share, 3) for share in boxes["of_each"])])
        rows[0].append(f"anybody {format_number(boxes['of_anybody'])}, all {format_number(boxes['of_everybody'], 3)}")
    for own, of_all in _SEEN:
        if f"{own}/{names[0]}" in content["metrics"]:
            cells = [_quantiles(content, f"{own}/{name}") for name in names]
            rows.append([_heading(own), *cells, _DASH if of_all is None else _quantiles(content, of_all)])
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
        rows.append((_heading(team.DELIVERY), _quantiles(content, team.DELIVERY)))
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
            heading,
            *(_scaled(metrics[each][statistic], factor) for each in (*(f"{metric}/{name}" for name in names), metric)),
        ]
        for metric, statistic, heading, factor in _CONSISTENCY
        if f"{metric}/{names[0]}" in metrics
    ]


def _separation_rows(content: Mapping[str, Any]) -> list[list[str]]:
    """Distance, least over the runs, 1st and 50th percentile."""
    return [
        [_heading(name), *(format_number(entry[key], 3) for key in ("min", "p1", "p50"))]
        for name in _SEPARATIONS
        if (entry := content["metrics"].get(name)) is not None
    ]


def _metric_rows(content: Mapping[str, Any], names: list[str]) -> list[list[str]]:
    """Every metric that each servicer has of its own: medians, 5th and 95th percentiles."""
    metrics = content["metrics"]
    own = [name for name in metrics if f"{name}/{names[0]}" in metrics]
    return [
        [_heading(name), *(_quantiles(content, each) for each in (*(f"{name}/{one}" for one in names), name))]
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


def _heading(name: str) -> str:
    label = metric_label(name)
    return f"{label.title} [{label.unit}]" if label.unit else label.title


def _quantiles(content: Mapping[str, Any], name: str) -> str:
    entry = content["metrics"].get(name)
    return _DASH if entry is None else phase_section.quantile_text({key: entry[key] for key in ("p5", "p50", "p95")})


def _scaled(value: float | None, factor: float) -> str:
    return _DASH if value is None else format_number(factor * value, 3)
