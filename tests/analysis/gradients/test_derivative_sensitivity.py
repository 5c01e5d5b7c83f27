"""Sensitivities of runs with known derivatives, compared with rankings of samples made from them."""

import json
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rpojax.analysis.gradients import derivative_sensitivity, rollout_evaluator
from rpojax.analysis.gradients.rollout_evaluator import RolloutEvaluator
from rpojax.campaign.storage.campaign_folder import Campaign
from rpojax.cli import main
from rpojax.cli.commands.analysis import sensitivity as command
from rpojax.cli.commands.analysis.sensitivity import shown_names
from rpojax.errors import Notice, OutputError, RpojaxError
from rpojax.scenario.dispersed_numbers import standard_normal_space
from rpojax.scenario.dispersed_numbers.standard_normal_space import StandardNormalSpace
from rpojax.scenario.loading import scenario_loader
from rpojax.scenario.scenario_digest import scenario_digest

METRICS = ("delta_v_m_s", "formation_error_rms_m")
POSITION, AXIS = "initial.relative_position_m", "target.tumble_axis"


class KnownDerivatives(RolloutEvaluator):
    """Runs with 1 + 3 z0 + 4 z1 for one metric, the square of a z of the tumble axis for the other; run 2 fails."""

    def __init__(self, space: StandardNormalSpace) -> None:
        self.metric_names, self.input_count = METRICS, space.dimension
        self.column = space.labels.index(f"{AXIS} (height)")

    def jacobian(self, inputs: np.ndarray, keys: np.ndarray) -> rollout_evaluator.RolloutResult:
        self.inputs = inputs
        jacobian = np.zeros((len(inputs), 2, self.input_count))
        jacobian[:, 0, :2] = 3.0, 4.0
        jacobian[:, 1, self.column] = 2.0 * inputs[:, self.column]
        metrics = np.stack([1.0 + inputs[:, :2] @ [3.0, 4.0], inputs[:, self.column] ** 2], axis=1)
        failed = np.arange(len(inputs)) == 2
        events = np.zeros(len(inputs))
        return rollout_evaluator.RolloutResult(
            metrics=metrics, jacobian=jacobian, gradient=None, failed=failed, events=events
        )


@pytest.fixture(scope="module")
def space() -> StandardNormalSpace:
    return standard_normal_space.make_space(scenario_loader.load("inspection"))


def test_a_linear_metric_has_its_standard_deviation(space: StandardNormalSpace) -> None:
    linear, _ = derivative_sensitivity.derivative_sensitivities(space, METRICS, 8, 0, KnownDerivatives(space))
    assert linear.sigma == pytest.approx(5.0)
    assert linear.leading == (f"{POSITION}[1]", f"{POSITION}[0]")
    assert [share.sigma for share in linear.shares[:3]] == pytest.approx([4.0, 3.0, 0.0])
    assert [share.nominal for share in linear.shares[:2]] == pytest.approx([4.0, 3.0])
    assert linear.shares[0].one_run == pytest.approx(1.0 / 7.0)
    assert linear.kink is not None


def test_a_metric_of_steps_is_said_to_have_no_derivative_of_use(space: StandardNormalSpace) -> None:
    class Steps(KnownDerivatives):
        def jacobian(self, inputs: np.ndarray, keys: np.ndarray) -> rollout_evaluator.RolloutResult:
            found = super().jacobian(inputs, keys)
            jacobian = np.zeros_like(found.jacobian)
            jacobian[:, 1] = found.jacobian[:, 1]
            return replace(found, metrics=np.floor(found.metrics), jacobian=jacobian)

    steps, curved = derivative_sensitivity.derivative_sensitivities(space, METRICS, 8, 0, Steps(space))
    assert steps.kink is not None and "a number of steps" in steps.kink
    assert curved.kink is None or "a number of steps" not in curved.kink


