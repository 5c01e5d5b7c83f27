"""Error budget of a linear covariance: the contribution of each source at the end, and at its greatest."""

from dataclasses import dataclass

import numpy as np

from rpojax.analysis.linear_covariance.covariance_history import LinearCovariance
from rpojax.analysis.linear_covariance.linearisation.linearised_loop import OUTPUTS

ERRORS = {"formation error": "rho_H", "relative estimation error": "relative_error_H"}
"""Outputs of the budget by title, three axes together."""


@dataclass(frozen=True)
class ErrorBudget:
    """Standard deviations [m] of the three axes together, by error and source.

    Attributes:
        at_end: by each source alone, at the end
        total_at_end: by all sources
        at_worst: greatest by each source alone
        worst_at_s: time of it [s]
    """

    at_end: dict[str, dict[str, float]]
    total_at_end: dict[str, float]
    at_worst: dict[str, dict[str, float]]
    worst_at_s: dict[str, dict[str, float]]


def error_budget(linear: LinearCovariance) -> ErrorBudget:
    """Error budget of a linear covariance."""
    at_end, total, at_worst, worst_at = {}, {}, {}, {}
    for title, output in ERRORS.items():
        # Rounding can leave a share of zero slightly negative.
        sigma = np.sqrt(np.maximum(linear.shares[:, :, OUTPUTS[output]].sum(axis=2), 0.0))
        at_end[title] = dict(zip(linear.sources, sigma[-1].tolist(), strict=True))
        total[title] = float(np.sqrt(np.sum(sigma[-1] ** 2)))
        at_worst[title] = dict(zip(linear.sources, sigma.max(axis=0).tolist(), strict=True))
        when = linear.share_time_s[sigma.argmax(axis=0)]
        worst_at[title] = dict(zip(linear.sources, when.tolist(), strict=True))
    return ErrorBudget(at_end, total, at_worst, worst_at)
