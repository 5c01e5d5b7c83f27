"""Requirements of the scenario with their tolerance verdicts."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pydantic

from rpojax.analysis.statistics.tolerance_verdicts import (
    VIOLATED,
    RequirementEvaluation,
    Verdict,
    evaluate_requirement,
)
from rpojax.errors import ResultError
from rpojax.report.campaign_results import CampaignResults, runs_are_independent
from rpojax.report.labels import format_number, metric_label, with_unit
from rpojax.report.sections import sequential_section
from rpojax.scenario.schema import RequirementSection
from rpojax.simulation.outcomes.outcome_kinds import Outcome
from rpojax.simulation.outcomes.requirement_violations import counts, is_of_outcome, reaches, required_values

_CSS_CLASSES = {Verdict.VERIFIED: "good", Verdict.NOT_VERIFIED: "alert", Verdict.MORE_RUNS: "open"}

ALL_FAILED = "open: all runs failed"
"""Verdict in words on a requirement that is not decided by runs of which all failed: more of these tell nothing."""


@dataclass(frozen=True)
class RequirementRow:
    """Row of the table of requirements, which is also a tile.

    `cells` are pairs of a text and a smaller one below it: worst value; percentile of the sample; tolerance bound,
    which is compared with the limit, and its rank; margin; violations, and those allowed; success fraction, and its
    bounds; consumer's risk, and that reached. `decided` and `looks` are those of a sequential
    campaign.
    """

    title: str
    probability: str
    verdict: str
    css_class: str
    note: str
    cells: list[tuple[str, str]]
    violating: list[int]
    more_violating: int
    decided: str = ""
    looks: Sequence[sequential_section.LookRow] = ()


def content(campaign: CampaignResults, missing: int) -> list[dict[str, Any]]:
    """Part of report.json: every requirement with its evaluation; values that the runs do not support are None.

    If `missing` is not 0, there is no verdict.

    Raises:
        ResultError: the campaign lacks the metric of a requirement, or an entry is not a valid requirement.
    """
    entries = campaign.info.get("scenario", {}).get("requirements") or []
    return [
        _entry(campaign, _validated_requirement(campaign, index, entry), missing) for index, entry in enumerate(entries)
    ]


def rows(entries: Sequence[Mapping[str, Any]]) -> list[RequirementRow]:
    """Rows of the table, which are also the tiles."""
    return [_row(entry) for entry in entries]


def requirement_of(entry: Mapping[str, Any]) -> RequirementSection:
    """Requirement of an entry of report.json."""
    names = RequirementSection.model_fields
    return RequirementSection.model_validate({key: entry[key] for key in names if key in entry})


def limit_text(entry: Mapping[str, Any]) -> str:
    """Metric, sign of comparison and limit of an entry of report.json."""
    label = metric_label(entry.get("of", entry["metric"]))
    side = "\N{LESS-THAN OR EQUAL TO}" if entry["bound"] == "at most" else "\N{GREATER-THAN OR EQUAL TO}"
    return f"{label.title} {side} {with_unit(format(entry['limit'], 'g'), label.unit)}"


def _requirement_phrase(requirement: RequirementSection) -> str:
    label = metric_label(requirement.metric_name)
    limit = with_unit(f"{requirement.limit:g}", label.unit)
    share = f"in at least {100.0 * requirement.probability:g} % of {_of_runs(requirement)}"
    return f"{label.title} {requirement.bound} {limit} {share}"


def _of_runs(requirement: RequirementSection) -> str:
    """Of which runs a requirement is."""
    conditions = [] if requirement.outcome is None else [f"end as {requirement.outcome}"]
    if requirement.is_of_reaching_runs:
        conditions.append(_reach(requirement))
    return f"runs that {' and '.join(conditions)}" if conditions else "runs"


def _reach(requirement: RequirementSection) -> str:
    at = requirement.at
    return f"reach {requirement.phase}" if at is None else f"come to the {at} of {requirement.phase}"


def _validated_requirement(campaign: CampaignResults, index: int, entry: Mapping[str, Any]) -> RequirementSection:
    try:
        found = RequirementSection.model_validate(entry)
    except pydantic.ValidationError as error:
        reason = error.errors()[0]["msg"]
        raise ResultError(f"requirements[{index}]: found {entry!r}, expected a requirement: {reason}") from None
    if len(campaign.completed) and found.metric_name not in campaign.metrics:
        raise ResultError(f"requirements[{index}]: found no metric {found.metric_name!r} in the campaign, expected it")
    return found


def _entry(campaign: CampaignResults, requirement: RequirementSection, missing: int) -> dict[str, Any]:
    ended = len(campaign.completed) > 0
    values = required_values(requirement, campaign.metrics) if ended else np.zeros(0)
    is_conditional = ended and (requirement.outcome is not None or requirement.is_of_reaching_runs)
    counted = counts(requirement, campaign.metrics, campaign.outcomes) if is_conditional else None
    reached = reaches(requirement, campaign.metrics) if ended else None
    of_outcome = is_of_outcome(requirement, campaign.outcomes)
    sealed = bool(campaign.info.get("sealed", True))
    looks = sequential_section.path_of(campaign, requirement) if ended else None
    found = evaluate_requirement(
        requirement, values, campaign.run_ids, runs_are_independent(campaign), missing, counted, sealed, looks
    )
    sequential = sequential_section.entry(found, sequential_section.planned_looks(campaign.info))
    # One run alone says whether it kept the limit.
    is_hopeless = found.verdict is Verdict.MORE_RUNS and len(campaign.failed) > 1 and bool(np.all(campaign.failed))
    words = ALL_FAILED if is_hopeless else _verdict_text(found)
    return {
        "text": _requirement_phrase(requirement),
        **requirement.model_dump(),
        "unit": metric_label(requirement.metric_name).unit or "-",
        "verdict": str(found.verdict),
        "verdict_text": f"{words} {sequential_section.decided_text(sequential)}".rstrip(),
        "more_runs": None if is_hopeless or found.is_out_of_reach else found.more_runs,
        "runs": found.runs,
        "violations": found.violations,
        "beyond_limit": found.beyond_limit,
        "allowed": found.allowed,
        "rank": found.rank,
        "order_statistic": found.order_statistic,
        "margin": found.margin,
        "without_value": found.without_value,
        "without_value_text": _without_value(campaign, requirement, values, counted),
        "worst": found.worst,
        "sample_percentile": _sample_percentile(
            requirement, values if counted is None else values[counted], found.rank
        ),
        "success": found.success_fraction,
        "risk_reached": found.risk_reached,
        "success_interval": None if found.success_interval is None else list(found.success_interval),
        "violating_ids": list(found.violating_ids),
        **sequential,
        **({} if requirement.is_of_all_runs else {"of": requirement.metric_name, "not_counted": found.not_counted}),
        **({} if reached is None else _reached_entry(requirement, reached, of_outcome)),
    }


def _verdict_text(found: RequirementEvaluation) -> str:
    """Verdict in words; where runs without a value alone refute it, they and not the limit are named."""
    is_by_values = found.beyond_limit or not found.without_value
    if is_by_values or found.text != VIOLATED:
        return found.text
    return f"{found.without_value} without a value"


def _without_value(
    campaign: CampaignResults, requirement: RequirementSection, values: np.ndarray, counted: np.ndarray | None
) -> str:
    """Why runs have no value, the most frequent reason first, such as `1 entered the keep-out sphere`; else empty."""
    lacking = ~np.isfinite(values) & (np.full(len(values), True) if counted is None else counted)
    kinds = [Outcome(str(name)) for name in np.asarray(campaign.outcomes)[: len(values)][lacking]]
    otherwise = "not defined" if requirement.phase is None else f"did not {_reach(requirement)}"
    reasons = Counter(kind.reason if kind.is_failure else otherwise for kind in kinds)
    return ", ".join(f"{count} {reason}" for reason, count in reasons.most_common())


def _sample_percentile(requirement: RequirementSection, values: np.ndarray, rank: int | None) -> float | None:
    """Percentile of the runs with a value that the demanded share names, which is no bound; None without a rank."""
    defined = values[np.isfinite(values)]
    if not len(defined) or rank is None:
        return None
    share = requirement.probability if requirement.bound == "at most" else 1.0 - requirement.probability
    return float(np.percentile(defined, 100.0 * share))


def _reached_entry(requirement: RequirementSection, reached: np.ndarray, of_outcome: np.ndarray) -> dict[str, Any]:
    """How many runs came to the requirement's phase, of how many of its outcome, and both in words."""
    count, total = int(np.sum(reached & of_outcome)), int(np.sum(of_outcome))
    words = _reach(requirement).replace("reach", "reached", 1).replace("come", "came", 1)
    return {"reached": count, "reached_text": f"{count} of {total} {words}"}


