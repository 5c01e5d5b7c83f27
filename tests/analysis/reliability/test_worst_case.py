"""The search for a violation on runs with known metrics, and once on simulated ones."""

import inspect
import json
import math
import shlex
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest

import rpojax
from rpojax.analysis.gradients import rollout_evaluator
from rpojax.analysis.gradients.rollout_evaluator import RolloutEvaluator
from rpojax.analysis.reliability import worst_case
from rpojax.analysis.reliability.search_settings import LimitChoice, SearchSettings
from rpojax.analysis.reliability.simulated_limit_state import EvaluationCosts, MetricLimit, SimulatedLimitState
from rpojax.analysis.reliability.worst_case import WorstCase
from rpojax.campaign import single_run
from rpojax.cli import main
from rpojax.errors import RpojaxError
from rpojax.scenario.dispersed_numbers import dispersed_values, standard_normal_space
from rpojax.scenario.loading import scenario_loader
from rpojax.scenario.schema import ScenarioFile
from rpojax.simulation.metrics import recorded_metrics
from rpojax.simulation.noise import run_key

NAMES = ("delta_v_m_s", "min_range_m")
COSTS = EvaluationCosts(batch_size=2, run_s=0.1, gradient_s=0.71)


@pytest.fixture(scope="module")
def mission() -> ScenarioFile:
    """The nominal mission with all its dispersions."""
    return scenario_loader.load("inspection")


class LinearRuns(RolloutEvaluator):
    """Runs whose metrics are linear in z: 10 + 2 z0 and 30 - 3 z1; those with z0 beyond 5 fail."""

    coefficients = np.array([[2.0, 0.0], [0.0, -3.0]])
    fails_beyond = 5.0

    def __init__(self, count: int) -> None:
        self.metric_names, self.input_count, self.compile_s = NAMES, count, 0.0

    @property
    def batch_size(self) -> int:
        return 2

    def evaluate(self, inputs: np.ndarray, keys: np.ndarray) -> rollout_evaluator.RolloutResult:
        assert keys.shape == (len(inputs), 2)
        metrics = np.array([10.0, 30.0]) + inputs[:, :2] @ self.coefficients.T
        lost, events = inputs[:, 0] > self.fails_beyond, np.zeros(len(inputs))
        return rollout_evaluator.RolloutResult(
            metrics=metrics, jacobian=None, gradient=None, failed=lost, events=events
        )

    def gradient(
        self, inputs: np.ndarray, keys: np.ndarray, weights: np.ndarray | None = None
    ) -> rollout_evaluator.RolloutResult:
        assert weights is not None
        found = self.evaluate(inputs, keys)
        gradient = np.zeros_like(inputs)
        gradient[:, :2] = weights @ self.coefficients
        return replace(found, gradient=gradient)


def searched(file: ScenarioFile, limit: MetricLimit) -> WorstCase:
    space = standard_normal_space.make_space(file)
    settings = SearchSettings(starts=2, screening_points=16, budget=400.0)
    return worst_case.search_worst_case(
        space, limit, settings, seed=3, evaluator=LinearRuns(space.dimension), costs=COSTS
    )


@pytest.mark.parametrize(
    ("limit", "distance", "beyond"),
    [
        (MetricLimit("delta_v_m_s", "at most", 16.0), 3.0, 16.0),
        (MetricLimit("min_range_m", "at least", 22.5), 2.5, 22.5),
    ],
)
def test_the_nearest_violation_is_found_on_either_side(
    mission: ScenarioFile, limit: MetricLimit, distance: float, beyond: float
) -> None:
    worst = searched(mission, limit)
    assert worst.search.nearest_violation is not None
    assert worst.reported_point.distance == pytest.approx(distance, rel=0.02)
    value = limit.value_at_margin(worst.reported_point.margin)
    content = replace(worst, simulated_value=value).to_dict()
    assert limit.is_violated(content["value"])
    assert content["value"] == pytest.approx(beyond, rel=0.02)
    assert content["confirmed"]
    assert content["probability_first_order"] == pytest.approx(0.5 * math.erfc(distance / math.sqrt(2.0)), rel=0.3)
    assert content["cost"]["run_equivalents"] >= content["cost"]["flights"] + 8 * content["cost"]["gradients"]
    [first, *rest] = content["dispersions"]
    key = "initial.relative_position_m"
    row = f"{key}[{0 if limit.metric == 'delta_v_m_s' else 1}]"
    assert first["name"] == key
    assert abs(first["sigmas"][row]) == pytest.approx(distance, rel=0.05)
    assert [each["distance_sigmas"] for each in rest] == sorted((e["distance_sigmas"] for e in rest), reverse=True)
    index = int(row[-2])
    moved = first["values"][key][index] - first["nominal"][key][index]
    assert moved == pytest.approx(2.0 * first["sigmas"][row])
    lines = repr(worst).splitlines()
    assert lines[0].startswith(f"Worst case of {worst.space.file.name}: {worst.limit.metric} ")
    assert any(" sigmas from the median, run " in line for line in lines)
    table = worst.to_dataframe().set_index("key")
    assert table.loc[row, "value"] - table.loc[row, "nominal"] == pytest.approx(moved)
    assert table["name"].iloc[0] == key
    assert np.isfinite(table["value"].to_numpy(dtype=float)).all()


