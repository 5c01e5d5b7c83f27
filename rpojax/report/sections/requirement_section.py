"""The scenario's requirements, each with what the runs say of it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pydantic

from rpojax.analysis.statistics.tolerance_verdicts import Judgement, Verdict, judge
from rpojax.errors import ResultError
from rpojax.report.campaign_protocol import Results
from rpojax.report.labels import metric, number, with_unit
from rpojax.report.sections.design_caveat import independent
from rpojax.scenario.schema import RequirementSection

_STATES = {Verdict.VERIFIED: "good", Verdict.NOT_VERIFIED: "alert", Verdict.MORE_RUNS: "open"}


@dataclass(frozen=True)
class Row:
    """One requirement as the page shows it: texts, a state for its colour, and the runs that violate it.

    `cells` are of the table, each a text and a smaller one below it: worst value; run compared with the limit, and its
    rank; margin; violations, and those allowed; share of success, and its bounds; consumer's risk, and that reached.
    """

    text: str
    short: str
    share: str
    verdict: str
    state: str
    note: str
    cells: list[tuple[str, str]]
    violating: list[int]
    more_violating: int


def judged(campaign: Results, missing: int) -> list[dict[str, Any]]:
    """Part of report.json: every requirement of the scenario with its judgement, None where runs allow no statement.

    With `missing` runs there is no verdict.

    Raises:
        ResultError: the campaign has not the metric of a requirement, or its requirement is none.
    """
    entries = campaign.info.get("scenario", {}).get("requirements") or []
    return [_entry(campaign, _requirement(campaign, index, entry), missing) for index, entry in enumerate(entries)]


def rows(entries: Sequence[Mapping[str, Any]]) -> list[Row]:
    """Lines of the table and tiles of the page."""
    return [_row(entry) for entry in entries]


def in_words(requirement: RequirementSection) -> str:
    """A requirement as a phrase."""
    shown = metric(requirement.metric)
    limit = with_unit(f"{requirement.limit:g}", shown.unit)
    return f"{shown.title} {requirement.bound} {limit} in at least {100.0 * requirement.probability:g} % of runs"


def _requirement(campaign: Results, index: int, entry: Mapping[str, Any]) -> RequirementSection:
    try:
        found = RequirementSection.model_validate(entry)
    except pydantic.ValidationError as error:
        reason = error.errors()[0]["msg"]
        raise ResultError(f"requirements[{index}]: found {entry!r}, expected a requirement: {reason}") from None
    if len(campaign.completed) and found.metric not in campaign.metrics:
        raise ResultError(f"requirements[{index}]: found no metric {found.metric!r} in the campaign, expected it")
    return found


def _entry(campaign: Results, requirement: RequirementSection, missing: int) -> dict[str, Any]:
    values = np.asarray(campaign.metrics.get(requirement.metric, ()), dtype=np.float64)
    failed = ~np.asarray(campaign.completed, dtype=bool)
    found = judge(requirement, values, failed, campaign.run_ids, independent(campaign), missing)
    return {
        "text": in_words(requirement),
        **requirement.model_dump(),
        "unit": metric(requirement.metric).unit or "-",
        "verdict": str(found.verdict),
        "verdict_text": found.text,
        **{name: getattr(found, name) for name in _JUDGED},
        "success_interval": None if found.success_interval is None else list(found.success_interval),
        "violating_ids": list(found.violating_ids),
    }


_JUDGED = tuple(
    name
    for name in Judgement.__dataclass_fields__
    if name not in ("requirement", "verdict", "success_interval", "violating_ids")
)


def _row(entry: Mapping[str, Any]) -> Row:
    shown = metric(entry["metric"])
    cells = _cells(entry)
    side = "\N{LESS-THAN OR EQUAL TO}" if entry["bound"] == "at most" else "\N{GREATER-THAN OR EQUAL TO}"
    return Row(
        text=entry["text"],
        short=f"{shown.title} {side} {with_unit(format(entry['limit'], 'g'), shown.unit)}",
        share=f"in at least {100.0 * entry['probability']:g} % of runs",
        verdict=entry["verdict_text"],
        state=_STATES.get(Verdict(entry["verdict"]), "open"),
        note=f"{100.0 * entry['probability']:g} % of runs; {entry['violations']} of {entry['runs']} violate it"
        + ("" if entry["margin"] is None else f"; margin {with_unit(_signed(entry['margin']), shown.unit)}"),
        cells=cells,
        violating=list(entry["violating_ids"]),
        more_violating=entry["violations"] - len(entry["violating_ids"]),
    )


def _cells(entry: Mapping[str, Any]) -> list[tuple[str, str]]:
    interval = entry["success_interval"]
    allowed = "too few runs" if entry["allowed"] is None else f"{entry['allowed']} allowed"
    untold = str(entry["verdict"]).partition(":")[0]
    valued = entry["runs"] - entry["without_value"]
    return [
        (number(entry["worst"]), f"of {valued} runs with a value" if valued < entry["runs"] else ""),
        (_value(entry), "" if entry["rank"] is None else f"rank {entry['rank']} of {entry['runs']}"),
        (_signed(entry["margin"]), ""),
        (f"{entry['violations']} of {entry['runs']}", untold if interval is None else allowed),
        (
            number(None) if entry["success"] is None else _floor(entry["success"]),
            "" if interval is None else f"{_floor(interval[0])} to {_ceiling(interval[1])}",
        ),
        (f"{100.0 * entry['consumer_risk']:g} %", _risk(entry["risk_reached"])),
    ]


def _risk(reached: float | None) -> str:
    if reached is None:
        return ""
    return "below 0.01 %" if reached < 1e-4 else f"{number(100.0 * reached, 2)} %"


def _value(entry: Mapping[str, Any]) -> str:
    """Value of the run to compare with the limit; a word where that run has none."""
    if entry["order_statistic"] is None and entry["rank"] is not None:
        return "run without value"
    return number(entry["order_statistic"])


def _signed(value: float | None) -> str:
    return number(value) if value is None or value <= 0.0 else f"+{number(value)}"


def _floor(share: float) -> str:
    """A probability rounded down, so that one below a requirement never looks as if it met it."""
    return f"{np.floor(1e4 * share) / 1e4:.4f}"


def _ceiling(share: float) -> str:
    return f"{np.ceil(1e4 * share) / 1e4:.4f}"
