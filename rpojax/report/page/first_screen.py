"""Outcome of a campaign, as the first screen shows it: sentence, verdicts, three figures, and what to look at next."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, Literal

from rpojax.analysis.statistics.tolerance_verdicts import Verdict
from rpojax.report import shell_commands
from rpojax.report.campaign_results import CampaignResults
from rpojax.report.figures.requirement_limits import CHANNEL_OF_METRIC
from rpojax.report.labels import CHANNEL_LABELS, format_number, heading, metric_label, with_unit
from rpojax.report.sections import failure_section, requirement_verdict_section
from rpojax.report.sections.failure_section import detail_counts, outcomes_text
from rpojax.report.sections.requirement_verdict_section import violation_kinds

Colour = Literal["good", "alert", "open"]
_WITHOUT_VERDICT = (Verdict.NO_RUNS, Verdict.NOT_INDEPENDENT, Verdict.UNFINISHED, Verdict.UNSEALED)
_FIGURES: Final = 3
_MAX_STEPS: Final = 6
_NEES_COMPONENTS: Final = 6
_INCONSISTENT: Final = 1.3
"""Ratio of the mean relative NEES to its expectation from which the filter is called overconfident."""


@dataclass(frozen=True)
class VerdictTile:
    """Tile of a verdict: subject, verdict, note, CSS class (good, bad or open), and section to read."""

    title: str
    value: str
    note: str
    css_class: str
    section: str


def verdict_tiles(content: Mapping[str, Any]) -> list[VerdictTile]:
    """Tiles of passive safety, of all requirements, and of failed runs; the bad ones first."""
    tiles = [
        VerdictTile(row.title, row.verdict, row.note + _worst(entry), row.css_class, "requirements")
        for row, entry in zip(
            requirement_verdict_section.rows(content["requirements"]), content["requirements"], strict=True
        )
    ]
    found = [*_passive_safety(content["safety"]), *tiles, *_of_runs(content)]
    order = ("alert", "open", "good")
    return sorted(found, key=lambda tile: order.index(tile.css_class))


def nearest_drift(safety: Mapping[str, Any]) -> Mapping[str, Any] | None:
    """Least range in the longest horizon of free drift that has one, with its run."""
    drifts = [drift["least_range"] for drift in safety["free_drift"] if drift["least_range"] is not None]
    return drifts[-1] if drifts else safety["least_passive_range"]


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


def _passive_safety(safety: Mapping[str, Any]) -> list[VerdictTile]:
    found = passive_safety_count(safety)
    if found is None:
        return []
    horizon, proportion = found
    least = nearest_drift(safety)
    count, runs = proportion["count"], proportion["runs"]
    note = f"keep-out sphere in free drift within {horizon}"
    if least is not None:
        note += f"; nearest {with_unit(format_number(least['value'], 3), 'm')}, run {least['run_id']}"
    value = f"fails: {count} of {runs}" if count else f"holds: {runs} of {runs}"
    return [VerdictTile("Passive safety", value, note, "alert" if count else "good", "safety")]


def _worst(entry: Mapping[str, Any]) -> str:
    """Addition of the worst value, where there is no margin."""
    if entry["margin"] is not None or entry["worst"] is None:
        return ""
    unit = metric_label(entry.get("of", entry["metric"])).unit
    return f"; worst {with_unit(format_number(entry['worst'], 3), unit)}"


def _of_runs(content: Mapping[str, Any]) -> list[VerdictTile]:
    """Tiles of failed runs and, where there are any, of those that are not judged."""
    runs = content["runs"]
    ended = runs["requested"] - runs["missing"]
    note = "every run completed" if runs["completed"] == ended else ""
    if runs["failed"]:
        note = failure_section.outcomes_text(runs["outcomes"])
        if causes := content["why_failed"]["causes"]:
            note += f"; most often {causes[0]['title']}" if len(causes) > 1 else f"; {causes[0]['title']}"
        elif details := failure_section.detail_counts(content["failures"]):
            note += f"; most often {details[0][0]}" if len(details) > 1 else f"; {details[0][0]}"
    colour: Colour = "alert" if runs["failed"] else "good" if runs["completed"] == ended > 0 else "open"
    found = [VerdictTile("Failed runs", f"{runs['failed']} of {ended}", note, colour, "failures")]
    if runs["not_judged"]:
        why = "they end before limits.arrive_by_s: no failure, and no success"
        found.append(VerdictTile("Runs not judged", f"{runs['not_judged']} of {ended}", why, "open", "failures"))
    return found


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
        (sum(verdicts.count(kind) for kind in _WITHOUT_VERDICT), "without a verdict"),
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


@dataclass(frozen=True)
class LeadingFigure:
    """A chart of the page by its name, with its title."""

    chart: str
    title: str


def leading_figures(content: Mapping[str, Any], charts: Collection[str]) -> list[LeadingFigure]:
    """At most three of the page's `charts`: mission or range, the channel of the weakest requirement, its histogram."""
    weakest = weakest_requirement(content["requirements"])
    name = "" if weakest is None else str(weakest.get("of", weakest["metric"]))
    channel = CHANNEL_OF_METRIC.get(name.partition("@")[0], "nav_relative_error_m")
    wanted = [
        *_phases(content),
        LeadingFigure("envelope-range_m", "Range to the target [m], all runs"),
        *([] if channel == "range_m" else [_envelope(channel)]),
        LeadingFigure(f"histogram-{name}", _histogram_title(name)),
        _envelope("formation_error_m"),
        _envelope("nav_relative_error_m"),
        _envelope("delta_v_m_s"),
    ]
    found: dict[str, LeadingFigure] = {}
    for figure in wanted:
        if figure.chart in charts:
            found.setdefault(figure.chart, figure)
    figures = list(found.values())
    spread = [figure for figure in figures if figure.chart.startswith("histogram-")]
    return [*[figure for figure in figures if figure not in spread][: _FIGURES - len(spread)], *spread]


