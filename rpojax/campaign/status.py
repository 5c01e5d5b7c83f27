"""Status of a campaign from its manifests alone: fast, also while other processes write, and free of jax."""

from dataclasses import asdict
from pathlib import Path
from typing import Any

from rpojax.campaign.storage import block_manifests, campaign_configuration, look_records, lost_results
from rpojax.campaign.storage.campaign_configuration import CampaignConfiguration
from rpojax.simulation.outcomes.outcome_kinds import Outcome


def status(directory: Path) -> dict[str, Any]:
    """Blocks and runs done and missing, failures by reason, speed, and the path of the report, None without one.

    A block of which a file is missing or cut short counts as missing; `lost` has one such file of each.

    Raises:
        ResultError: the folder is no campaign, or one of its manifests cannot be read.
    """
    configuration = campaign_configuration.read(directory)
    blocks = configuration.block_count
    finished = block_manifests.finished_blocks(directory, blocks)
    manifests = dict(zip(finished, block_manifests.read_all(directory, configuration, finished), strict=True))
    lost = lost_results.lost_blocks(directory, configuration, manifests)
    entries = [entry for block, entry in manifests.items() if block not in lost]
    page = directory / "report.html"
    ended = sum(entry.count for entry in entries)
    reasons = block_manifests.count_failure_reasons(entries)
    completed = sum(entry.completed for entry in entries)
    failed = sum(entry.failed for entry in entries)
    not_judged = ended - completed - failed
    outcomes = {str(kind): reasons.get(kind.reason, 0) for kind in Outcome}
    outcomes |= {str(Outcome.COMPLETED): completed, str(Outcome.NOT_JUDGED): not_judged}
    attempts = block_manifests.attempts_at_unfinished_blocks(directory, blocks)
    return {
        "directory": str(directory),
        "name": configuration.name,
        "blocks": {"total": blocks, "done": len(entries), "missing": blocks - len(entries)},
        "runs": {
            "requested": configuration.runs,
            "completed": completed,
            "failed": failed,
            "not_judged": not_judged,
            "missing": configuration.runs - ended,
            "outcomes": outcomes,
        },
        "reasons": reasons,
        "lost": [{"block": block, "file": str(file.path), "found": file.words} for block, file in lost.items()],
        "begun": [{"block": block, "attempts": count} for block, count in attempts.items()],
        **_sequential(directory, configuration),
        "timing": block_manifests.timing(entries, _duration_s(configuration.scenario)),
        "report": str(page) if page.is_file() else None,
    }


def _sequential(directory: Path, configuration: CampaignConfiguration) -> dict[str, Any]:
    """Entry on the looks of a sequential campaign; none for any other."""
    plan = configuration.options.plan
    if plan is None:
        return {}
    looks = look_records.read(directory, configuration.seal)
    return {
        "sequential": {
            "looks": {"planned": len(plan.looks), "taken": len(looks)},
            "at_most": plan.looks[-1],
            "decided_at": configuration.ended_at,
            "requirements": [asdict(each) for each in looks[-1].requirements] if looks else [],
        }
    }


def _duration_s(scenario: dict[str, Any]) -> float:
    found = scenario.get("duration_s", 0.0)
    return float(found) if isinstance(found, int | float) else 0.0
