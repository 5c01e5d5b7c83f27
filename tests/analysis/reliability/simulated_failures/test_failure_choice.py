"""Which failure options name, and what is refused."""

import shlex
from pathlib import Path

import numpy as np
import pytest
from isolated_plugins import forgotten_plugins

import rpojax
from rpojax.analysis.reliability.search_settings import FailureChoice
from rpojax.analysis.reliability.simulated_failures import run_probability
from rpojax.analysis.reliability.simulated_failures.failure_margin import choose_failure
from rpojax.errors import RpojaxError
from rpojax.scenario.dispersed_numbers.standard_normal_space import make_space
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
    ("outcome", "without", "source", "overrides"),
    [
        ("off_station", ["duration_s=2900"], "inspection", ["duration_s=3000"]),
        ("off_station", ["limits.arrive_by_s=6001"], "inspection", ["limits.arrive_by_s=100"]),
        ("lost", ["duration_s=500"], "inspection", ["duration_s=600"]),
        ("lost", ["limits.lost_after_s=9000"], "inspection", []),
        ("aborted", [], "vbar_approach", []),
        ("unfinished", [], "vbar_approach", []),
    ],
)
def test_an_outcome_that_no_run_can_have_is_refused(
    outcome: str, without: list[str], source: str, overrides: list[str]
) -> None:
    choice = FailureChoice(outcome=outcome)
    with pytest.raises(
        RpojaxError, match=f"^outcome: found '{outcome}' in runs of .* s, expected one that can occur: "
    ):
        choose_failure(scenario_loader.load("inspection", without), choice)
    assert str(choose_failure(scenario_loader.load(source, overrides), choice).outcome) == outcome


def test_a_metric_of_the_scenarios_plugin_is_one_of_its_own(mission: ScenarioFile) -> None:
    plugin = rpojax.Plugin(metrics={"minutes_late": lambda time_s: time_s[-1] / 60.0})
    choice = FailureChoice(metric="minutes_late", limit=5.0, bound="at most")
    with forgotten_plugins():
        own = scenario_loader.load("inspection", plugin=plugin)
        assert choose_failure(own, choice).words == "minutes_late above 5, or undefined, as in a run that ended early"
        with pytest.raises(RpojaxError, match=r"^metric: found 'minutes_late'"):
            choose_failure(mission, choice)


def test_the_command_of_a_failing_run_allows_its_plugin_and_is_quoted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "laws.py").write_text("import rpojax\n\n\ndef setup():\n    return rpojax.Plugin()\n")
    (tmp_path / "own.toml").write_text('extends = "inspection"\nplugin = "laws.py:setup"\n')
    monkeypatch.chdir(tmp_path)
    with forgotten_plugins():
        space = make_space(scenario_loader.load("own.toml", allow_plugin=True))
        run = run_probability.FailingRun(7, np.zeros(space.dimension), -1.0)
        [entry] = run_probability.write_scenarios(space, 3, [run], Path("out/a b"))
    file = tmp_path / "out" / "a b" / "failing_runs" / "01.toml"
    words = ["rpojax", "run", str(file), "--seed", "3", "--run-id", "7", "--out", "a b_run_01", "--allow-plugin"]
    assert shlex.split(entry["command"]) == words
    assert file.read_text().startswith(f"# {entry['command']}\n")


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