def _row(entry: Mapping[str, Any]) -> RequirementRow:
    label = metric_label(entry.get("of", entry["metric"]))
    cells, decided = _cells(entry), sequential_section.decided_text(entry)
    return RequirementRow(
        title=limit_text(entry),
        probability=f"in at least {_share(entry)}" + _reached(entry),
        verdict=entry["verdict_text"].removesuffix(decided).rstrip(),
        decided=decided,
        css_class=_CSS_CLASSES.get(Verdict(entry["verdict"]), "open"),
        note=(f"{decided}; " if decided else "")
        + f"in {_share(entry)}"
        + _reached(entry)
        + f"; {violations_text(entry)}"
        + _not_counted(entry)
        + _compared(entry, label.unit),
        cells=cells,
        violating=list(entry["violating_ids"]),
        more_violating=entry["violations"] - len(entry["violating_ids"]),
        looks=sequential_section.look_rows(entry),
    )


def _cells(entry: Mapping[str, Any]) -> list[tuple[str, str]]:
    interval = entry["success_interval"]
    allowed = "too few runs" if entry["allowed"] is None else f"{entry['allowed']} allowed"
    no_verdict = str(entry["verdict"]).partition(":")[0]
    beside = f"{entry['without_value']} of them without a value; {no_verdict if interval is None else allowed}"
    return [
        _worst_cell(entry),
        (sample_percentile_text(entry) or format_number(None), ""),
        (_order_statistic_text(entry), "" if entry["rank"] is None else f"rank {entry['rank']} of {entry['runs']}"),
        (_signed(entry["margin"]), ""),
        (
            f"{entry['violations']} of {entry['runs']}",
            beside if entry["without_value"] else beside.partition("; ")[2],
        ),
        (
            format_number(None) if entry["success"] is None else _rounded_down(entry["success"]),
            "" if interval is None else f"{_rounded_down(interval[0])} to {_rounded_up(interval[1])}",
        ),
        (f"{100.0 * entry['consumer_risk']:g} %", _risk_text(entry["risk_reached"])),
    ]


