"""Which source makes how much of the error: the shares of a linear covariance, at the end and where each is worst."""

from dataclasses import dataclass

import numpy as np

from rpojax.analysis.linear_covariance.linear_covariance import LinearCovariance
from rpojax.analysis.linear_covariance.linearised_loop import OUTPUTS

ERRORS = {"formation error": "rho_H", "relative estimation error": "relative_error_H"}
"""What the budget is of, three axes together."""


@dataclass(frozen=True)
class ErrorBudget:
    """Standard deviations [m] of the three axes together, by error and source.

    Attributes:
        at_end: that each source alone leaves at the last look
        total_at_end: of all sources
        at_worst: that each source leaves when it leaves most
        worst_at_s: when that is
    """

    at_end: dict[str, dict[str, float]]
    total_at_end: dict[str, float]
    at_worst: dict[str, dict[str, float]]
    worst_at_s: dict[str, dict[str, float]]


def error_budget(linear: LinearCovariance) -> ErrorBudget:
    """The budget of a linear covariance."""
    at_end, total, at_worst, worst_at = {}, {}, {}, {}
    for title, output in ERRORS.items():
        # Rounding can leave a share of nothing below zero.
        sigma = np.sqrt(np.maximum(linear.shares[:, :, OUTPUTS[output]].sum(axis=2), 0.0))
        at_end[title] = dict(zip(linear.sources, sigma[-1].tolist(), strict=True))
        total[title] = float(np.sqrt(np.sum(sigma[-1] ** 2)))
        at_worst[title] = dict(zip(linear.sources, sigma.max(axis=0).tolist(), strict=True))
        when = linear.share_time_s[sigma.argmax(axis=0)]
        worst_at[title] = dict(zip(linear.sources, when.tolist(), strict=True))
    return ErrorBudget(at_end, total, at_worst, worst_at)
