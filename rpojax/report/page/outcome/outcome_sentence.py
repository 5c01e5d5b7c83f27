"""Outcome of a campaign in one sentence."""

from collections.abc import Mapping, Sequence
from typing import Any

from rpojax.analysis.statistics.tolerance_verdicts import Verdict
from rpojax.report.labels import metric_label
from rpojax.report.number_format import format_number, with_unit
from rpojax.report.page.outcome.verdict_tiles import passive_safety_count
from rpojax.report.sections import failure_section

_WITHOUT_VERDICT = (Verdict.NO_RUNS, Verdict.NOT_INDEPENDENT, Verdict.UNFINISHED, Verdict.UNSEALED)


def outcome_sentence(content: Mapping[str, Any]) -> str:
    """Runs that missed the goal, requirements verified of how many, weakest margin, passive safety, failed runs."""
    runs = content["runs"]
    ended = runs["requested"] - runs["missing"]
    parts = [_requirements(content["requirements"], ended)]
    if unfinished := runs["outcomes"].get("unfinished"):
        details = failure_section.detail_counts(content["failures"])
        why = f", most often {details[0][0]}" if len(details) > 1 else f": {details[0][0]}" if details else ""
        parts.insert(0, f"the goal of the mission was not reached in {unfinished} of {ended} runs{why}")
    if weakest := weakest_requirement(content["requirements"]):
        parts.append(_margin(weakest))
    if (passive := passive_safety_count(content["safety"])) is not None:
        count, total = passive[1]["count"], passive[1]["runs"]
        parts.append(f"passive safety fails: {count} of {total}" if count else f"passive safety holds in all {total}")
    if runs["failed"]:
        parts.append(f"{runs['failed']} of {ended} runs failed")
    elif not runs["not_judged"]:
        parts.append("no run failed")
    if runs["not_judged"]:
        some = f"{runs['not_judged']} of {ended} runs are not judged, as they end"
        which = "no run is judged, as all end" if runs["not_judged"] == ended else some
        parts.append(f"{which} before limits.arrive_by_s")
    provenance = content.get("provenance", {})
    if not provenance.get("sealed", True):
        parts.append("the folder is unsealed, so there are figures and no verdicts")
    if changes := provenance.get("requirement_changes"):
        parts.append(f"requirements were changed after the campaign ({len(changes)} times, see limits of use)")
    text = "; ".join(parts)
    return text[:1].upper() + text[1:] + "."


def weakest_requirement(requirements: Sequence[Mapping[str, Any]]) -> Mapping[str, Any] | None:
    """Requirement with the smallest margin, relative to its limit; None without any that has one.

    The margin is that of the compared rank, or of the worst run where there are too few runs for a rank. None, too,
    where a run without a value stands there: nothing is weaker than that.
    """
    if any(entry["without_value"] and entry_margin(entry) is None for entry in requirements):
        return None
    found = [entry for entry in requirements if entry_margin(entry) is not None]
    if not found:
        return None
    return min(found, key=lambda entry: float(entry_margin(entry) or 0.0) / (abs(entry["limit"]) or 1.0))


def entry_margin(entry: Mapping[str, Any]) -> float | None:
    """Margin of a requirement: that of the compared rank, or of the worst run where there are too few runs for one."""
    if entry["margin"] is not None or entry["worst"] is None or entry["without_value"]:
        return entry["margin"]
    sign = 1.0 if entry["bound"] == "at most" else -1.0
    return sign * (entry["limit"] - entry["worst"])


def _requirements(requirements: Sequence[Mapping[str, Any]], runs: int) -> str:
    simulated = f"{runs} {'run' if runs == 1 else 'runs'}"
    if not requirements:
        return f"no requirement is stated; {simulated}"
    verdicts = [Verdict(entry["verdict"]) for entry in requirements]
    count = len(requirements)
    noun = "requirement" if count == 1 else "requirements"
    text = f"{verdicts.count(Verdict.VERIFIED)} of {count} {noun} verified in {simulated}, {_levels(requirements)}"
    more = verdicts.count(Verdict.MORE_RUNS)
    rest = (
        (verdicts.count(Verdict.NOT_VERIFIED), "not verified"),
        (more, "needs more runs" if more == 1 else "need more runs"),
        (sum(verdicts.count(each) for each in _WITHOUT_VERDICT), "without a verdict"),
    )
    named = ", ".join(f"{number} {word}" for number, word in rest if number)
    return f"{text} ({named})" if named else text


def _levels(requirements: Sequence[Mapping[str, Any]]) -> str:
    return (
        f"each for {_range([100.0 * entry['probability'] for entry in requirements])} of the runs at "
        f"{_range([100.0 * entry['consumer_risk'] for entry in requirements])} risk"
    )


def _range(percents: Sequence[float]) -> str:
    low, high = min(percents), max(percents)
    return f"{low:g} %" if low == high else f"{low:g} to {high:g} %"


def _margin(entry: Mapping[str, Any]) -> str:
    margin = entry_margin(entry)
    assert margin is not None
    label = metric_label(entry.get("of", entry["metric"]))
    size = with_unit(format_number(margin, 3).replace("-", "\N{MINUS SIGN}"), label.unit)
    name = label.title[:1].lower() + label.title[1:] if not label.title[:2].isupper() else label.title
    where = "" if entry["margin"] is not None else " in the worst run"
    return f"weakest margin {size} ({name}{where})"