def test_the_worst_case_is_a_scenario_to_simulate(mission: ScenarioFile) -> None:
    worst = searched(mission, MetricLimit("delta_v_m_s", "at most", 16.0))
    again = scenario_loader.validate(worst.pinned_scenario.model_dump(mode="json"))
    _, base = single_run.nominal_parameters(again)
    drawn = dispersed_values.draw(again, run_key(worst.seed, worst.reported_point.replicate), {})
    chosen = dispersed_values.apply_to_params(base, drawn)
    expected = worst.values["initial.relative_position_m"]
    np.testing.assert_allclose(chosen.initial.relative_position, expected, rtol=1e-12)
    np.testing.assert_allclose(chosen.plant.servicer.mass, worst.values["servicer.mass_kg"], rtol=1e-12)
    assert float(chosen.flight.vehicle.mass) == mission.servicer.mass_kg


def test_a_failed_run_is_a_violation(mission: ScenarioFile) -> None:
    worst = searched(mission, MetricLimit("delta_v_m_s", "at most", 21.0))
    assert worst.reported_point.margin == -math.inf
    assert worst.reported_point.distance == pytest.approx(5.0, rel=0.06)
    content = replace(worst, simulated_value=math.nan).to_dict()
    assert content["confirmed"]
    assert (content["value"], content["value_flown"]) == (None, None)


def test_a_run_without_the_metric_violates_the_limit(mission: ScenarioFile) -> None:
    class SometimesUndefined(LinearRuns):
        def evaluate(self, inputs: np.ndarray, keys: np.ndarray) -> rollout_evaluator.RolloutResult:
            found = super().evaluate(inputs, keys)
            return replace(found, metrics=np.where(inputs[:, :1] > 2.0, np.nan, found.metrics))

    space = standard_normal_space.make_space(mission)
    settings = SearchSettings(starts=2, screening_points=16, budget=400.0)
    worst = worst_case.search_worst_case(
        space, MetricLimit("delta_v_m_s", "at most", 18.0), settings, 3, SometimesUndefined(space.dimension), COSTS
    )
    assert worst.search.nearest_violation is not None
    # The metric is beyond its limit at 4 sigmas, and undefined from 2 sigmas on.
    assert 2.0 < worst.reported_point.distance < 3.0
    content = replace(worst, simulated_value=math.nan).to_dict()
    assert (content["confirmed"], content["value"], content["value_flown"]) == (True, None, None)
    assert content["undefined"]


def test_a_limit_out_of_reach_is_reported(mission: ScenarioFile) -> None:
    worst = searched(mission, MetricLimit("min_range_m", "at least", 9.0))
    content = replace(worst, simulated_value=12.0).to_dict()
    assert not content["found"]
    assert not content["confirmed"]
    assert content["probability_first_order"] is None
    assert content["distance_sigmas"] == pytest.approx(6.0)
    assert content["value"] == pytest.approx(30.0 - 3.0 * 6.0, rel=1e-3)


