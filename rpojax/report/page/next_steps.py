"""What failed or is open, why, and what to change: rows of the table below the headline, with a run to look at."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from rpojax.analysis.statistics.tolerance_verdicts import Verdict
from rpojax.report import shell_commands
from rpojax.report.campaign_results import CampaignResults
from rpojax.report.labels import format_number, format_p_value
from rpojax.report.page.headline import ended_runs, passive_safety_count, weakest_requirement
from rpojax.report.sections.failure_section import detail_counts
from rpojax.report.sections.requirement_verdict_section import limit_text, requirement_of, violations_text, worst_text
from rpojax.report.sections.safety_section import nearest_text, without_drift_text
from rpojax.simulation.outcomes.requirement_violations import counts, required_values, violates
from rpojax.summary_text import counted

_MOST_STEPS: Final = 6
_MOST_CAUSES: Final = 3
_MOST_VIOLATIONS: Final = 2
_NEES_COMPONENTS: Final = 6
_OVERCONFIDENT: Final = "The filter is overconfident"
_INCONSISTENT: Final = 1.3
"""Ratio of the mean relative NEES to its expectation from which the filter is called overconfident."""


@dataclass(frozen=True)
class NextStep:
    """What was found, why, and what to change; the section to read, a command, and the run that it repeats, if any."""

    what: str
    why: str
    change: str
    section: str
    command: str = ""
    run_id: int | None = None

    @property
    def text(self) -> str:
        """All in a row, for the brief report."""
        why = f": {self.why}" if self.why else ""
        return f"{self.what}{why}." + (f" To change: {self.change}." if self.change else "")


def next_steps(campaign: CampaignResults, content: Mapping[str, Any]) -> list[NextStep]:
    """Rows of the table, what matters most first."""
    safety = _passive_safety(campaign, content)
    violated = _violated(content, is_safety_told=bool(safety))
    steps = [
        *_failures(campaign, content),
        *_not_judged(content),
        *safety,
        *_violations(campaign, content, violated),
        *_consequences(campaign, content, violated),
        *_more_runs(campaign, content),
        *_consistency(campaign, content),
    ]
    if not steps:
        steps = [_nothing(content)]
    return steps[:_MOST_STEPS]


def nearest_drift(safety: Mapping[str, Any]) -> Mapping[str, Any] | None:
    """Least range in the longest horizon of free drift that has one, with its run."""
    drifts = [drift["least_range"] for drift in safety["free_drift"] if drift["least_range"] is not None]
    return drifts[-1] if drifts else safety["least_passive_range"]


def _repeat(campaign: CampaignResults, run: int) -> tuple[str, int]:
    return shell_commands.rerun_command(campaign, run, f"run_{run}"), run


def _failures(campaign: CampaignResults, content: Mapping[str, Any]) -> list[NextStep]:
    """A row for each of the first causes, and one for the runs without."""
    runs, why = content["runs"], content["why_failed"]
    if not runs["failed"]:
        return []
    steps = [
        NextStep(
            _count_of_failed(cause["runs"], runs["failed"]),
            _with_title(cause["title"], cause["text"]),
            cause["mend"],
            "failures",
            *_repeat(campaign, cause["run_ids"][0]),
        )
        for cause in _shown_causes(content)
    ]
    explained = _explained(why["causes"])
    without = [failure for failure in content["failures"] if failure["run_id"] not in explained]
    if without:
        what = _count_of_failed(len(without), runs["failed"])
        details = "".join(f"; {count} {detail}" for detail, count in detail_counts(without)[:2])
        first = _repeat(campaign, without[0]["run_id"])
        steps.append(NextStep(what, f"no cause was found{details}", "repeat one to look at it", "failures", *first))
    return steps


def _with_title(title: str, text: str) -> str:
    """Evidence of a cause after what it is evidence of, unless it begins with that."""
    return text if text.startswith(title) else f"{title}: {text}"


def _count_of_failed(count: int, failed: int) -> str:
    """How many of the failed runs, in words."""
    if count < failed:
        return f"{count} of {failed} failed runs"
    return "The failed run" if failed == 1 else "Both failed runs" if failed == 2 else f"All {failed} failed runs"


def _not_judged(content: Mapping[str, Any]) -> list[NextStep]:
    count = content["runs"]["not_judged"]
    if not count:
        return []
    change = (
        "raise duration_s beyond limits.arrive_by_s, or lower that, or set "
        'goal.phase = "none" if these runs have nowhere to arrive'
    )
    return [NextStep(f"{count} runs are not judged", "they end before limits.arrive_by_s", change, "failures")]


def _passive_safety(campaign: CampaignResults, content: Mapping[str, Any]) -> list[NextStep]:
    safety = content["safety"]
    found, steps = passive_safety_count(safety), []
    if found is not None and found[1]["count"]:
        horizon, proportion = found
        what = f"{proportion['count']} of {proportion['runs']} runs are not passively safe"
        why = f"after a loss of thrust they could drift into the keep-out sphere within {horizon}"
        why += without_drift_text(proportion)
        nearest = nearest_drift(safety)
        change = "accept the risk, or choose a passively safe orbit such as that of safety_ellipse"
        steps.append(
            NextStep(
                what, f"{why}{_after(nearest_text(safety, nearest))}", change, "safety", *_nearest(campaign, nearest)
            )
        )
    stuck = safety["stuck_on"]
    if (below := stuck["below_keep_out"]) is not None and below["count"]:
        which = "runs" if below["runs"] == ended_runs(content) else f"the {below['runs']} runs that burn"
        of = f"{below['count']} of {below['runs']} runs" if which == "runs" else f"{below['count']} of {which}"
        what = f"{of} are not safe from a burn that does not end"
        why = "after it they could drift into the keep-out sphere within 24 h"
        why += _after(nearest_text(safety, stuck["least_range"]))
        change = "consider how a stuck thruster is shut off"
        steps.append(NextStep(what, why, change, "safety", *_nearest(campaign, stuck["least_range"])))
    return steps


def _after(text: str) -> str:
    return f"; {text}" if text else ""


def _nearest(campaign: CampaignResults, nearest: Mapping[str, Any] | None) -> tuple[str, int | None]:
    """Command that repeats the run with the nearest drift, and its number; none without one."""
    return ("", None) if nearest is None else _repeat(campaign, nearest["run_id"])


def _violated(content: Mapping[str, Any], *, is_safety_told: bool) -> list[Mapping[str, Any]]:
    """Requirements that are violated, without those of passive safety where rows of their own tell of it."""
    return [
        entry
        for entry in content["requirements"]
        if entry["verdict"] == Verdict.NOT_VERIFIED
        and not (is_safety_told and str(entry["metric"]).startswith("passive_range"))
    ]


def _violations(
    campaign: CampaignResults, content: Mapping[str, Any], violated: Sequence[Mapping[str, Any]]
) -> list[NextStep]:
    """Rows of the requirements that other runs violate than the failed ones, which have rows of their own."""
    steps = []
    failed = {failure["run_id"] for failure in content["failures"]}
    for entry in violated:
        others = [run for run in entry["violating_ids"] if run not in failed]
        if not entry["violating_ids"] or (not others and len(entry["violating_ids"]) == entry["violations"]):
            continue
        what = f"Violated: {limit_text(entry)}"
        why = f"{violations_text(entry)}{_influence(content, entry)}"
        # The runs without a value, which failed, come first among them.
        beyond = entry["violating_ids"][entry["without_value"] :]
        run = ([run for run in beyond if run in others] or others or beyond or entry["violating_ids"])[0]
        change = "look at one of these runs, or relax the limit"
        steps.append(NextStep(what, why, change, "requirements", *_repeat(campaign, run)))
    return steps[:_MOST_VIOLATIONS]


def _consequences(
    campaign: CampaignResults, content: Mapping[str, Any], violated: Sequence[Mapping[str, Any]]
) -> list[NextStep]:
    """One row of the requirements that only runs with a cause in the rows above violate, with a value or without."""
    explained, found = _explained(_shown_causes(content)), []
    for entry in violated:
        violating = _violating(campaign, entry)
        if not entry["beyond_limit"] or not explained >= violating:
            continue
        found.append(f"{limit_text(entry)} ({entry['violations']} of {entry['runs']}, worst {worst_text(entry)})")
    if not found:
        return []
    what = "A requirement is violated, too" if len(found) == 1 else f"{len(found)} requirements are violated, too"
    why = f"{'; '.join(found)}: only by runs that failed by a cause above"
    return [NextStep(what, why, "follows from that cause: mend it first", "requirements")]


def _violating(campaign: CampaignResults, entry: Mapping[str, Any]) -> set[int]:
    """Numbers of all runs that violate a requirement, of which the entry names the first."""
    requirement = requirement_of(entry)
    values = required_values(requirement, campaign.metrics)
    of_these = counts(requirement, campaign.metrics, np.asarray(campaign.outcomes))
    return set(campaign.run_ids[violates(requirement, values) & of_these].tolist())


def _influence(content: Mapping[str, Any], entry: Mapping[str, Any]) -> str:
    """The dispersed input on which a requirement's metric depends most, beyond chance, or that none stands out.

    P-values are corrected for the number of inputs. Without them, as of a design with dependent runs, nothing is said.
    """
    name = entry.get("of", entry["metric"])
    ranked = next((each for each in content["sensitivity"] if each["metric"] == name), None)
    if ranked is None or any(one["spearman_p"] is None for one in ranked["inputs"]):
        return ""
    count = counted(len(ranked["inputs"]), "dispersed number")
    for measure, words in (("spearman", "rank correlation"), ("hsic", "no steady rise or fall, HSIC")):
        if leading := ranked[f"by_{measure}"]:
            most = next(one for one in ranked["inputs"] if one["name"] == leading[0])
            p = format_p_value(most[f"{measure}_p"])
            return f"; it depends most on {most['name']} ({words} {most[measure]:.2f}, p {p} among {count})"
    return f"; of {count} none stands out from chance"


def _more_runs(campaign: CampaignResults, content: Mapping[str, Any]) -> list[NextStep]:
    """Row of the requirements that more runs may verify; none while runs fail, which more runs do not mend."""
    undecided = [entry for entry in content["requirements"] if entry["verdict"] == Verdict.UNDECIDED]
    wanted = [entry["more_runs"] for entry in content["requirements"] if entry["more_runs"]]
    ended = ended_runs(content)
    if undecided and not content["runs"]["failed"]:
        runs = 2 * content["runs"]["requested"]
        command = shell_commands.more_runs_command(campaign, runs, int(campaign.info.get("seed", 0)) + 1)
        return [
            NextStep(
                f"{counted(len(undecided), 'requirement')} undecided",
                f"all {ended} runs of the plan were simulated",
                "plan a new campaign of more runs with another seed",
                "requirements",
                command,
            )
        ]
    if not wanted or content["runs"]["failed"] or ended < 2:
        return []
    runs = content["runs"]["requested"] + max(wanted)
    noun = "requirement needs" if len(wanted) == 1 else "requirements need"
    seed = int(campaign.info.get("seed", 0)) + 1
    command = shell_commands.more_runs_command(campaign, runs, seed)
    return [
        NextStep(
            f"{len(wanted)} {noun} more runs",
            f"{ended} runs are too few to verify what {'it demands' if len(wanted) == 1 else 'they demand'}",
            f"simulate at least {runs} as a new campaign with another seed",
            "requirements",
            command,
        )
    ]


def _consistency(campaign: CampaignResults, content: Mapping[str, Any]) -> list[NextStep]:
    """Row of an overconfident filter: that it follows from the causes of failure, else which beliefs are suspected."""
    entry = content["metrics"].get("nees_relative_mean")
    if not entry or entry["mean"] is None or entry["mean"] < _INCONSISTENT * _NEES_COMPONENTS:
        return []
    ratio = format_number(entry["mean"] / _NEES_COMPONENTS, 3)
    why = f"NEES / 6 of the relative state is {ratio} in the mean, and 1 is right"
    wrong = np.asarray(campaign.metrics["nees_relative_mean"]) > _INCONSISTENT * _NEES_COMPONENTS
    explained = _explained(_shown_causes(content))
    if wrong.any() and explained.issuperset(campaign.run_ids[wrong].tolist()):
        why += f"; only in {int(wrong.sum())} runs that failed, by a cause above"
        return [NextStep(_OVERCONFIDENT, why, "follows from that cause: mend it first", "consistency")]
    beliefs = [line.partition(":")[0] for line in content["warnings"] if "the filter believes" in line]
    change = "`rpojax robustness` tells which belief is narrowest"
    if beliefs:
        change = f"{' and '.join(beliefs)}, which the scenario contradicts (see its warnings)"
    return [NextStep(_OVERCONFIDENT, why, change, "consistency")]


def _shown_causes(content: Mapping[str, Any]) -> Sequence[Mapping[str, Any]]:
    """Causes of failures that have a row."""
    shown: Sequence[Mapping[str, Any]] = content["why_failed"]["causes"][:_MOST_CAUSES]
    return shown


def _explained(causes: Sequence[Mapping[str, Any]]) -> set[int]:
    """Numbers of the failed runs that have one of these causes."""
    return {run for cause in causes for run in cause["run_ids"]}


def _nothing(content: Mapping[str, Any]) -> NextStep:
    """Where nothing failed and nothing is open: the input on which the smallest margin depends."""
    weakest = weakest_requirement(content["requirements"])
    influence = "" if weakest is None else _influence(content, weakest)
    if weakest is None or not influence:
        return NextStep("Nothing failed and nothing is open", "", "read the worst run and the limits of use", "run")
    why = f"the smallest margin is that of {limit_text(weakest)}{influence}"
    return NextStep("Nothing failed and nothing is open", why, "", "sensitivity")
