"""Sensitivities of flights whose derivatives are known, beside rankings of samples made from them."""

from dataclasses import replace

import numpy as np
import pytest

from rpojax.analysis.gradients import rollout_evaluator
from rpojax.analysis.gradients.rollout_evaluator import RolloutEvaluator
from rpojax.analysis.reliability import derivative_sensitivity as sensitivity
from rpojax.cli import main
from rpojax.dispersions import standard_normal_space
from rpojax.dispersions.standard_normal_space import StandardNormalSpace
from rpojax.errors import RpojaxError
from rpojax.scenario import scenario_file

METRICS = ("delta_v_m_s", "formation_error_rms_m")
POSITION, AXIS = "initial.relative_position_m", "target.tumble_axis"


class Known(RolloutEvaluator):
    """Flights with 1 + 3 z0 + 4 z1 for one figure, z8^2 of the tumble axis for the other; run 2 fails."""

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
    return standard_normal_space.make_space(scenario_file.load("inspection"))


def test_a_linear_metric_has_its_standard_deviation(space: StandardNormalSpace) -> None:
    linear, _ = sensitivity.derivative_sensitivities(space, METRICS, 8, 0, Known(space))
    assert linear.sigma == pytest.approx(5.0)
    assert linear.leading == (f"{POSITION}[1]", f"{POSITION}[0]")
    assert [share.sigma for share in linear.shares[:3]] == pytest.approx([4.0, 3.0, 0.0])
    assert [share.nominal for share in linear.shares[:2]] == pytest.approx([4.0, 3.0])
    assert linear.shares[0].one_run == pytest.approx(1.0 / 7.0)
    assert linear.kink is not None


def test_failed_runs_are_left_out_and_a_single_run_behind_a_figure_is_told(space: StandardNormalSpace) -> None:
    flights = Known(space)
    _, curved = sensitivity.derivative_sensitivities(space, METRICS, 8, 0, flights)
    slopes = 2.0 * np.delete(flights.inputs[1:, flights.column], 1)
    assert len(curved.values) == 7
    assert curved.shares[0].name == AXIS
    assert curved.shares[0].sigma == pytest.approx(np.sqrt(np.mean(slopes**2)))
    assert curved.shares[0].one_run == pytest.approx(np.max(slopes**2) / np.sum(slopes**2))
    assert curved.shares[0].nominal == 0.0
    assert curved.kink is None


def test_a_ranking_by_sampling_is_put_beside(space: StandardNormalSpace) -> None:
    linear, _ = sensitivity.derivative_sensitivities(space, METRICS, 8, 0, Known(space))
    rng = np.random.default_rng(4)
    columns = {name: rng.normal(size=400) for name in (f"{POSITION}[0]", f"{POSITION}[1]", f"{AXIS}[0]", f"{AXIS}[1]")}
    metric = 3.0 * columns[f"{POSITION}[0]"] + 4.0 * columns[f"{POSITION}[1]"] + rng.normal(size=400)
    agreement = sensitivity.compare_with_sampling(linear, space, columns, metric)
    assert agreement is not None
    assert agreement.leading[:2] == agreement.both == linear.leading
    assert set(agreement.strengths) == {f"{POSITION}[0]", f"{POSITION}[1]", AXIS}
    assert agreement.rank_correlation == pytest.approx(1.0)
    assert agreement.std == pytest.approx(np.std(metric, ddof=1))
    turned = sensitivity.compare_with_sampling(
        linear, space, columns, columns[f"{AXIS}[0]"] + 0.5 * columns[f"{POSITION}[0]"]
    )
    assert turned is not None
    assert turned.rank_correlation is not None
    assert turned.rank_correlation < 0.0


def test_too_few_sampled_runs_rank_nothing(space: StandardNormalSpace) -> None:
    linear, _ = sensitivity.derivative_sensitivities(space, METRICS, 8, 0, Known(space))
    assert sensitivity.compare_with_sampling(linear, space, {f"{POSITION}[0]": np.arange(5.0)}, np.arange(5.0)) is None


def test_metrics_are_those_of_the_requirements_unless_asked_for(space: StandardNormalSpace) -> None:
    assert sensitivity.select_metrics(space.file, ()) == (
        *("formation_error_rms_m", "nav_relative_position_error_rms_m", "min_range_m"),
        "wheel_speed_peak_fraction",
    )
    assert sensitivity.select_metrics(space.file, ("nees_mean", "nees_mean")) == ("nees_mean",)


def test_what_has_no_derivative_is_refused(space: StandardNormalSpace) -> None:
    with pytest.raises(RpojaxError, match=r"^--metric: found 'detection_rate', expected a metric with a derivative: "):
        sensitivity.select_metrics(space.file, ("detection_rate",))
    without = space.file.model_copy(update={"requirements": []})
    with pytest.raises(RpojaxError, match=r"^--metric: found none, expected one, for a scenario without requirements"):
        sensitivity.select_metrics(without, ())


def test_too_few_runs_are_refused(space: StandardNormalSpace) -> None:
    with pytest.raises(RpojaxError, match=r"^--runs: found 1, expected at least 2$"):
        sensitivity.derivative_sensitivities(space, METRICS, 1, 0, Known(space))

    class Lost(Known):
        def jacobian(self, inputs: np.ndarray, keys: np.ndarray) -> rollout_evaluator.RolloutResult:
            return replace(super().jacobian(inputs, keys), failed=np.ones(len(inputs), dtype=bool))

    with pytest.raises(RpojaxError, match=r"^--runs: found 0 that reached their end, expected at least 2$"):
        sensitivity.derivative_sensitivities(space, METRICS, 4, 0, Lost(space))


def test_the_verb_refuses_an_unknown_metric_in_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    assert main.main(["sensitivity", "inspection", "--metric", "speed"]) == main.Status.BAD_INPUT
    error = capsys.readouterr().err
    assert error.startswith("rpojax: error: --metric: found 'speed', expected a metric with a derivative: ")
    assert error.count("\n") == 1
