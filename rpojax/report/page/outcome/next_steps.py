"""What to look at next: at most six sentences from what was found, the most pressing first."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

from rpojax.analysis.statistics.tolerance_verdicts import Verdict
from rpojax.report import shell_commands
from rpojax.report.campaign_results import CampaignResults
from rpojax.report.labels import metric_label
from rpojax.report.number_format import format_number, with_unit
from rpojax.report.page.outcome.outcome_sentence import weakest_requirement
from rpojax.report.page.outcome.verdict_tiles import passive_safety_count
from rpojax.report.sections.failure_section import detail_counts, outcomes_text
from rpojax.report.sections.requirement_verdict_section import violation_kinds

_MAX_STEPS: Final = 6
_NEES_COMPONENTS: Final = 6
_INCONSISTENT: Final = 1.3
"""Ratio of the mean relative NEES to its expectation from which the filter is called overconfident."""


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
        *_passive_safety(campaign, content),
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
    text = f"{runs['failed']} runs failed ({outcomes_text(runs['outcomes'])}): repeat one and read why."
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


def _passive_safety(campaign: CampaignResults, content: Mapping[str, Any]) -> list[NextStep]:
    safety = content["safety"]
    found, steps = passive_safety_count(safety), []
    if found is not None and found[1]["count"]:
        horizon, proportion = found
        drifts = [drift["least_range"] for drift in safety["free_drift"] if drift["least_range"] is not None]
        nearest = drifts[-1] if drifts else safety["least_passive_range"]
        text = (
            f"After a loss of thrust {proportion['count']} of {proportion['runs']} runs could drift into the keep-out "
            f"sphere within {horizon}: accept the risk, or choose a passively safe orbit such as safety_ellipse."
        )
        steps.append(NextStep(text, "safety", _nearest_command(campaign, nearest)))
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
        of_passive_safety = str(entry["metric"]).startswith("passive_range") and _passive_safety(campaign, content)
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
