"""Which runs count for a requirement, which of these violate it, and by how much."""

from collections.abc import Mapping

import numpy as np

from rpojax.scenario.schema import RequirementSection


def worse_sign(requirement: RequirementSection) -> float:
    """1 where high values violate a requirement, else -1."""
    return 1.0 if requirement.bound == "at most" else -1.0


def severity_of(requirement: RequirementSection, values: np.ndarray) -> np.ndarray:
    """Values with the sign by which more is worse; infinite for runs that have none."""
    return np.where(np.isfinite(values), worse_sign(requirement) * values, np.inf)


def violates(requirement: RequirementSection, values: np.ndarray) -> np.ndarray:
    """Flags (n,) of runs that violate a requirement: metric `values` (n,) beyond the limit, or undefined."""
    return severity_of(requirement, values) > worse_sign(requirement) * requirement.limit


def is_of_outcome(requirement: RequirementSection, outcomes: np.ndarray) -> np.ndarray:
    """Flags (n,) of runs with the outcome that a requirement names; all runs if it names none."""
    return np.full(len(outcomes), True) if requirement.outcome is None else outcomes == requirement.outcome


def reaches(requirement: RequirementSection, metrics: Mapping[str, np.ndarray]) -> np.ndarray | None:
    """Flags (n,) of runs that once were in a requirement's phase or at its event; None for one without a phase."""
    if requirement.phase is None:
        return None
    presence = metrics[requirement.window.presence_name]
    return np.isfinite(presence) if requirement.at is not None else presence > 0.0


def counts(requirement: RequirementSection, metrics: Mapping[str, np.ndarray], outcomes: np.ndarray) -> np.ndarray:
    """Flags (n,) of runs that count for a requirement: they have its outcome and, if it demands so, reach its phase."""
    reached = reaches(requirement, metrics) if requirement.is_of_reaching_runs else None
    of_outcome = is_of_outcome(requirement, outcomes)
    return of_outcome if reached is None else of_outcome & reached


def required_values(requirement: RequirementSection, metrics: Mapping[str, np.ndarray]) -> np.ndarray:
    """Values (n,) of a requirement's metric; NaN, which violates it, for runs that never came to its phase or event."""
    values, reached = np.asarray(metrics[requirement.metric_name], np.float64), reaches(requirement, metrics)
    return values if reached is None else np.where(reached, values, np.nan)