def _phases(content: Mapping[str, Any]) -> list[LeadingFigure]:
    """Phases of the mission, where the runs were in more than one."""
    phases = (content.get("mission") or {}).get("phases", [])
    several = sum(phase["runs"] > 0 for phase in phases) > 1
    return [LeadingFigure("phase-shares", "Runs in each phase of the mission [%]")] if several else []


def _envelope(channel: str) -> LeadingFigure:
    label = next((one for one in CHANNEL_LABELS if one.name == channel), None)
    title = channel if label is None else f"{heading(label)}, all runs"
    return LeadingFigure(f"envelope-{channel}", title)


def _histogram_title(name: str) -> str:
    label = metric_label(name)
    return f"{heading(label)}, weakest requirement" if name else ""


@dataclass(frozen=True)
class NextStep:
    """A sentence, the section to read, and a command to run; empty where there is none."""

    text: str
    section: str
    command: str = ""


def next_steps(campaign: CampaignResults, content: Mapping[str, Any]) -> list[NextStep]:
    """Steps after reading the first screen."""
    steps = [
        *_failures(campaign, content),
        *_not_judged(content),
        *_passive_safety_step(campaign, content),
        *_violations(campaign, content),
        *_more_runs(campaign, content),
        *_consistency(content),
        *_influences(content),
    ]
    if not steps:
        steps = [NextStep("Nothing failed and nothing is open: read the worst run and the limits of use.", "run")]
    return steps[:_MAX_STEPS]


def _failures(campaign: CampaignResults, content: Mapping[str, Any]) -> list[NextStep]:
    runs = content["runs"]
    if not runs["failed"]:
        return []
    first = content["failures"][0]["run_id"]
    causes = content["why_failed"]["causes"]
    if causes:
        leading = causes[0]
        first = leading["run_ids"][0]
        mend = f" To change: {leading['mend']}." if leading["mend"] else ""
        text = f"{leading['runs']} of {runs['failed']} failed runs: {leading['title']}.{mend} Repeat one to look at it."
        return [NextStep(text, "failures", shell_commands.rerun_command(campaign, first, f"run_{first}"))]
    text = f"{runs['failed']} runs failed ({outcomes_text(runs['outcomes'])}), and no cause was found: repeat one."
    if details := detail_counts(content["failures"]):
        text += "".join(f" {count} {detail}." for detail, count in details[:2])
    return [NextStep(text, "failures", shell_commands.rerun_command(campaign, first, f"run_{first}"))]


