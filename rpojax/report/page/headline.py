"""The headline of a campaign: one sentence on how it ended, one on what matters most, and notes on what qualifies them.

Both are made from the content of report.json.
"""

import re
from collections.abc import Mapping, Sequence
from typing import Any, Final

from rpojax.analysis.statistics.intervals import clopper_pearson_interval
from rpojax.analysis.statistics.tolerance_verdicts import Verdict
from rpojax.report.labels import format_number, format_percent_interval, metric_label, with_unit
from rpojax.report.sections import failure_section
from rpojax.report.sections.requirement_verdict_section import limit_text

_FEW_RUNS: Final = 100
"""Number of runs from which on their share tells the probability to some percents without its interval."""
_NO_VERDICT: Final = (Verdict.NO_RUNS, Verdict.NOT_INDEPENDENT, Verdict.UNFINISHED, Verdict.UNSEALED)


def headline(content: Mapping[str, Any]) -> list[str]:
    """At most two sentences: how the runs ended and how many requirements they verify; cause, or what is worst."""
    if not ended_runs(content):
        return ["No run has ended yet."]
    return [text[:1].upper() + text[1:] for text in (_result(content), _reason(content)) if text]


def headline_notes(content: Mapping[str, Any]) -> list[str]:
    """Sentences on what qualifies the headline: runs that are not judged, folders without a seal, changed limits."""
    runs, notes = content["runs"], []
    if runs["not_judged"] and runs["failed"]:
        notes.append(f"{_not_judged(content)}.")
    provenance = content.get("provenance", {})
    if not provenance.get("sealed", True):
        notes.append("The folder is unsealed, so there are figures and no verdicts.")
    if changes := provenance.get("requirement_changes"):
        notes.append(f"Requirements were changed after the campaign ({len(changes)} times, see limits of use).")
    return notes


def ended_runs(content: Mapping[str, Any]) -> int:
    """Number of runs that have ended."""
    return int(content["runs"]["requested"] - content["runs"]["missing"])


def _result(content: Mapping[str, Any]) -> str:
    """How many runs failed and in which way; without failures how many requirements are verified."""
    runs, ended = content["runs"], ended_runs(content)
    if runs["failed"]:
        begin = (
            f"all {ended} runs failed" if runs["failed"] == ended > 1 else f"{runs['failed']} of {ended} runs failed"
        )
        return f"{begin}{_interval(content)}: {_kinds(runs['outcomes'])}."
    if runs["not_judged"]:
        return f"{_not_judged(content)}, and {_verified(content['requirements'])}."
    beside = _verified(content["requirements"])
    return f"none of {ended} runs failed, {'but' if beside.endswith('violated') else 'and'} {beside}."


def _interval(content: Mapping[str, Any]) -> str:
    """95 % interval of the probability of failure in brackets, where it is from few and independent runs."""
    ended = ended_runs(content)
    if not 1 < ended < _FEW_RUNS or not content["design"]["independent"]:
        return ""
    return f" (95 %: {format_percent_interval(*clopper_pearson_interval(content['runs']['failed'], ended))})"


def _kinds(outcomes: Mapping[str, int]) -> str:
    """Failed runs by reason; without a number where there is one reason alone."""
    text = failure_section.outcomes_text(outcomes)
    if "," in text:
        return text
    return "the goal of the mission was not reached" if outcomes["unfinished"] else text.partition(" ")[2]


def _not_judged(content: Mapping[str, Any]) -> str:
    count, ended = content["runs"]["not_judged"], ended_runs(content)
    which = "no run is" if count == ended else f"{count} of {ended} runs are not"
    return f"{which} judged, as {'all' if count == ended else 'they'} end before limits.arrive_by_s"


def _verified(requirements: Sequence[Mapping[str, Any]]) -> str:
    """How many requirements are verified, and where others are open, how many of each kind."""
    count, verdicts = len(requirements), [Verdict(entry["verdict"]) for entry in requirements]
    if not count:
        return "no requirement is stated"
    kinds = (
        (verdicts.count(Verdict.VERIFIED), "is verified", "are verified"),
        (verdicts.count(Verdict.NOT_VERIFIED), "is violated", "are violated"),
        (sum(bool(entry["more_runs"]) for entry in requirements), "needs more runs", "need more runs"),
        (sum(map(_is_out_of_reach, requirements)), "is open", "are open"),
        (sum(verdict in _NO_VERDICT for verdict in verdicts), "has no verdict", "have no verdict"),
    )
    found = [(number, one if number == 1 else many) for number, one, many in kinds if number]
    if len(found) == 1:
        return f"its requirement {found[0][1]}" if count == 1 else f"its {count} requirements {found[0][1]}"
    if not any(number for number, *_ in kinds[2:]):
        return f"{found[1][0]} of {count} requirements {found[1][1]}"
    words = [f"{number} {word}" for number, word in found]
    return f"of {count} requirements {', '.join(words[:-1])} and {words[-1]}"