@pytest.mark.parametrize(("gradient_s", "told"), [(0.71, None), (100.0, "a batch of 2 costs 2000 run-equivalents")])
@pytest.mark.parametrize("metric_limit", [11.0, 99.0])
def test_a_search_without_gradients_says_so(
    mission: ScenarioFile, gradient_s: float, told: str | None, metric_limit: float
) -> None:
    space = standard_normal_space.make_space(mission)
    worst = worst_case.search_worst_case(
        space,
        MetricLimit("delta_v_m_s", "at most", metric_limit),
        SearchSettings(starts=2, budget=400.0),
        seed=3,
        evaluator=LinearRuns(space.dimension),
        costs=replace(COSTS, gradient_s=gradient_s),
    )
    assert (worst.lack_of_gradients is None) is (told is None)
    assert told is None or told in str(worst.to_dict()["lack_of_gradients"])
    assert told is None or told in " ".join(str(worst).split())


def test_a_run_that_keeps_the_limit_is_no_confirmation(mission: ScenarioFile) -> None:
    worst = searched(mission, MetricLimit("delta_v_m_s", "at most", 16.0))
    assert not worst.confirmed
    assert not replace(worst, simulated_value=15.9).confirmed
    assert replace(worst, simulated_value=16.1).confirmed


def test_a_gradient_costs_whole_runs() -> None:
    limit = MetricLimit("min_range_m", "at least", 1.0)
    assert SimulatedLimitState(LinearRuns(3), limit, COSTS, 0).gradient_cost == 8.0


def test_python_has_the_defaults_of_the_records() -> None:
    defaults = {name: each.default for name, each in inspect.signature(rpojax.worst_case).parameters.items()}
    settings = SearchSettings()
    assert asdict(LimitChoice()).items() <= defaults.items()
    assert (settings.starts, settings.budget) == (defaults["starts"], defaults["budget"])


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        (SearchSettings(starts=0), "starts: found 0, expected 1 to 64"),
        (SearchSettings(starts=65), "starts: found 65, expected 1 to 64"),
        (SearchSettings(budget=15.0), "budget: found 15, expected at least the 16 first runs"),
        (SearchSettings(budget=math.nan), "budget: found nan, expected at least the 16 first runs"),
    ],
)
def test_settings_that_find_nothing_are_refused(settings: SearchSettings, message: str) -> None:
    with pytest.raises(RpojaxError) as error:
        worst_case.check_settings(settings)
    assert str(error.value) == message


def test_the_command_keeps_existing_files(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "worst_case.json").write_text("{}")
    words = ["worst-case", "inspection", "--requirement", "min_range_m", "--out", str(tmp_path)]
    assert main.main(words) == main.Status.BAD_INPUT
    assert "worst_case.json: exists already; --force replaces it" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("limit", "simulated", "words"),
    [
        (16.0, 16.2, ["broken 3.", "first-order probability 0.00", "confirmed", "8: 0.71 s against 0.1 s a run"]),
        (16.0, 15.0, ["NOT confirmed: the run keeps the limit"]),
        (
            -5.0,
            12.0,
            ["delta_v_m_s at most -5 m/s: the median run is beyond it already", "is no probability", "confirmed"],
        ),
        (99.0, 21.9, ["no violation found; closest is 22 m/s at 6.00 sigmas", "simulated: 21.90 m/s"]),
    ],
)
def test_the_command_writes_a_scenario_that_is_the_point(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    limit: float,
    simulated: float,
    words: list[str],
) -> None:
    monkeypatch.setattr(worst_case, "make_evaluator", lambda space, metrics, starts: LinearRuns(space.dimension))
    monkeypatch.setattr(worst_case, "measure_costs", lambda evaluator: COSTS)

    def simulate(_: WorstCase, directory: Path) -> float:
        directory.mkdir(parents=True)
        return simulated

    monkeypatch.setattr(worst_case, "simulate_worst_case", simulate)
    out = tmp_path / "worst of all"
    given = ["--metric", "delta_v_m_s", "--limit", str(limit), "--bound", "at most", "--out", str(out), "--seed", "5"]
    # Otherwise runs beyond 5 sigmas of one number fail, which counts as a violation.
    monkeypatch.setattr(LinearRuns, "fails_beyond", math.inf)
    assert main.main(["worst-case", "inspection", *given]) == main.Status.DONE
    shown = " ".join(capsys.readouterr().out.split())
    assert [word for word in words if word not in shown] == []
    content = json.loads((out / "worst_case.json").read_text())
    assert (content["probability_first_order"] is None) == (limit != 16.0)
    assert content["breaks_at_median"] == (limit == -5.0)
    file = scenario_loader.load(out / "worst_case.toml")
    text = (out / "worst_case.toml").read_text()
    told = ["rpojax", "run", str(out / "worst_case.toml"), "--seed", "5", "--run-id", str(content["run_id"])]
    assert shlex.split(text.splitlines()[1].removeprefix("# "))[: len(told)] == told
    drawn = dispersed_values.draw(file, run_key(5, content["run_id"]), {})
    for entry in content["dispersions"]:
        for key, value in entry["values"].items():
            np.testing.assert_allclose(drawn[key], value, rtol=1e-12)
    assert main.main(["worst-case", "inspection", *given]) == main.Status.BAD_INPUT


