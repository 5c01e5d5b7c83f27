"""Options of an estimate of the probability of failure, free of jax and numpy."""

from dataclasses import dataclass
from typing import Annotated, Literal

from tyro.conf import arg

Bound = Literal["at most", "at least"]


@dataclass(frozen=True)
class FailureChoice:
    """Which runs count as failures: those that break a requirement or a limit of a metric, or end with an outcome.

    Attributes:
        requirement: metric of one of the scenario's requirements
        metric: another metric, in place of `requirement`
        limit: of `metric`, in its unit
        bound: side of `limit` on which the metric must stay
        outcome: outcome of a run, in place of a metric
    """

    requirement: Annotated[
        str | None,
        arg(metavar="METRIC", help="Metric of a requirement of the scenario; or give --metric or --outcome."),
    ] = None
    metric: Annotated[str | None, arg(metavar="METRIC", help="Another metric, with --limit.")] = None
    limit: Annotated[float | None, arg(metavar="X", help="Limit of --metric, in its unit.")] = None
    bound: Annotated[
        str | None, arg(metavar="SIDE", help="'at most' or 'at least'; by default as the metric is worse.")
    ] = None
    outcome: Annotated[str | None, arg(metavar="OUTCOME", help="Outcome of a run, such as keep_out.")] = None


@dataclass(frozen=True)
class EstimateSettings:
    """How a probability is estimated.

    Attributes:
        budget: most runs to simulate
        method: 'auto', 'subset', 'importance', 'line' or 'plain'
    """

    budget: Annotated[int, arg(metavar="N", help="Most runs to simulate.")] = 10_000
    method: Annotated[
        Literal["auto", "subset", "importance", "line", "plain"],
        arg(metavar="METHOD", help="auto, subset, importance, line or plain."),
    ] = "auto"