def _is_out_of_reach(entry: Mapping[str, Any]) -> bool:
    """Whether a requirement is not decided, and more runs like these would not verify it, or were not planned."""
    return entry["verdict"] == Verdict.UNDECIDED or (entry["verdict"] == Verdict.MORE_RUNS and not entry["more_runs"])


def _reason(content: Mapping[str, Any]) -> str:
    """The main cause of failures; else the requirement or drift that is worst; else the smallest margin."""
    if content["runs"]["failed"]:
        return _cause(content)
    requirements = content["requirements"]
    if violated := [entry for entry in requirements if entry["verdict"] == Verdict.NOT_VERIFIED]:
        worst = max(violated, key=lambda entry: float(entry["violations"]))
        return _violation(worst)
    passive = passive_safety_count(content["safety"])
    if passive is not None and passive[1]["count"]:
        horizon, found = passive
        return (
            f"after a loss of thrust {found['count']} of {found['runs']} runs could drift into the keep-out sphere "
            f"within {horizon}."
        )
    if out_of_reach := [entry for entry in requirements if _is_out_of_reach(entry)]:
        worst = max(out_of_reach, key=lambda entry: float(entry["violations"]))
        if worst["verdict"] == Verdict.UNDECIDED:
            return f"{_violation(worst)[:-1]}: too few to refute it, too many to verify it by all runs of the plan."
        return f"{_violation(worst)[:-1]}: too few to refute it, too many for more runs to verify it."
    if wanted := [entry["more_runs"] for entry in requirements if entry["more_runs"]]:
        which = "all" if len(wanted) == len(requirements) > 1 else str(len(wanted))
        noun = "requirement needs" if len(wanted) == 1 else "requirements need"
        return f"{which} {noun} more runs: no run violates too much, but {ended_runs(content)} are too few to tell."
    return _margin(requirements)


def _violation(entry: Mapping[str, Any]) -> str:
    """How many runs violate a requirement; of a range of free drift, what that means."""
    count = f"{entry['violations']} of {entry['runs']} runs"
    drift = re.fullmatch(r"passive_range(?:_(.+))?_m", str(entry.get("of", entry["metric"])))
    if drift is None:
        return f"{count} violate {limit_text(entry)}."
    horizon = (drift[1] or "1_orbit").replace("_", " ")
    return (
        f"{count} are not passively safe: without thrust they could drift to within {entry['limit']:g} m in {horizon}."
    )


def _cause(content: Mapping[str, Any]) -> str:
    why, failed = content["why_failed"], content["runs"]["failed"]
    causes = why["causes"]
    if causes:
        first = causes[0]
        if failed == 1:
            return f"the cause: {first['title']}."
        if first["runs"] == failed:
            return f"the cause in {'both' if failed == 2 else f'all {failed}'}: {first['title']}."
        return f"the main cause, in {first['runs']} of these: {first['title']}."
    if details := failure_section.detail_counts(content["failures"]):
        often = "most often " if len(details) > 1 else ""
        return f"no cause was found; {often}{details[0][0]}."
    return "no cause was found: repeat one of them to look at it."


def _margin(requirements: Sequence[Mapping[str, Any]]) -> str:
    weakest = weakest_requirement(requirements)
    if weakest is None:
        return ""
    margin = entry_margin(weakest)
    assert margin is not None
    unit = metric_label(weakest.get("of", weakest["metric"])).unit
    size = with_unit(format_number(margin, 3).replace("-", "\N{MINUS SIGN}"), unit)
    where = "" if weakest["margin"] is not None else " in the worst run"
    return f"the smallest margin is {size}{where}, of {limit_text(weakest)}."


def passive_safety_count(safety: Mapping[str, Any]) -> tuple[str, Mapping[str, Any]] | None:
    """Longest horizon of free drift, and the proportion of runs that could enter the keep-out sphere within it."""
    known = [
        (drift["horizon"].replace("_", " "), drift["below_keep_out"])
        for drift in safety["free_drift"]
        if drift["below_keep_out"] is not None and drift["below_keep_out"]["runs"]
    ]
    if known:
        return known[-1]
    single = safety["passive_below_keep_out"]
    return None if single is None or not single["runs"] else ("1 orbit", single)


def weakest_requirement(requirements: Sequence[Mapping[str, Any]]) -> Mapping[str, Any] | None:
    """Requirement with the smallest margin, relative to its limit; None if no requirement has a margin.

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
    """Margin of a requirement at the compared rank, or of the worst run if there are too few runs for a rank."""
    if entry["margin"] is not None or entry["worst"] is None or entry["without_value"]:
        return entry["margin"]
    sign = 1.0 if entry["bound"] == "at most" else -1.0
    return sign * (entry["limit"] - entry["worst"])
