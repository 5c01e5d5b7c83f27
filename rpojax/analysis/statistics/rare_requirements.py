"""Requirements that plain runs cannot verify in practice: runs they would take, and the command that verifies them."""

from pathlib import Path
from typing import Final

from rpojax.analysis.statistics import tolerance_bounds
from rpojax.metrics import metric_catalogue
from rpojax.scenario.plugins.command_lines import command_line

RARE: Final = 1e-3
"""Allowed probability of failure below which a requirement counts as rare."""

ESTIMATED_SOURCES: Final = ("records", "drifts", "plugin")
"""Sources of metrics whose probabilities of failure can be estimated."""


def is_rare(probability: float) -> bool:
    """Whether this required probability of success allows less than one failure in a thousand runs."""
    return 1.0 - probability < RARE


def plain_runs(probability: float, consumer_risk: float) -> int:
    """Number of runs, none in violation, that verifies a required probability of success at a consumer's risk."""
    return tolerance_bounds.runs_for_bound(probability, 1.0 - consumer_risk)


def can_be_estimated(metric: str, servicers: int) -> bool:
    """Whether the probability that a metric breaks its limit can be estimated; not for teams, coverage or phases."""
    found = metric_catalogue.find(metric)
    return not servicers and found is not None and found.source in ESTIMATED_SOURCES and "," not in metric


def command(scenario: Path, metric: str, out: Path, plugin: str | None) -> str:
    """Command that estimates the probability of violations of a requirement of a scenario file."""
    return command_line("probability", scenario, "--requirement", metric, "--out", out, plugin=plugin)