def _compared(entry: Mapping[str, Any], unit: str) -> str:
    """Addition of the tolerance bound that is compared with the limit, its margin, and the percentile of the sample."""
    text = ""
    if entry["margin"] is not None:
        value, margin = (
            with_unit(text, unit) for text in (_rounded(entry["order_statistic"]), _signed(entry["margin"], 3))
        )
        text = f"; tolerance bound {value} at {100.0 * entry['consumer_risk']:g} % risk: margin {margin}"
    sample = sample_percentile_text(entry)
    return text + (f"; sample {sample}" if sample else "")


def sample_percentile_text(entry: Mapping[str, Any]) -> str:
    """Name and value of the percentile of the sample that the demanded share names, such as `p99 1.23 m`."""
    value = entry.get("sample_percentile")
    if value is None:
        return ""
    percent = 100.0 * entry["probability"] if entry["bound"] == "at most" else 100.0 - 100.0 * entry["probability"]
    unit = metric_label(entry.get("of", entry["metric"])).unit
    return f"p{percent:.4g} {with_unit(_rounded(value), unit)}"


def violations_text(entry: Mapping[str, Any]) -> str:
    """How many runs violate a requirement, and how many of them by having no value, in words."""
    if not entry["without_value"]:
        return f"{entry['violations']} of {entry['runs']} violate it"
    return f"{entry['violations']} of {entry['runs']} violate it, {entry['without_value']} of them without a value"


def worst_text(entry: Mapping[str, Any]) -> str:
    """Worst run in words: one without a value is worse than all others; empty without runs."""
    unit = metric_label(entry.get("of", entry["metric"])).unit
    value = "" if entry["worst"] is None else with_unit(format_number(entry["worst"], 3), unit)
    if not entry["without_value"]:
        return value
    reason = entry["without_value_text"]
    return f"no value ({reason})" + (f", of the others {value}" if value else "")


def _worst_cell(entry: Mapping[str, Any]) -> tuple[str, str]:
    if not entry["without_value"]:
        return format_number(entry["worst"]), ""
    of_others = "" if entry["worst"] is None else f"; of the others {format_number(entry['worst'])}"
    return "no value", entry["without_value_text"] + of_others


def _share(entry: Mapping[str, Any]) -> str:
    """Demanded share of the runs that count."""
    requirement = requirement_of(entry)
    return f"{100.0 * requirement.probability:g} % of {_of_runs(requirement)}"


def _reached(entry: Mapping[str, Any]) -> str:
    """Words on how many runs came to the requirement's phase, empty if it has no phase."""
    return f"; {entry['reached_text']}" if "reached_text" in entry else ""


def _not_counted(entry: Mapping[str, Any]) -> str:
    """Words on runs that do not count, empty if all count."""
    if not entry.get("not_counted"):
        return ""
    return f"; {entry['not_counted']} do not count, as they ended otherwise or were never there"


def _risk_text(reached: float | None) -> str:
    if reached is None:
        return ""
    return "below 0.01 %" if reached < 1e-4 else f"{format_number(100.0 * reached, 2)} %"


def _order_statistic_text(entry: Mapping[str, Any]) -> str:
    """Value compared with the limit, or a note if the run of that rank has none."""
    if entry["order_statistic"] is None and entry["rank"] is not None:
        return "run without value"
    return format_number(entry["order_statistic"])


def _rounded(value: float | None, digits: int = 3) -> str:
    return format_number(value, digits).replace("-", "\N{MINUS SIGN}")


def _signed(value: float | None, digits: int = 4) -> str:
    text = _rounded(value, digits)
    return text if value is None or value <= 0.0 else f"+{text}"


def _rounded_down(probability: float) -> str:
    """Probability rounded down, so that one just below a requirement is not shown as equal to it."""
    return f"{np.floor(1e4 * probability) / 1e4:.4f}"


def _rounded_up(probability: float) -> str:
    return f"{np.ceil(1e4 * probability) / 1e4:.4f}"