def test_the_command_warns_of_a_budget_without_gradients(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(worst_case, "make_evaluator", lambda space, metrics, starts: LinearRuns(space.dimension))
    monkeypatch.setattr(worst_case, "measure_costs", lambda evaluator: replace(COSTS, gradient_s=100.0))

    def simulate(_: WorstCase, directory: Path) -> float:
        directory.mkdir(parents=True)
        return 21.9

    monkeypatch.setattr(worst_case, "simulate_worst_case", simulate)
    given = ["--metric", "delta_v_m_s", "--limit", "99", "--bound", "at most", "--out", str(tmp_path / "worst")]
    assert main.main(["worst-case", "inspection", *given]) == main.Status.DONE
    shown = " ".join(capsys.readouterr().out.split())
    assert "warning: no gradient was evaluated: a batch of 2 costs 2000 run-equivalents, more than the budget" in shown


def test_an_interrupted_simulation_leaves_nothing_and_what_was_there(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def simulate(_: WorstCase, directory: Path) -> float:
        directory.mkdir(parents=True)
        (directory / "campaign.json").write_text("half")
        raise KeyboardInterrupt

    monkeypatch.setattr(worst_case, "make_evaluator", lambda space, metrics, starts: LinearRuns(space.dimension))
    monkeypatch.setattr(worst_case, "measure_costs", lambda evaluator: COSTS)
    monkeypatch.setattr(worst_case, "simulate_worst_case", simulate)
    out = tmp_path / "worst"
    words = ["worst-case", "inspection", "--metric", "delta_v_m_s", "--limit", "16", "--out", str(out)]
    assert main.main(words) not in (main.Status.DONE, main.Status.BAD_INPUT)
    assert "nothing was written" in capsys.readouterr().err
    assert list(out.iterdir()) == []
    (out / "flight").mkdir()
    (out / "flight" / "campaign.json").write_text('{"scenario_hash": "of before"}')
    assert main.main([*words, "--force"]) not in (main.Status.DONE, main.Status.BAD_INPUT)
    assert [(each.name, each.read_text()) for each in out.rglob("*") if each.is_file()] == [
        ("campaign.json", '{"scenario_hash": "of before"}')
    ]
    (out / "flight" / "campaign.json").rename(out / "flight" / "thesis.tex")
    assert main.main([*words, "--force"]) == main.Status.BAD_INPUT
    assert "which is no campaign: --force does not remove it" in capsys.readouterr().err
    assert (out / "flight" / "thesis.tex").exists()


@pytest.mark.slow
def test_a_real_search_is_confirmed_by_simulation(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["worst-case", "inspection", "--metric", "formation_error_rms_m", "--limit", "23", "--starts", "2"]
    settings = ["--set", "duration_s=60", "--out", str(tmp_path / "out"), "--json", "--no-cache"]
    assert main.main([*words, *settings]) == main.Status.DONE
    content = json.loads(capsys.readouterr().out)
    assert content["confirmed"]
    assert content["value"] > 23.0
    assert content["value_flown"] == pytest.approx(content["value"], rel=1e-4)
    assert content["distance_sigmas"] < 6.0
    assert content["alignment"] > 0.95
    file = rpojax.load(tmp_path / "out" / "worst_case.toml")
    records = single_run.simulate(file, content["seed"], content["run_id"])
    history = {name: values[None] for name, values in records.items() if name not in ("time_s", "rho_desired_H")}
    assert recorded_metrics.evaluate(file, history, {})["formation_error_rms_m"][0] > 23.0
