"""Causes of the failed runs of one servicer, by all rules."""

from rpojax.analysis.failure_causes import camera_rules, mission_rules, navigation_rules, vehicle_rules
from rpojax.analysis.failure_causes.finding import Finding
from rpojax.analysis.failure_causes.ranking import RankedCauses, ranked_causes
from rpojax.analysis.failure_causes.run_evidence import RunEvidence

RULES = (vehicle_rules, camera_rules, navigation_rules, mission_rules)
"""Modules with rules."""


def all_findings(evidence: RunEvidence) -> list[Finding]:
    """What every rule finds in the runs."""
    return [finding for module in RULES for finding in module.findings(evidence)]


def causes(evidence: RunEvidence) -> RankedCauses:
    """Causes of the failed runs, those that explain most of them first."""
    return ranked_causes(all_findings(evidence), evidence.failed, evidence.completed)
