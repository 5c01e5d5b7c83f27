"""Requirements that plain runs cannot verify in practice: how many they would take, and the command that does."""

from typing import Final

from rpojax.analysis.statistics.intervals import order_statistics

RARE: Final = 1e-3
"""Probability of failure below which a requirement counts as rare."""


def is_rare(probability: float) -> bool:
    """Whether a requirement with this least probability of success allows fewer failures than one in a thousand."""
    return 1.0 - probability < RARE


def plain_runs(probability: float, consumer_risk: float) -> int:
    """Runs without a violation that verify a least probability of success at a consumer's risk."""
    return order_statistics.runs_for_bound(probability, 1.0 - consumer_risk)


def command(scenario: str, metric: str, out: str) -> str:
    """Command that estimates the probability of violations of a requirement."""
    return f"rpojax probability {scenario} --requirement {metric} --out {out}"
