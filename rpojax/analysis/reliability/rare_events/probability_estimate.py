"""Estimate of a probability of failure, with its interval and its verdict on itself."""

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from scipy.stats import norm

from rpojax.optional_packages import require_package
from rpojax.summary_text import Summarised, Summary, counted

if TYPE_CHECKING:
    import pandas
Method = Literal["subset", "importance", "line", "plain"]
MethodChoice = Literal["auto", "subset", "importance", "line", "plain"]


@dataclass(frozen=True)
class LevelRecord:
    """A stage of an estimate.

    Attributes:
        name: what it did
        evaluations: of the limit state
        probability: conditional probability of the level, or estimate of the stage; None where it makes none
        threshold: margin at or below which the level lies; None where there is none
        acceptance: share of accepted moves of chains; None without chains
    """

    name: str
    evaluations: int
    probability: float | None = None
    threshold: float | None = None
    acceptance: float | None = None


@dataclass(frozen=True)
class DesignPoint:
    """A most likely point of failure in its surroundings.

    Attributes:
        x: (k,) standard normal numbers
        distance: from the origin [sigmas]
        share: of the probability that lies around it
    """

    x: np.ndarray
    distance: float
    share: float


@dataclass(frozen=True, repr=False)
class ProbabilityEstimate(Summarised):
    """Probability of failure.

    Attributes:
        probability: estimate, always a number
        interval_95: lower and upper end of its 95 % interval
        coefficient_of_variation: standard error over the estimate; infinite where no failure was found
        evaluations: points at which the limit state was evaluated
        method: that gave the estimate
        trusted: whether nothing speaks against the interval
        warnings: what speaks against it, and what else is to be known, in words
        reason: why the method was chosen, or that it was asked for
        effective_sample_size: independent failures that would give the same accuracy
        levels: stages of the estimate
        design_points: most likely points of failure, by their share
    """

    probability: float
    interval_95: tuple[float, float]
    coefficient_of_variation: float
    evaluations: int
    method: Method
    trusted: bool
    warnings: tuple[str, ...] = ()
    reason: str = ""
    effective_sample_size: float = 0.0
    levels: tuple[LevelRecord, ...] = field(default=(), repr=False)
    design_points: tuple[DesignPoint, ...] = field(default=(), repr=False)

    def _summary(self) -> Summary:
        low, high = self.interval_95
        rows = [("method", self.method + (f": {self.reason}" if self.reason else ""))]
        rows.append(("cost", counted(self.evaluations, "evaluation")))
        rows.append(("trusted", "yes" if self.trusted else "NO"))
        title = f"Probability of failure {self.probability:.3g}, 95 % interval {low:.2g} to {high:.2g}"
        return Summary(title, [*rows, *(("warning", each) for each in self.warnings)])

    def to_dict(self) -> dict[str, Any]:
        """Content in the types of JSON, where an infinite coefficient of variation is null."""
        cov = self.coefficient_of_variation
        return {
            "probability": self.probability,
            "interval_95": list(self.interval_95),
            "coefficient_of_variation": cov if math.isfinite(cov) else None,
            "evaluations": self.evaluations,
            "method": self.method,
            "trusted": self.trusted,
            "warnings": list(self.warnings),
            "reason": self.reason,
            "effective_sample_size": self.effective_sample_size,
            "levels": [vars(level) for level in self.levels],
            "design_points": [
                {"x": point.x.tolist(), "distance_sigmas": point.distance, "share": point.share}
                for point in self.design_points
            ],
        }

    def to_dataframe(self) -> "pandas.DataFrame":
        """Stages of the estimate, one row each, with the fields of `LevelRecord`.

        Raises:
            MissingExtraError: pandas is not installed.
        """
        return require_package("pandas").DataFrame([vars(level) for level in self.levels])


def log_normal_interval(probability: float, variation: float, confidence: float = 0.95) -> tuple[float, float]:
    """Interval of a positive estimate with a coefficient of variation, symmetric in its logarithm."""
    reach = float(norm.ppf(0.5 + 0.5 * confidence)) * math.sqrt(math.log1p(variation**2))
    return probability * math.exp(-reach), min(1.0, probability * math.exp(reach))
