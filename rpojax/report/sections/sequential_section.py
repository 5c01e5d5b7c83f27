"""Looks of a sequential campaign: what was planned, what was counted at each look, and what each look could decide."""

from collections.abc import Mapping, Sequence
from typing import Any

from rpojax.analysis.statistics.tolerance_verdicts import RequirementEvaluation
from rpojax.campaign.group_sequential_bounds import LookPath
from rpojax.campaign.sequential_looks import look_path
from rpojax.report.campaign_results import CampaignResults
from rpojax.scenario.schema import RequirementSection

LookRow = tuple[str, str, str, str, str]
"""Runs of the campaign, runs that count, violations, most that verify, and fewest that refute."""


def planned_looks(info: Mapping[str, Any]) -> list[int]:
    """Number of runs at each planned look; empty for a campaign with a fixed number of runs."""
    return list((info.get("sequential") or {}).get("looks", []))


def path_of(campaign: CampaignResults, requirement: RequirementSection) -> LookPath | None:
    """Runs and violations at the looks that were taken for a requirement; None with a fixed number of runs."""
    looks = planned_looks(campaign.info)
    if not looks:
        return None
    rows = campaign.run_ids - int(campaign.info.get("first_run", 0))
    return look_path(requirement, campaign.metrics, campaign.outcomes, rows, looks)


def entry(found: RequirementEvaluation, looks: Sequence[int]) -> dict[str, Any]:
    """Entry `sequential` of a requirement in report.json; empty with a fixed number of runs."""
    path, requirement = found.looks, found.requirement
    if path is None:
        return {}
    bounds = path.bounds(requirement.probability, requirement.consumer_risk)
    return {
        "sequential": {
            "planned_looks": len(looks),
            "at_most": looks[-1],
            "decided_at_look": None if found.decision is None else found.decision.look,
            "decided_at_runs": None if found.decision is None else looks[found.decision.look - 1],
            "runs": list(looks[: len(path.runs)]),
            "counted": list(path.runs),
            "violations": list(path.violations),
            "allowed": [bound.allowed for bound in bounds],
            "refuting": [bound.refuting for bound in bounds],
        }
    }


def decided_text(judged: Mapping[str, Any]) -> str:
    """The look that made a verdict, such as `at look 3 of 16, 192 runs`; empty if no look did."""
    found = judged.get("sequential")
    if found is None or found["decided_at_look"] is None:
        return ""
    return f"at look {found['decided_at_look']} of {found['planned_looks']}, {found['decided_at_runs']} runs"


def plan_sentence(requirements: Sequence[Mapping[str, Any]], ended: int) -> str:
    """How the campaign was planned and why it ended; empty with a fixed number of runs."""
    plans = [judged["sequential"] for judged in requirements if "sequential" in judged]
    if not plans:
        return ""
    taken, planned, most = len(plans[0]["runs"]), plans[0]["planned_looks"], plans[0]["at_most"]
    is_decided = all(plan["decided_at_look"] is not None for plan in plans)
    end = f"ended after look {taken} with {ended} runs, when every requirement was decided"
    if not is_decided:
        end = f"has taken {taken} of them, and not every requirement is decided"
    return (
        f"The campaign was planned with {planned} looks and at most {most} runs, and {end}. Verdicts, bounds and risks "
        "include all looks: the consumer\N{RIGHT SINGLE QUOTATION MARK}s risk bounds the probability that any of them "
        "verifies a design that just misses the requirement, and as large a risk that any refutes one that just keeps "
        "it. They are those of the plan, which campaign.json states, and not those of a fixed number of runs."
    )


def look_rows(judged: Mapping[str, Any]) -> list[LookRow]:
    """Rows of the table of looks at one requirement."""
    found = judged.get("sequential") or {"runs": [], "counted": [], "violations": [], "allowed": [], "refuting": []}
    columns = (found[name] for name in ("runs", "counted", "violations", "allowed", "refuting"))
    return [
        (str(runs), str(counted), str(count), _bound(allowed, "at most"), _bound(refuting, "at least"))
        for runs, counted, count, allowed, refuting in zip(*columns, strict=True)
    ]


def _bound(count: int | None, words: str) -> str:
    return "\N{EN DASH}" if count is None else f"{words} {count}"
