"""Why runs failed: causes with evidence, ranked by the runs that they explain, in one sentence and by run."""

from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np

from rpojax.analysis.failure_causes import ranking
from rpojax.analysis.failure_causes.finding import Finding
from rpojax.analysis.failure_causes.present_values import with_present_values
from rpojax.analysis.failure_causes.run_evidence import RunEvidence
from rpojax.campaign.storage.atomic_outputs import to_json_types
from rpojax.errors import ScenarioError
from rpojax.flight.mission.mission_state import AbortReason
from rpojax.report.campaign_results import CampaignResults
from rpojax.report.labels import format_number
from rpojax.report.sections import phase_visits, team_section
from rpojax.scenario.loading import scenario_loader
from rpojax.scenario.schema import ScenarioFile
from rpojax.scenario.team.members import member_files
from rpojax.simulation.outcomes.outcome_kinds import Outcome

NO_CAUSE: Final = {"cause": "", "cause_text": ""}
"""Of a failed run without a cause."""
_IN_SENTENCE: Final = 3
"""Most causes of the sentence."""


def content(campaign: CampaignResults) -> dict[str, Any]:
    """Part of report.json: failed runs, causes with evidence in two numbers and what would mend it, and those without.

    Of a team each servicer that failed is looked at; a run has the cause of the first of them that has one.
    """
    failed = int(np.sum(campaign.failed))
    found: list[dict[str, Any]] = []
    if failed:
        names = list(campaign.servicer_names)
        for results, file, name in _servicers(campaign, names):
            found += _causes(results, file, name, np.asarray(campaign.failed))
    explained: set[int] = set()
    for each in found:
        each["run_ids"] = [run for run in each["run_ids"] if run not in explained]
        explained.update(each["run_ids"])
        each["runs"] = len(each["run_ids"])
    kept = sorted((each for each in found if each["runs"]), key=lambda each: -each["runs"])
    result = {"failed": failed, "runs": len(campaign.run_ids), "causes": kept, "without": failed - len(explained)}
    return to_json_types({**result, "sentence": sentence(result)})


def without_texts(found: Mapping[str, Any]) -> dict[str, Any]:
    """The content without the texts of single runs, which stand with the failed runs."""
    return {
        **found,
        "causes": [{name: value for name, value in each.items() if name != "texts"} for each in found["causes"]],
    }


def texts_of_runs(found: Mapping[str, Any]) -> dict[int, dict[str, str]]:
    """`cause` and `cause_text` of each run that has a cause, by its number."""
    return {
        run: {"cause": each["name"], "cause_text": each["texts"][str(run)]}
        for each in found["causes"]
        for run in each["run_ids"]
    }


def abort_details(campaign: CampaignResults) -> dict[int, str]:
    """Reason, phase and time of the abort of each run that failed by it, by its number."""
    aborted = np.flatnonzero(np.asarray(campaign.outcomes) == Outcome.ABORTED)
    found: dict[int, list[str]] = {}
    names = list(campaign.servicer_names)
    for number, name in enumerate(names or [""]):
        results = team_section.of_servicer(campaign, number) if names else campaign
        if not results.phases:
            continue
        visits = phase_visits.phase_visits(results.phases)
        before, reasons = visits.phase_before_abort(), results.phases["abort_reason"]
        began = np.min(
            np.where(visits.phase == len(results.phase_names) - 1, visits.begin_s, np.inf), axis=1, initial=np.inf
        )
        for row in aborted.tolist():
            if reasons[row]:
                where = f" in {results.phase_names[before[row]]}" if before[row] >= 0 else ""
                text = f"{AbortReason(int(reasons[row])).text}{where} at {format_number(float(began[row]))} s"
                found.setdefault(int(campaign.run_ids[row]), []).append(f"{name} {text}".strip())
    return {run: "; ".join(texts) for run, texts in found.items()}


def rows(found: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Rows of the page's table: cause, runs, evidence, what mends it, since when, and the first run that shows it."""
    return [{**each, "since": format_number(each["at_s"]), "first": each["run_ids"][0]} for each in found["causes"]]


def _servicers(campaign: CampaignResults, names: Sequence[str]) -> list[tuple[CampaignResults, ScenarioFile, str]]:
    """Results, scenario and name of each servicer; none where this version does not accept the scenario."""
    try:
        file = scenario_loader.validate_recorded(campaign.info.get("scenario", {}))
    except ScenarioError:
        return []
    if not names:
        return [(campaign, file, "")]
    members = member_files(file)
    return [(team_section.of_servicer(campaign, number), members[number], name) for number, name in enumerate(names)]


def evidence_of(campaign: CampaignResults, file: ScenarioFile) -> RunEvidence:
    """What the rules read of the results of one servicer."""
    return RunEvidence(
        file=file,
        outcomes=np.asarray(campaign.outcomes),
        failed_at_s=np.asarray(campaign.failed_at_s, dtype=float),
        metrics=campaign.metrics,
        drawn=campaign.drawn,
        time_s=np.asarray(campaign.trace_time_s, dtype=float),
        traces=campaign.traces,
        signs=campaign.signs,
        phases=campaign.phases,
    )


def _causes(campaign: CampaignResults, file: ScenarioFile, servicer: str, failed: np.ndarray) -> list[dict[str, Any]]:
    with np.errstate(invalid="ignore", divide="ignore"):
        ranked = ranking.causes(evidence_of(campaign, file))
        found = []
        for place, finding in enumerate(ranked.findings):
            chosen = ranked.explained_by(place) & failed
            if not chosen.any():
                continue
            begin = f"{servicer}: " if servicer else ""
            times = finding.at_s[chosen & np.isfinite(finding.at_s)]
            found.append(
                {
                    "name": finding.name,
                    "title": begin + finding.title,
                    "text": begin + finding.evidence(chosen),
                    "mend": with_present_values(file, finding.mend(chosen)),
                    "at_s": float(np.median(times)) if len(times) else None,
                    "run_ids": campaign.run_ids[chosen].tolist(),
                    "texts": {
                        str(campaign.run_ids[row]): _of_run(finding, begin, row, chosen)
                        for row in np.flatnonzero(chosen).tolist()
                    },
                }
            )
    return found


def _of_run(finding: Finding, begin: str, row: int, chosen: np.ndarray) -> str:
    only = np.zeros(len(chosen), dtype=bool)
    only[row] = True
    return begin + finding.evidence(only)


def sentence_of_run(found: Mapping[str, Any]) -> str:
    """Why the only run failed and what would mend it, in a sentence; empty if it did not or no cause was found."""
    if not found["causes"]:
        return ""
    first = found["causes"][0]
    text = f"{first['text']}; {first['mend']}" if first["mend"] else str(first["text"])
    return f"{text[:1].upper()}{text[1:]}."


def sentence(found: Mapping[str, Any]) -> str:
    """How many runs failed, and why, in a sentence; empty if none did."""
    failed = found["failed"]
    if not failed:
        return ""
    parts = []
    for place, each in enumerate(found["causes"][:_IN_SENTENCE]):
        mend = f"; {each['mend']}" if each["mend"] and place == 0 else ""
        begin = f"in all {failed}" if each["runs"] == failed > 1 else f"in {each['runs']}"
        parts.append(f"{begin} {each['text']}{mend}")
    more = sum(each["runs"] for each in found["causes"][_IN_SENTENCE:])
    if more:
        parts.append(f"{more} for {len(found['causes']) - _IN_SENTENCE} other reasons")
    if found["without"]:
        parts.append(f"no cause was found in {found['without']}")
    return f"{failed} of {found['runs']} failed: {'; '.join(parts)}."
