"""One line for each folded section of a campaign's page: what one would find inside."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final

from rpojax.analysis.statistics.tolerance_verdicts import VIOLATED, Verdict
from rpojax.report.labels import format_number, metric_label, with_unit
from rpojax.report.page.headline import ended_runs, passive_safety_count
from rpojax.report.sections import error_budget_section, port_section
from rpojax.report.sections.failure_section import outcomes_text
from rpojax.report.sections.safety_section import without_drift_text, worst_value_texts

_NEES_COMPONENTS: Final = 6


def section_findings(content: Mapping[str, Any], shown: Mapping[str, Any]) -> dict[str, str]:
    """Line of each section by its anchor, from the content of report.json and the values that the page shows."""
    work: dict[str, Callable[[Mapping[str, Any], Mapping[str, Any]], str]] = {
        "requirements": _requirements,
        "safety": _safety,
        "headline": _headline,
        "run": _run,
        "team": lambda found, _: _counted(len((found["team"] or {}).get("servicers", [])), "servicer"),
        "mission": _mission,
        "port": lambda found, _: port_section.finding(found["port"]),
        "envelopes": lambda _, page: "Bands of all runs: " + ", ".join(_short(one.title) for one in page["envelopes"]),
        "distributions": _distributions,
        "metrics": lambda _, page: f"{_counted(len(page['metric_rows']), 'metric')}: statistics, intervals, meaning",
        "coverage": _coverage,
        "consistency": _consistency,
        "budgets": lambda found, _: error_budget_section.finding(found["error_budgets"]),
        "convergence": _convergence,
        "dispersions": _dispersions,
        "sensitivity": _sensitivity,
        "failures": _failures,
        "worst": lambda _, page: f"{_counted(len(page['worst']), 'run')} among the five worst in a key metric",
        "camera": _camera,
        "limits": lambda _, page: f"{_counted(len(page['limits']), 'sentence')} on what these results do not say",
        "scenario": lambda _, page: f"{_counted(len(page['scenario']), 'value')}, defaults included",
        "identity": _identity,
        "probability": lambda _, __: "Probabilities that plain runs are too few for",
    }
    return {name: line(content, shown) for name, line in work.items()}


def _counted(count: int, noun: str) -> str:
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"


def _short(title: str) -> str:
    """Title of a channel without what it is drawn with."""
    text = title.partition(" and its")[0].partition(" of ")[0]
    return text if text[:2].isupper() else text[:1].lower() + text[1:]


def _requirements(content: Mapping[str, Any], _: Mapping[str, Any]) -> str:
    entries: Sequence[Mapping[str, Any]] = content["requirements"]
    if not entries:
        return "None are stated"
    counts: dict[str, int] = {}
    for entry in entries:
        words = VIOLATED if entry["verdict"] == Verdict.NOT_VERIFIED else str(entry["verdict"])
        counts[words] = counts.get(words, 0) + 1
    return ", ".join(f"{count} {verdict}" for verdict, count in counts.items())


def _safety(content: Mapping[str, Any], _: Mapping[str, Any]) -> str:
    safety = content["safety"]
    value, run = worst_value_texts(safety["least_range"], "m")
    parts = [f"Smallest range {value} ({run})" if value else "No run has a range"]
    if safety["entries"]["count"]:
        parts.append(f"{_counted(safety['entries']['count'], 'run')} entered the keep-out sphere")
    found = passive_safety_count(safety)
    if found is not None:
        horizon, proportion = found
        words = f"{proportion['count']} of {proportion['runs']} could drift into the sphere within {horizon}"
        parts.append(words + without_drift_text(proportion).replace(";", ",", 1))
    return "; ".join(parts)


def _headline(content: Mapping[str, Any], _: Mapping[str, Any]) -> str:
    names = ("formation_error_rms_m", "nav_relative_position_error_rms_m", "delta_v_m_s")
    return "Medians: " + ", ".join(_median(content, name) for name in names if name in content["metrics"])


def _median(content: Mapping[str, Any], name: str) -> str:
    label, entry = metric_label(name), content["metrics"][name]
    return f"{_short(label.title)} {with_unit(format_number(entry['p50'], 3), label.unit)}"


def _run(_: Mapping[str, Any], shown: Mapping[str, Any]) -> str:
    if shown["shown_run"] is None:
        return "No full history was kept"
    worst = ", ".join(f"{run}" for run, _ in shown["worst_choices"]) or "none"
    return f"Median run {shown['shown_run']}; worst runs of the requirements: {worst}"


def _mission(content: Mapping[str, Any], _: Mapping[str, Any]) -> str:
    mission = content["mission"]
    if mission is None:
        return ""
    reached = (f"{phase['name']} {phase['runs']}" for phase in mission["phases"] if phase["runs"])
    return f"Runs that came to each of {ended_runs(content)}: {', '.join(reached)}"


def _distributions(_: Mapping[str, Any], shown: Mapping[str, Any]) -> str:
    groups = shown["histogram_groups"]
    count = sum(len(group.entries) for group in groups)
    return f"{_counted(count, 'histogram')} in {_counted(len(groups), 'group')}" if count else "Nothing varies"


def _coverage(content: Mapping[str, Any], _: Mapping[str, Any]) -> str:
    found = content["metrics"].get("surface_seen_fraction")
    if not content["coverage"] or found is None or found["p50"] is None:
        return ""
    unseen = content["coverage"]["lit_but_seen_in_no_run"]
    return f"{100.0 * found['p50']:.3g} % of the lit surface seen in the median run; {100.0 * unseen:.3g} % in no run"


def _consistency(content: Mapping[str, Any], _: Mapping[str, Any]) -> str:
    metrics, parts = content["metrics"], []
    nees = (metrics.get("nees_relative_mean") or {}).get("mean")
    if nees is not None:
        parts.append(f"NEES / 6 {format_number(nees / _NEES_COMPONENTS, 3)} (1 is consistent)")
    coverage = (metrics.get("sigma3_coverage") or {}).get("mean")
    if coverage is not None:
        parts.append(f"{100.0 * coverage:.4g} % of errors inside 3 sigma (normal: 99.73 %)")
    return ", ".join(parts) or "No run has a consistency metric"


def _convergence(content: Mapping[str, Any], _: Mapping[str, Any]) -> str:
    found = content["convergence"]
    if found is None:
        return "Needs at least twenty runs"
    rate = found["failure_rate"]
    low, high = (rate[key][-1] if rate[key] else None for key in ("low_95", "high_95"))
    interval = ""
    if low is not None and high is not None:
        interval = f" (95 % interval {100.0 * low:.2g} to {100.0 * high:.2g} %)"
    return f"Failure rate {100.0 * rate['rate'][-1]:.3g} %{interval}"


def _dispersions(_: Mapping[str, Any], shown: Mapping[str, Any]) -> str:
    drawn = shown["dispersions"]
    if not drawn:
        return "Nothing was dispersed"
    wrong = sum(one.contradicts_declaration for one in drawn)
    return f"{_counted(len(drawn), 'number')} drawn; " + (
        f"{wrong} contradict what is declared" if wrong else "none contradicts what is declared"
    )


def _sensitivity(content: Mapping[str, Any], _: Mapping[str, Any]) -> str:
    if leading := content["drivers"]["drivers"]:
        inputs = " with ".join(leading[0]["inputs"])
        return f"{_counted(len(leading), 'driver')}; {leading[0]['event']}: {inputs}"
    found = [entry for entry in content["sensitivity"] if entry["by_spearman"]]
    if not found:
        return "No input stands out" if content["sensitivity"] else "Needs at least ten runs and a dispersed input"
    told = "; ".join(f"{_short(entry['title'])}: {entry['by_spearman'][0]}" for entry in found[:2])
    is_tested = all(one["spearman_p"] is not None for entry in found[:2] for one in entry["inputs"])
    return told if is_tested else f"Greatest, not tested against chance: {told}"


def _failures(content: Mapping[str, Any], _: Mapping[str, Any]) -> str:
    runs = content["runs"]
    if not runs["failed"]:
        return "None failed" if ended_runs(content) else "No run has ended yet"
    return f"{runs['failed']} of {ended_runs(content)}: {outcomes_text(runs['outcomes'])}"


def _camera(content: Mapping[str, Any], shown: Mapping[str, Any]) -> str:
    images = "images and boxes" if shown["camera_sheet"] else "boxes"
    entries = content["detections"]
    if not entries:
        return f"No statistics of {images}"
    first = entries[0]
    accepted = first.get("accepted")
    return f"{images.capitalize()} of {_counted(len(shown['kept_runs']), 'run')}" + (
        "" if accepted is None else f"; {100.0 * accepted:.3g} % of the boxes were accepted"
    )


def _identity(content: Mapping[str, Any], _: Mapping[str, Any]) -> str:
    found = content["provenance"]
    digest = str(found.get("scenario_hash", ""))[:12]
    version = found.get("versions", {}).get("rpojax")
    parts = [f"scenario {digest}" if digest else "", f"rpojax {version}" if version else ""]
    return ", ".join(part for part in parts if part) or "Nothing is recorded"
