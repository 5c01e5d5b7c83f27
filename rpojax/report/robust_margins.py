"""Margins of a study of robustness as readers see them: sentences, rows of a table, and bars of the picture."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from rpojax.analysis.robustness.step_runs import COMPLETED, DEFAULT_RISK
from rpojax.analysis.robustness.study import STUDY
from rpojax.analysis.statistics.intervals import success_bounds
from rpojax.report.labels import format_number, metric_label, with_unit

HEADINGS = ("quantity", "nominal", "sigma", "margin below", "margin above")


@dataclass(frozen=True)
class SideMargin:
    """Margin of a quantity to one side.

    Attributes:
        sigmas: last step that holds [believed sigmas]
        text: the same in the quantity's unit
        requirement: title of what breaks first; None where nothing does
        interval: between which steps the margin lies with confidence, in words
    """

    sigmas: float
    text: str
    requirement: str | None
    interval: str

    @property
    def with_requirement(self) -> str:
        """The margin, and what breaks beyond."""
        return self.text if self.requirement is None else f"{self.text}: {self.requirement}"


@dataclass(frozen=True)
class MarginRow:
    """Margins of a quantity.

    Attributes:
        name: its key
        title: what it is
        nominal: in its unit
        sigma: believed, in its unit
        belief: where that comes from
        low: side
        high: side
        is_any: whether both sides stand for any direction
    """

    name: str
    title: str
    nominal: str
    sigma: str
    belief: str
    low: SideMargin
    high: SideMargin
    is_any: bool

    @property
    def cells(self) -> tuple[str, ...]:
        """Cells of the table, as `HEADINGS` names them."""
        return (self.name, self.nominal, self.sigma, self.low.with_requirement, self.high.with_requirement)


def rows(content: Mapping[str, Any]) -> list[MarginRow]:
    """Rows of the table, one for each quantity."""
    details = content[STUDY]["quantities"]
    return [_row(name, entry, details[name]) for name, entry in content.items() if name != STUDY]


def _row(name: str, entry: Mapping[str, Any], details: Mapping[str, Any]) -> MarginRow:
    unit = "" if entry["unit"] == "-" else entry["unit"]
    return MarginRow(
        name=name,
        title=details["title"],
        nominal=with_unit(format_number(details["nominal"]), unit),
        sigma=with_unit(format_number(entry["believed_sigma"], 3), unit),
        belief=details["belief"],
        low=_side("low", entry, details, unit),
        high=_side("high", entry, details, unit),
        is_any=details["sides"] == ["any"],
    )


def _side(side: str, entry: Mapping[str, Any], details: Mapping[str, Any], unit: str) -> SideMargin:
    held, requirement = details[f"{side}_holds_to"], entry["requirement"][side]
    sigmas = held / entry["believed_sigma"]
    amount = f"{with_unit(format_number(held, 3), unit)} ({sigmas:.2g} sigma)"
    least, most = (
        None if end is None else with_unit(format_number(end, 3), unit) for end in details[f"{side}_interval"]
    )
    if requirement is None:
        words = f"at least {least}" if least else "not decided"
    else:
        words = f"{least or 'not decided below'} to {most}" if most else f"above {least}" if least else "not decided"
        words = words.replace("not decided below to", "below")
    return SideMargin(
        sigmas=sigmas,
        text=amount if requirement is not None else f"holds to the last step, {amount}",
        requirement=None if requirement is None else title(requirement),
        interval=words,
    )


def title(requirement: str) -> str:
    """Title of a requirement by its name, which begins with its metric."""
    metric, _, rest = requirement.partition(" ")
    return "Completion" if requirement == COMPLETED else " ".join(filter(None, (metric_label(metric).title, rest)))


def sentences(content: Mapping[str, Any]) -> list[str]:
    """What the study did and what its numbers mean, the outcome first."""
    study = content[STUDY]
    runs = study["runs"]
    found = [_narrowest(rows(content))]
    names = ", ".join(map(title, study["judged"]))
    found.append(
        f"A step breaks if a greater share of its {runs} runs violates a requirement than that allows, or fails "
        f"(completion); judged: {names}. The margin is the last step that holds; the first that breaks lies at most a "
        "tenth of itself, or a sixteenth of a sigma, beyond it. Steps go to 16 sigma, or to where the "
        "quantity would vanish."
    )
    unseen = 100.0 * (1.0 - success_bounds(0, runs, DEFAULT_RISK)[0])
    found.append(
        f"{runs} runs without a violation may still come from a share of {unseen:.2g} % in violation "
        f"(risk {100.0 * DEFAULT_RISK:g} %); {study['runs_that_decide']} runs of each step would decide that one holds."
    )
    if study["broken_at_nominal"]:
        broken = ", ".join(map(title, study["broken_at_nominal"]))
        found.append(f"Not judged, because broken already at the nominal values: {broken}.")
    if study["not_judged"]:
        left = ", ".join(map(title, study["not_judged"]))
        found.append(f"Not judged, because they need free drifts or coverage (--free-drifts): {left}.")
    found += [f"Not moved: {name}: {reason}." for name, reason in study["left_out"].items()]
    return found


def _narrowest(found: list[MarginRow]) -> str:
    sides = [(row, word, side) for row in found for word, side in (("low", row.low), ("high", row.high))]
    broken = [each for each in sides if each[2].requirement is not None]
    if not broken:
        return "Nothing breaks up to the last steps."
    row, word, side = min(broken, key=lambda each: each[2].sigmas)
    word = "in any direction" if row.is_any else f"to the {word} side"
    return f"The narrowest margin is that of the {row.title} {word}: {side.text}, then {side.requirement} breaks."