def test_failed_runs_are_left_out_and_the_share_of_one_run_is_reported(space: StandardNormalSpace) -> None:
    evaluator = KnownDerivatives(space)
    _, curved = derivative_sensitivity.derivative_sensitivities(space, METRICS, 8, 0, evaluator)
    gradients = 2.0 * np.delete(evaluator.inputs[1:, evaluator.column], 1)
    assert len(curved.values) == 7
    assert curved.shares[0].name == AXIS
    assert curved.shares[0].sigma == pytest.approx(np.sqrt(np.mean(gradients**2)))
    assert curved.shares[0].one_run == pytest.approx(np.max(gradients**2) / np.sum(gradients**2))
    assert curved.shares[0].nominal == 0.0
    assert curved.kink is None


class SometimesUndefined(KnownDerivatives):
    """The same, with one metric undefined in the median run and in some of the others, as an evaluator gives it."""

    lost: tuple[int, ...] = (0, 3, 4)

    def jacobian(self, inputs: np.ndarray, keys: np.ndarray) -> rollout_evaluator.RolloutResult:
        found = super().jacobian(inputs, keys)
        assert found.jacobian is not None
        found.metrics[list(self.lost), 1], found.jacobian[list(self.lost), 1] = np.nan, np.nan
        return found


def test_runs_without_a_metric_are_left_out_of_it_alone_and_counted(space: StandardNormalSpace) -> None:
    evaluator = SometimesUndefined(space)
    linear, curved = derivative_sensitivity.derivative_sensitivities(space, METRICS, 8, 0, evaluator)
    assert (len(linear.values), linear.undefined) == (7, 0)
    assert linear.sigma == pytest.approx(5.0)
    assert (len(curved.values), curved.undefined) == (5, 2)
    gradients = 2.0 * np.delete(evaluator.inputs[:, evaluator.column], [0, 2, 3, 4])
    assert curved.sigma == pytest.approx(np.sqrt(np.mean(gradients**2)))
    assert np.isnan(curved.shares[0].nominal)


def test_too_few_runs_with_a_metric_are_refused(space: StandardNormalSpace) -> None:
    evaluator = SometimesUndefined(space)
    evaluator.lost = tuple(range(8))
    with pytest.raises(
        RpojaxError, match=r"^runs: found 1 that reached their end, and 6 more without a value or derivative"
    ):
        derivative_sensitivity.derivative_sensitivities(space, METRICS, 8, 0, evaluator)


def test_a_ranking_by_sampling_is_compared(space: StandardNormalSpace) -> None:
    linear, _ = derivative_sensitivity.derivative_sensitivities(space, METRICS, 8, 0, KnownDerivatives(space))
    rng = np.random.default_rng(4)
    columns = {name: rng.normal(size=400) for name in (f"{POSITION}[0]", f"{POSITION}[1]", f"{AXIS}[0]", f"{AXIS}[1]")}
    metric = 3.0 * columns[f"{POSITION}[0]"] + 4.0 * columns[f"{POSITION}[1]"] + rng.normal(size=400)
    agreement = derivative_sensitivity.compare_with_sampling(linear, space, columns, metric)
    assert agreement is not None
    assert agreement.leading[:2] == agreement.both == linear.leading
    assert set(agreement.strengths) == {f"{POSITION}[0]", f"{POSITION}[1]", AXIS}
    assert agreement.rank_correlation == pytest.approx(1.0)
    assert agreement.std == pytest.approx(np.std(metric, ddof=1))
    turned = derivative_sensitivity.compare_with_sampling(
        linear, space, columns, columns[f"{AXIS}[0]"] + 0.5 * columns[f"{POSITION}[0]"]
    )
    assert turned is not None
    assert turned.rank_correlation is not None
    assert turned.rank_correlation < 0.0


def test_too_few_sampled_runs_rank_nothing(space: StandardNormalSpace) -> None:
    linear, _ = derivative_sensitivity.derivative_sensitivities(space, METRICS, 8, 0, KnownDerivatives(space))
    assert (
        derivative_sensitivity.compare_with_sampling(linear, space, {f"{POSITION}[0]": np.arange(5.0)}, np.arange(5.0))
        is None
    )


