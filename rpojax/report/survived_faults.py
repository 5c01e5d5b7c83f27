"""Results of a study of faults as readers see them: a table of faults by time, and sentences."""

from collections.abc import Mapping
from typing import Any, Final

from rpojax.analysis.statistics.intervals import clopper_pearson_interval
from rpojax.report.labels import format_number, format_percent_interval, with_unit
from rpojax.report.robust_margins import title

MOST_ROWS: Final = 60
"""Most rows of the table in a terminal; the page and faults.json have all."""
Cell = Mapping[str, Any]


def by_title(content: Mapping[str, Any]) -> dict[str, list[Cell]]:
    """Cells of each fault, or pair of faults, in the order of their times."""
    found: dict[str, list[Cell]] = {}
    for cell in content["cells"]:
        found.setdefault(cell["title"], []).append(cell)
    return found


def _text(cell: Cell) -> str:
    return ", ".join(filter(None, (share(cell), margin(cell), completed(cell))))


def headings(content: Mapping[str, Any]) -> list[str]:
    """Headings of the table: the fault, and its times."""
    return ["fault", *(f"from {format_number(time)} s" for time in content["study"]["times_s"])]


def table(content: Mapping[str, Any]) -> list[list[str]]:
    """Headings, and a row for each fault: survived runs and margin for each time."""
    rows = [[name, *map(_text, cells)] for name, cells in by_title(content).items()]
    nominal = content["nominal"]
    without = ["none", _text(nominal), *([""] * (len(content["study"]["times_s"]) - 1))]
    return [headings(content), without, *rows]


def share(cell: Cell) -> str:
    """Survived runs of all."""
    return f"{cell['survived']}/{cell['runs']}"


def completed(cell: Cell) -> str:
    """How many runs reached their goal, where not all did."""
    return "" if cell["completed"] == cell["runs"] else f"{cell['completed']} complete"


def margin(cell: Cell) -> str:
    """Least margin of a requirement as a share of its limit, or the clearance of the keep-out sphere without one."""
    found = cell["margin"]
    if found is None:
        return clearance(cell)
    return "no value" if found["relative"] is None else f"{100.0 * found['relative']:+.0f} %"


def clearance(cell: Cell) -> str:
    """Least distance from the keep-out sphere of all runs that have one."""
    return "no range" if cell["clearance_m"] is None else with_unit(format_number(cell["clearance_m"], 3), "m")


def binding(cell: Cell) -> str:
    """The requirement of the least margin, and its value there."""
    found = cell["margin"]
    if found is None:
        return ""
    unit = "" if found["unit"] == "-" else found["unit"]
    value = "no value" if found["value"] is None else with_unit(format_number(found["value"], 3), unit)
    return f"{title(found['requirement'])}: {value}, limit {with_unit(format_number(found['limit'], 3), unit)}"


def interval(cell: Cell) -> str:
    """The 95 % interval of the share that survives."""
    return format_percent_interval(*cell["interval_95"])


def worst_first(content: Mapping[str, Any]) -> list[Cell]:
    """Cells, those with the least survived share first, then those with the least margin."""
    return sorted(content["cells"], key=_rank)


def _rank(cell: Cell) -> tuple[float, float, float]:
    found, clear = cell["margin"], cell["clearance_m"]
    relative = 0.0 if found is None else found["relative"]
    lowest = -float("inf")
    return cell["survived_share"], lowest if relative is None else relative, lowest if clear is None else clear


def sentences(content: Mapping[str, Any]) -> list[str]:
    """What the study found and what its numbers mean, the outcome first."""
    study, cells = content["study"], content["cells"]
    runs, worst = study["runs"], worst_first(content)[0]
    whole = sum(cell["survived"] == cell["runs"] for cell in cells)
    what = "pairs of faults and times" if study["double"] else "faults and times"
    found = [
        f"All {runs} runs survive {whole} of {len(cells)} {what}. The worst is {worst['title']} from "
        f"{format_number(worst['time_s'])} s on: {share(worst)} runs survive{_with_margin(worst)}."
    ]
    if study["judged"]:
        names = ", ".join(map(title, study["judged"]))
        found.append(
            "A run survives if nothing ends it before its time and it violates no requirement; judged: "
            f"{names}. A margin is the least of all runs and requirements, over the limit; it is negative beyond it."
        )
    else:
        found.append("The scenario has no requirement that is judged: a run survives if its outcome is no failure.")
    low = 100.0 * clopper_pearson_interval(runs, runs)[0]
    found.append(
        f"{runs} of {runs} survived runs are compatible with a survival probability of {low:.3g} % (95 % interval)."
    )
    if study["not_judged"]:
        left = ", ".join(map(title, study["not_judged"]))
        found.append(f"Not judged, because they need free drifts or coverage (--free-drifts): {left}.")
    return found


def _with_margin(cell: Cell) -> str:
    told = binding(cell)
    return f" ({told})" if told else ""
