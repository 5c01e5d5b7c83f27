"""Causes of failed runs, contrasted with completed ones and ranked by the number of runs that they explain."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from rpojax.analysis.failure_causes import camera_rules, mission_rules, navigation_rules, vehicle_rules
from rpojax.analysis.failure_causes.finding import Finding
from rpojax.analysis.failure_causes.run_evidence import Flags, Numbers, RunEvidence

RULES: Final = (vehicle_rules, camera_rules, navigation_rules, mission_rules)
"""Modules with rules."""
_MORE_OFTEN: Final = 0.3
"""By how much more often failed runs must show a cause than completed ones."""
_SEPARATED: Final = 0.8
"""Probability that a failed run shows it more strongly than a completed one, from which that is enough as well."""
_MANY_FAIL: Final = 0.25
"""Share of failed runs from which on what acts in all runs can be their cause."""
_FAR_BEYOND: Final = 1.9
"""Strength from which on it can be."""
_NEARLY_ALL: Final = 0.75
"""Share of the failed runs that must show it so strongly."""
_EARLY: Final = 4.0
"""Weight of the time at which a cause acts, over that of how common and how strong it is."""
_UNKNOWN: Final = 1.5
"""Time over the latest one that an unknown time counts as: neither common nor strong causes make up for it."""
_LONG_AFTER_S: Final = 600.0
"""Time after a loss of the target from which on what may follow from it is no cause of it [s]: a window of shares."""
_STRONGEST: Final = 4.0
"""Strength beyond which a cause is not stronger."""


@dataclass(frozen=True)
class RankedCauses:
    """Causes by the number of failed runs that they explain, most first.

    Attributes:
        findings: causes that explain a run
        cause: (runs,) place of each run's cause in `findings`, -1 for none
    """

    findings: Sequence[Finding]
    cause: np.ndarray

    def explained_by(self, place: int) -> Flags:
        """(runs,) whether a run is explained by the cause at that place."""
        return np.asarray(self.cause == place)


def all_findings(evidence: RunEvidence) -> list[Finding]:
    """What every rule finds in the runs of one servicer."""
    return [finding for module in RULES for finding in module.findings(evidence)]


def causes(evidence: RunEvidence) -> RankedCauses:
    """Causes of the failed runs of one servicer, those that explain most of them first."""
    return ranked_causes(all_findings(evidence), evidence.failed, evidence.completed)


def ranked_causes(findings: Sequence[Finding], failed: Flags, completed: Flags) -> RankedCauses:
    """Each failed run goes to the cause farthest back that it shows, of several to the most common and strongest.

    What completed runs show as much is no cause.
    """
    lost_s = _lost_s(findings, len(failed))
    before = [_without_followers(each, lost_s) for each in findings]
    known = [each for each in before if is_contrasted(each, failed, completed)]
    duration_s = _latest_s(known)
    cause = np.full(len(failed), -1)
    scores = np.array([_scores(each, failed, duration_s) for each in known]).reshape(len(known), len(failed))
    if known:
        best = np.argmax(scores, axis=0)
        cause = np.where(failed & (scores.max(axis=0) > -np.inf), best, -1)
    counts = [int(np.sum(cause == place)) for place in range(len(known))]
    order = sorted((place for place in range(len(known)) if counts[place]), key=lambda place: -counts[place])
    places = np.full(len(known) + 1, -1)
    places[order] = np.arange(len(order))
    return RankedCauses([known[place] for place in order], places[cause])


def is_contrasted(finding: Finding, failed: Flags, completed: Flags) -> bool:
    """Whether failed runs show a cause, and more often or more strongly than completed runs do.

    What acts in all runs cannot be contrasted: it is a cause where it is far beyond its threshold and many runs fail.
    """
    shown = finding.shown
    if not (shown & failed).any():
        return False
    if not (shown & completed).any():
        return True
    if np.mean(failed) >= _MANY_FAIL and np.mean(finding.strength[failed] >= _FAR_BEYOND) >= _NEARLY_ALL:
        return True
    more_often = np.mean(shown[failed]) - np.mean(shown[completed])
    return bool(more_often >= _MORE_OFTEN or _separation(finding, failed & shown, completed) >= _SEPARATED)


def _separation(finding: Finding, failed: Flags, completed: Flags) -> float:
    """Probability that a failed run shows a cause more strongly than a completed one; ties count half."""
    here, there = finding.strength[failed][:, None], finding.strength[completed][None, :]
    return float(np.mean((here > there) + 0.5 * (here == there)))


def _lost_s(findings: Sequence[Finding], runs: int) -> Numbers:
    """(runs,) when the target was lost first [s], infinite if it was not."""
    times = [np.where(each.shown & np.isfinite(each.at_s), each.at_s, np.inf) for each in findings if each.is_loss]
    return np.min([np.full(runs, np.inf), *times], axis=0)


def _without_followers(finding: Finding, lost_s: Numbers) -> Finding:
    """A finding without the runs in which it follows from a loss of the target (runs,) [s]."""
    if not finding.may_follow:
        return finding
    return replace(finding, strength=np.where(finding.at_s > lost_s + _LONG_AFTER_S, 0.0, finding.strength))


def _latest_s(findings: Sequence[Finding]) -> float:
    """Latest time at which a cause acts [s], at least 1 s."""
    times = np.concatenate([np.ones(1), *(each.at_s for each in findings)])
    return float(times[np.isfinite(times)].max())


def _scores(finding: Finding, failed: Flags, duration_s: float) -> Numbers:
    """(runs,) how well a cause explains a run: how far back it lies, how early it acts, how common and strong it is.

    Minus infinity if it is not shown; a cause whose time is unknown comes after all others.
    """
    common = np.mean(finding.shown[failed])
    strength = np.minimum(finding.strength, _STRONGEST) / _STRONGEST
    late = np.nan_to_num(finding.at_s / duration_s, nan=_UNKNOWN, posinf=1.0)
    return np.where(finding.shown, -10.0 * finding.depth - _EARLY * late + common + strength, -np.inf)
