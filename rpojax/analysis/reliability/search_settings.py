"""Options of searches for worst cases and of estimates of probabilities. Free of jax and numpy."""

from dataclasses import dataclass
from typing import Annotated, Literal

from tyro.conf import Fixed, arg


@dataclass(frozen=True)
class LimitChoice:
    """Choice of the limit to search: that of a requirement of the scenario, or another limit of a metric.

    Attributes:
        requirement: metric of one of the scenario's requirements
        metric: another metric, in place of `requirement`
        limit: of `metric`, in its unit
        bound: side of `limit` on which the metric must stay, 'at most' or 'at least'; None for as the metric is worse
    """

    requirement: Annotated[
        str | None, arg(metavar="METRIC", help="Metric of a requirement of the scenario; or give --metric.")
    ] = None
    metric: Annotated[str | None, arg(metavar="METRIC", help="Another metric, with --limit.")] = None
    limit: Annotated[float | None, arg(metavar="X", help="Limit of --metric, in its unit.")] = None
    bound: Annotated[
        str | None, arg(metavar="SIDE", help="'at most' or 'at least'; by default as the metric is worse.")
    ] = None


@dataclass(frozen=True)
class SearchSettings:
    """Effort of a search.

    Attributes:
        starts: searches at a time
        screening_points: random points; the searches start at the best of them
        budget: greatest total cost, in margins
        max_distance: largest distance from the origin of a point [sigmas]
    """

    starts: Annotated[int, arg(metavar="N", help="Searches at a time, each with the noise of another run.")] = 4
    screening_points: Fixed[int] = 16
    budget: Annotated[float, arg(metavar="N", help="Greatest cost of the search, in runs.")] = 400.0
    max_distance: Fixed[float] = 6.0


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
