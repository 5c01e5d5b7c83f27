"""Which failure options name, and what is refused."""

import pytest

from rpojax.analysis.reliability.simulated_failures.estimate_options import FailureChoice
from rpojax.analysis.reliability.simulated_failures.failure_choice import choose_failure
from rpojax.errors import RpojaxError
from rpojax.scenario.loading import scenario_loader
from rpojax.scenario.schema import ScenarioFile
from rpojax.simulation.outcomes.outcome_kinds import Outcome


@pytest.fixture(scope="module")
def mission() -> ScenarioFile:
    """The nominal mission."""
    return scenario_loader.load("inspection")


def test_a_requirement_gives_bound_limit_and_probability(mission: ScenarioFile) -> None:
    found = choose_failure(mission, FailureChoice(requirement="min_range_m"))
    assert (found.metric, found.bound, found.limit, found.required_probability) == (
        "min_range_m",
        "at least",
        15.0,
        0.99,
    )


def test_the_side_of_a_limit_is_that_on_which_the_metric_is_worse(mission: ScenarioFile) -> None:
    assert choose_failure(mission, FailureChoice(metric="min_range_m", limit=12.0)).bound == "at least"
    assert choose_failure(mission, FailureChoice(metric="delta_v_m_s", limit=0.4)).bound == "at most"
    assert choose_failure(mission, FailureChoice(metric="delta_v_m_s", limit=0.4, bound="at least")).bound == "at least"


def test_an_outcome_is_a_failure(mission: ScenarioFile) -> None:
    found = choose_failure(mission, FailureChoice(outcome="keep_out"))
    assert found.outcome is Outcome.KEEP_OUT
    assert found.words == "outcome keep_out"


@pytest.mark.parametrize(
    ("choice", "named"),
    [
        (FailureChoice(), "requirement, metric, outcome"),
        (FailureChoice(metric="min_range_m", outcome="keep_out", limit=1.0), "requirement, metric, outcome"),
        (FailureChoice(requirement="delta_v_m_s"), "requirement"),
        (FailureChoice(requirement="min_range_m", limit=3.0), "limit"),
        (FailureChoice(metric="min_range_m"), "limit"),
        (FailureChoice(metric="min_range_m", limit=1.0, bound="below"), "bound"),
        (FailureChoice(metric="nothing", limit=1.0), "metric"),
        (FailureChoice(outcome="completed"), "outcome"),
        (FailureChoice(outcome="not_judged"), "outcome"),
        (FailureChoice(outcome="unfinished"), "outcome"),  # of a mission without phases
    ],
)
def test_options_that_name_no_failure_are_refused(mission: ScenarioFile, choice: FailureChoice, named: str) -> None:
    with pytest.raises(RpojaxError, match=f"^{named}: found"):
        choose_failure(mission, choice)