def _not_judged(content: Mapping[str, Any]) -> list[NextStep]:
    count = content["runs"]["not_judged"]
    if not count:
        return []
    text = (
        f"{count} runs are not judged: raise duration_s beyond limits.arrive_by_s, or lower that, or set "
        'goal.phase = "none" if these runs have nowhere to arrive.'
    )
    return [NextStep(text, "failures")]


def _passive_safety_step(campaign: CampaignResults, content: Mapping[str, Any]) -> list[NextStep]:
    safety = content["safety"]
    found, steps = passive_safety_count(safety), []
    if found is not None and found[1]["count"]:
        horizon, proportion = found
        text = (
            f"After a loss of thrust {proportion['count']} of {proportion['runs']} runs could drift into the keep-out "
            f"sphere within {horizon}: accept the risk, or choose a passively safe orbit such as safety_ellipse."
        )
        steps.append(NextStep(text, "safety", _nearest_command(campaign, nearest_drift(safety))))
    stuck = safety["stuck_on"]
    if (below := stuck["below_keep_out"]) is not None and below["count"]:
        text = (
            f"After a burn that did not end {below['count']} of {below['runs']} runs could drift into the sphere "
            "within 24 h: consider how a stuck thruster is shut off."
        )
        steps.append(NextStep(text, "safety", _nearest_command(campaign, stuck["least_range"])))
    return steps


def _nearest_command(campaign: CampaignResults, nearest: Mapping[str, Any] | None) -> str:
    """Command that repeats the run with the nearest drift, empty without one."""
    if nearest is None:
        return ""
    return shell_commands.rerun_command(campaign, nearest["run_id"], f"run_{nearest['run_id']}")


def _violations(campaign: CampaignResults, content: Mapping[str, Any]) -> list[NextStep]:
    steps = []
    for entry in content["requirements"]:
        of_passive_safety = str(entry["metric"]).startswith("passive_range") and _passive_safety_step(campaign, content)
        if entry["verdict"] != Verdict.NOT_VERIFIED or not entry["violating_ids"] or of_passive_safety:
            continue
        # The runs without a value, which failed, come first among them and are a step of their own.
        beyond = entry["violating_ids"][entry["without_value"] :]
        run = (beyond or entry["violating_ids"])[0]
        text = (
            f"Not verified: {entry['text']}: {entry['violations']} of {entry['runs']} runs violate it"
            f"{violation_kinds(entry)}."
        )
        steps.append(NextStep(text, "requirements", shell_commands.rerun_command(campaign, run, f"run_{run}")))
    return steps[:2]


def _more_runs(campaign: CampaignResults, content: Mapping[str, Any]) -> list[NextStep]:
    wanted = [entry["more_runs"] for entry in content["requirements"] if entry["more_runs"]]
    if not wanted:
        return []
    runs = content["runs"]["requested"]
    noun = "requirement needs" if len(wanted) == 1 else "requirements need"
    text = (
        f"{len(wanted)} {noun} more runs: simulate at least {runs + max(wanted)} as a new campaign with another seed."
    )
    seed = int(campaign.info.get("seed", 0)) + 1
    return [NextStep(text, "requirements", shell_commands.more_runs_command(campaign, runs + max(wanted), seed))]


def _consistency(content: Mapping[str, Any]) -> list[NextStep]:
    entry = content["metrics"].get("nees_relative_mean")
    if not entry or entry["mean"] is None or entry["mean"] < _INCONSISTENT * _NEES_COMPONENTS:
        return []
    ratio = format_number(entry["mean"] / _NEES_COMPONENTS, 3)
    return [NextStep(f"The filter is overconfident: NEES / 6 of the relative state is {ratio}.", "consistency")]


def _influences(content: Mapping[str, Any]) -> list[NextStep]:
    """The input with most influence on the requirement with the weakest margin."""
    weakest = weakest_requirement(content["requirements"])
    name = None if weakest is None else weakest.get("of", weakest["metric"])
    found = [entry for entry in content["sensitivity"] if entry["metric"] == name and entry["by_spearman"]]
    if weakest is None or not found:
        return []
    label = metric_label(str(name))
    worst = "" if weakest["worst"] is None else f" (worst {with_unit(format_number(weakest['worst'], 3), label.unit)})"
    return [NextStep(f"{label.title}{worst} depends most on {found[0]['by_spearman'][0]}.", "sensitivity")]
