"""Limits of metrics: margins, and what names no limit."""

import math
from typing import Any

import numpy as np
import pytest

from rpojax.analysis.reliability import simulated_limit_state
from rpojax.analysis.reliability.search_settings import FailureChoice, LimitChoice
from rpojax.analysis.reliability.simulated_failures.failure_margin import choose_failure
from rpojax.analysis.reliability.simulated_limit_state import MetricLimit
from rpojax.errors import RpojaxError
from rpojax.scenario.loading import scenario_loader
from rpojax.scenario.schema import ScenarioFile


@pytest.fixture(scope="module")
def mission() -> ScenarioFile:
    """The nominal mission with all its dispersions."""
    return scenario_loader.load("inspection")


def test_margins_convert_back_to_values() -> None:
    for limit in (MetricLimit("delta_v_m_s", "at most", 2.0), MetricLimit("min_range_m", "at least", 2.0)):
        for value in (1.5, 2.0, 2.5):
            margin = float(limit.margins(np.array([value]))[0])
            assert limit.value_at_margin(margin) == pytest.approx(value)
            assert (margin <= 0.0) == limit.is_violated(value)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((None, None, None), "requirement, metric: found neither, expected one of the two"),
        (("min_range_m", "min_range_m", 1.0), "requirement, metric: found both, expected one of the two"),
        (("min_range_m", None, 1.0), "limit: found 1.0, expected it with metric only"),
        (("delta_v_m_s", None, None), "requirement: found 'delta_v_m_s', expected one of the scenario's: form"),
        (("look_away_peak_s", None, None), "requirement: found 'look_away_peak_s', expected a metric with a deriv"),
        ((None, "minimum_range", 1.0), "metric: found 'minimum_range', expected a metric: formation_error_rms_m, "),
        ((None, "detection_rate", 1.0), "metric: found 'detection_rate', expected a metric with a derivative: "),
        ((None, "min_range_m", None), "limit: found None, expected a number, with metric"),
        ((None, "min_range_m", math.nan), "limit: found nan, expected a number, with metric"),
    ],
)
def test_options_that_name_no_limit_are_refused(mission: ScenarioFile, arguments: Any, message: str) -> None:
    with pytest.raises(RpojaxError) as error:
        simulated_limit_state.select_limit(mission, LimitChoice(*arguments))
    assert str(error.value).startswith(message)


def test_a_bound_that_is_no_side_is_refused(mission: ScenarioFile) -> None:
    with pytest.raises(RpojaxError, match=r"^bound: found 'below', expected 'at most' or 'at least'$"):
        simulated_limit_state.select_limit(mission, LimitChoice(None, "min_range_m", 3.0, "below"))


@pytest.mark.parametrize(
    ("metric", "bound", "expected"),
    [
        ("min_range_m", None, "at least"),
        ("delta_v_m_s", None, "at most"),
        ("min_range_m", "at most", "at most"),
        ("delta_v_m_s", "at least", "at least"),
    ],
)
def test_without_a_side_that_where_the_metric_is_worse_breaks_the_limit(
    mission: ScenarioFile, metric: str, bound: str | None, expected: str
) -> None:
    assert simulated_limit_state.select_limit(mission, LimitChoice(None, metric, 3.0, bound)).bound == expected
    assert choose_failure(mission, FailureChoice(metric=metric, limit=3.0, bound=bound)).bound == expected


def test_a_requirement_has_its_own_side(mission: ScenarioFile) -> None:
    with pytest.raises(RpojaxError, match=r"^bound: found 'at most', expected it with metric only$"):
        simulated_limit_state.select_limit(mission, LimitChoice("min_range_m", None, None, "at most"))


def test_requirements_in_windows_and_of_outcomes_are_no_limits_of_whole_runs(mission: ScenarioFile) -> None:
    tables = mission.model_dump()
    tables["requirements"] = [
        tables["requirements"][0] | {"metric": "min_range_m", "bound": "at least", **condition}
        for condition in ({"limit": 3.0, "to_s": 500.0}, {"limit": 4.0, "outcome": "lost"})
    ]
    for name in ("min_range_m", "min_range_m@0-500"):
        with pytest.raises(
            RpojaxError, match=rf"^requirement: found '{name}', expected a scenario with requirements on"
        ):
            simulated_limit_state.select_limit(scenario_loader.validate(tables), LimitChoice(name, None, None))
    tables["requirements"].append(tables["requirements"][0] | {"limit": 5.0, "to_s": None})
    found = simulated_limit_state.select_limit(scenario_loader.validate(tables), LimitChoice("min_range_m", None, None))
    assert found.limit == 5.0


def test_requirements_on_one_metric_with_several_limits_are_asked_which(mission: ScenarioFile) -> None:
    tables = mission.model_dump()
    first = tables["requirements"][0] | {"metric": "min_range_m", "bound": "at least", "limit": 15.0}
    tables["requirements"] = [first | {"probability": 0.9}, first | {"probability": 0.99}]
    alike = scenario_loader.validate(tables)
    assert simulated_limit_state.select_limit(alike, LimitChoice("min_range_m", None, None)).limit == 15.0
    assert choose_failure(alike, FailureChoice(requirement="min_range_m")).required_probability == 0.99
    tables["requirements"][1]["limit"] = 12.0
    several = scenario_loader.validate(tables)
    message = r"^requirement: found 'min_range_m' with the limits at least 15, at least 12, expected one; "
    with pytest.raises(RpojaxError, match=message):
        simulated_limit_state.select_limit(several, LimitChoice("min_range_m", None, None))
    with pytest.raises(RpojaxError, match=message):
        choose_failure(several, FailureChoice(requirement="min_range_m"))