@pytest.mark.parametrize(
    ("values", "reason"),
    [
        ({METRICS[0]: np.arange(12.0) // 4}, None),
        ({METRICS[0]: np.where(np.arange(12) < 8, np.arange(12.0), np.nan)}, "8 runs of out have delta_v_m_s, and a"),
        ({METRICS[0]: np.ones(12)}, "delta_v_m_s or the dispersions of all 12 runs of out are equal"),
        ({}, "out has no delta_v_m_s"),
    ],
)
def test_a_campaign_that_ranks_nothing_says_why(
    values: dict[str, np.ndarray],
    reason: str | None,
    space: StandardNormalSpace,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    content = {
        "__init__": lambda self, directory: setattr(self, "directory", directory),
        "info": {"scenario_hash": scenario_digest(space.file)},
        "drawn": {POSITION: np.random.default_rng(3).normal(size=(12, 3))},
        "metrics": values,
    }
    monkeypatch.setattr(command, "Campaign", type("TwelveRuns", (Campaign,), content))
    monkeypatch.setattr(derivative_sensitivity, "RolloutEvaluator", lambda *_, **__: KnownDerivatives(space))
    arguments = ["sensitivity", "inspection", "--metric", METRICS[0], "--runs", "8", "--campaign", "out"]
    assert main.main(arguments) == main.Status.DONE
    output = capsys.readouterr().out
    assert ("12 sampled runs" in output) is (reason is None)
    assert ("nothing by sampling" in output) is (reason is not None)
    assert reason is None or f"nothing by sampling: {reason}" in output
    assert main.main([*arguments, "--json"]) == main.Status.DONE
    told = json.loads(capsys.readouterr().out)["metrics"][0]["unranked"]
    assert (told or "").startswith(reason or "") and (told is None) is (reason is None)


def test_metrics_are_those_of_the_requirements_unless_asked_for(space: StandardNormalSpace) -> None:
    assert derivative_sensitivity.select_metrics(space.file, ()) == (
        *("formation_error_rms_m", "nav_relative_position_error_rms_m", "min_range_m"),
        "wheel_speed_peak_fraction",
    )
    assert derivative_sensitivity.select_metrics(space.file, ("nees_mean", "nees_mean")) == ("nees_mean",)


def test_requirements_without_a_derivative_are_said_to_be_left_out(space: StandardNormalSpace) -> None:
    with pytest.warns(Notice) as found:
        derivative_sensitivity.select_metrics(space.file, ())
    (line,) = [str(each.message) for each in found]
    assert "passive_range_24_h_m at least" in line
    assert "min_range_m" not in line.replace("passive_", "")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        derivative_sensitivity.select_metrics(space.file, ("min_range_m",))


def test_what_has_no_derivative_is_refused(space: StandardNormalSpace) -> None:
    with pytest.raises(RpojaxError, match=r"^metrics: found 'detection_rate', expected a metric with a derivative: "):
        derivative_sensitivity.select_metrics(space.file, ("detection_rate",))
    timed = [each.model_copy(update={"to_s": 100.0}) for each in space.file.requirements]
    for requirements in ([], timed):
        without = space.file.model_copy(update={"requirements": requirements})
        with pytest.raises(RpojaxError, match=r"^metrics: found none, expected one, for a scenario without requirem"):
            derivative_sensitivity.select_metrics(without, ())


def test_too_few_runs_are_refused(space: StandardNormalSpace) -> None:
    with pytest.raises(RpojaxError, match=r"^runs: found 1, expected at least 2$"):
        derivative_sensitivity.derivative_sensitivities(space, METRICS, 1, 0, KnownDerivatives(space))

    class Failing(KnownDerivatives):
        def jacobian(self, inputs: np.ndarray, keys: np.ndarray) -> rollout_evaluator.RolloutResult:
            return replace(super().jacobian(inputs, keys), failed=np.ones(len(inputs), dtype=bool))

    with pytest.raises(RpojaxError, match=r"^runs: found 0 that reached their end, expected at least 2$"):
        derivative_sensitivity.derivative_sensitivities(space, METRICS, 4, 0, Failing(space))


def test_the_analysis_of_a_scenario_is_written_as_json(
    space: StandardNormalSpace, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(derivative_sensitivity, "RolloutEvaluator", lambda *_, **__: KnownDerivatives(space))
    found = derivative_sensitivity.sensitivity(space.file, METRICS, runs=8, progress=False)
    found.write(tmp_path / "sensitivity.json")
    content = json.loads((tmp_path / "sensitivity.json").read_text())
    assert content == found.to_dict()
    assert [entry["metric"] for entry in content["metrics"]] == list(METRICS)
    assert content["metrics"][0]["sigma_by_dispersions"] == pytest.approx(5.0)
    table = found.to_dataframe()
    of_first = table[table["metric"] == METRICS[0]]
    assert np.sqrt((of_first["sigma"] ** 2).sum()) == pytest.approx(5.0)
    assert of_first["input"].tolist() == [share.name for share in found.metrics[0].shares]
    assert content["metrics"][0]["sampling"] is None
    with pytest.raises(OutputError, match="exists already"):
        found.write(tmp_path / "sensitivity.json")


@pytest.mark.parametrize("runs", [2, 4, 16])
def test_derivatives_beyond_the_spread_of_the_runs_are_told(
    runs: int, space: StandardNormalSpace, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Ripples of 1 mm in the metric have derivatives as large as those of 5 m, or 5000 times the metric's spread."""

    class Ripples(KnownDerivatives):
        def jacobian(self, inputs: np.ndarray, keys: np.ndarray) -> rollout_evaluator.RolloutResult:
            found = super().jacobian(inputs, keys)
            rippled = np.stack([0.001 * np.cos(1e4 * inputs[:, 0]), found.metrics[:, 1]], axis=1)
            return replace(found, metrics=rippled, failed=np.zeros(len(inputs), dtype=bool))

    arguments = ["sensitivity", "inspection", "--metric", METRICS[0], "--metric", METRICS[1], "--runs", str(runs)]
    for made, are_told in ((Ripples, True), (KnownDerivatives, False)):
        monkeypatch.setattr(derivative_sensitivity, "RolloutEvaluator", lambda *_, made=made, **__: made(space))
        if runs == 2 and not are_told:
            continue
        assert main.main(arguments) == main.Status.DONE
        output = capsys.readouterr().out
        assert (f"warning: {METRICS[0]} varies by" in output) is are_told
        assert f"warning: {METRICS[1]}" not in output


def test_the_command_refuses_an_unknown_metric_in_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    assert main.main(["sensitivity", "inspection", "--metric", "speed"]) == main.Status.BAD_INPUT
    error = capsys.readouterr().err
    assert error.startswith("rpojax: error: --metric: found 'speed', expected a metric with a derivative: ")
    assert error.count("\n") == 1


def test_a_campaign_of_another_scenario_is_refused(space: StandardNormalSpace) -> None:
    other = scenario_loader.load("inspection", ["duration_s=600", "formation.dead_band_mm_s=2"])
    info = {"scenario": other.model_dump(mode="json"), "scenario_hash": "0"}
    with pytest.raises(
        RpojaxError, match=r"^campaign: found out, of another scenario: duration_s, formation.dead_band_"
    ):
        derivative_sensitivity.check_same_scenario(space.file, Path("out"), info)
    # Other requirements change no run.
    info["scenario"] = {**space.file.model_dump(mode="json"), "requirements": [], "name": "same runs"}
    derivative_sensitivity.check_same_scenario(space.file, Path("out"), info)


def test_inputs_stay_distinct_in_a_narrow_table() -> None:
    names = [f"initial.{name}[{axis}]" for name in ("relative_position_m", "relative_velocity_m_s") for axis in (0, 1)]
    found = shown_names([*names, "target.tumble_axis (height)"], 80)
    assert found[names[1]] == "relative_position_m[1]"
    assert len(set(found.values())) == 5
    # Names that would become the same stay whole.
    assert set(shown_names(["servicer.mass_kg", "target.mass_kg"], 80).values()) == {
        "servicer.mass_kg",
        "target.mass_kg",
    }
    assert shown_names(names, 200) == dict(zip(names, names, strict=True))
