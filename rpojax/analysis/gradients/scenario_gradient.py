"""Derivatives of the metrics of runs with respect to keys of a scenario."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from rpojax.analysis.gradients import trained_tensors
from rpojax.analysis.gradients.derivative_sensitivity import select_metrics
from rpojax.analysis.gradients.rollout_evaluator import FORWARD_MODE_MAX_INPUTS, RolloutEvaluator, RolloutResult
from rpojax.analysis.gradients.tuning.tunable_parameters import check_differentiable
from rpojax.campaign import argument_checks, single_run
from rpojax.campaign.experiment_design import has_independent_runs
from rpojax.errors import RpojaxError, ScenarioError
from rpojax.flight.stages import Stages
from rpojax.optional_packages import require_package
from rpojax.runtime.progress import stage
from rpojax.scenario.dispersed_numbers import dispersed_values
from rpojax.scenario.dispersed_numbers.dispersed_values import Values
from rpojax.scenario.loading import scenario_loader
from rpojax.scenario.measurement_delays import TIME_TAG, delay_settings, delayed_sensor
from rpojax.scenario.parameter_keys import nominal_of_key
from rpojax.scenario.params import leaf_path_and_factor
from rpojax.scenario.schema import ScenarioFile
from rpojax.simulation.noise import run_keys

if TYPE_CHECKING:
    import xarray


@dataclass(frozen=True)
class Gradient:
    """Metrics of runs and their derivatives with respect to scenario keys, in the units of the keys.

    Attributes:
        run_ids: (runs,)
        metrics: metric -> (runs,), NaN where undefined
        derivatives: metric -> key -> (runs, ...), first the runs, then the key's own axes; NaN where the metric is
            undefined
        completed: (runs,) bool; other runs ended early and have no metrics
        events: (runs,) hash of accepted boxes and guidance modes; runs with the same hash differ smoothly
        mode: of differentiation, 'forward' or 'reverse'
        compile_s: time to compile [s]
    """

    run_ids: np.ndarray
    metrics: dict[str, np.ndarray]
    derivatives: dict[str, dict[str, np.ndarray]]
    completed: np.ndarray
    events: np.ndarray
    mode: str
    compile_s: float

    def mean(self, metric: str) -> dict[str, np.ndarray]:
        """Key -> mean derivative of a metric over the runs that count for it, of the key's own shape.

        Raises:
            RpojaxError: no run counts.
        """
        return {key: np.asarray(values.mean(axis=0)) for key, values in self._counted(metric, 1).items()}

    def standard_error(self, metric: str) -> dict[str, np.ndarray]:
        """Key -> standard error of the mean derivative.

        Raises:
            RpojaxError: fewer than two runs count.
        """
        return {
            key: np.asarray(values.std(axis=0, ddof=1) / np.sqrt(len(values)))
            for key, values in self._counted(metric, 2).items()
        }

    def counts(self, metric: str) -> np.ndarray:
        """Flags (runs,) of the runs that count for a metric: completed and with a value of it."""
        return self.completed & np.isfinite(self.metrics[metric])

    def _counted(self, metric: str, least: int) -> dict[str, np.ndarray]:
        """Key -> derivatives of a metric in the runs that count; an error if these are fewer than `least`."""
        counted = self.counts(metric)
        if counted.sum() < least:
            raise RpojaxError(f"{metric}: found {counted.sum()} completed runs with a value, expected at least {least}")
        return {key: values[counted] for key, values in self.derivatives[metric].items()}

    def to_xarray(self) -> "xarray.Dataset":
        """Metrics, and derivatives as `d_METRIC/d_KEY`, over `run`, as an `xarray.Dataset`.

        Raises:
            MissingExtraError: xarray is not installed.
        """
        labelled = require_package("xarray")
        variables: dict[str, Any] = {name: ("run", values) for name, values in self.metrics.items()}
        variables["completed"] = ("run", self.completed)
        for metric, by_key in self.derivatives.items():
            for key, values in by_key.items():
                axes = [f"axis{place}_{key}" for place in range(values.ndim - 1)]
                variables[f"d_{metric}/d_{key}"] = (("run", *axes), values)
        return labelled.Dataset(variables, {"run": ("run", self.run_ids)}, {"mode": self.mode})


def gradient(
    file: ScenarioFile,
    keys: Sequence[str],
    metrics: Sequence[str] = (),
    *,
    runs: int = 16,
    first_run: int = 0,
    horizon_s: float | None = None,
    seed: int = 0,
    mode: str = "auto",
    gates: str = "slopes",
    stages: Stages | None = None,
    temperature: float | None = None,
    progress: bool = True,
) -> Gradient:
    """Derivatives of metrics of single runs with respect to scenario keys, by automatic differentiation.

    A dispersed key is shifted by the same amount in all runs. Decisions (boxes, gates, burns, pulses) are those of the
    run itself, so the derivative holds as long as none changes. Near the gate and the dead band 'slopes' sees a
    decision that is close, which a descent wants; in a close approach it differs from a finite difference by 0.2 % in
    the median and by half at worst. 'steps' is the derivative of the run itself. Flight software keeps its own model.
    With a rendered camera it is that of a run with a soft detector and gate, through the picture.

    Args:
        file: scenario with independent runs
        keys: such as `formation.delta_v_weight`; a vector stands for all its components. With a rendered camera also
            tensors of networks, such as `imaging.detector.second.out_quality.bias`
        metrics: names of metrics with a derivative; by default those of the scenario's requirements
        runs: number of runs, those of a campaign with the same seed
        first_run: number of the first run
        horizon_s: simulated time of a run [s], by default that of the scenario
        seed: master seed of the runs
        mode: of differentiation; 'auto' is the forward mode for few keys per metric, else the reverse mode
        gates: what the derivative sees of gates and dead band
        stages: of the flight software, replaced ones included
        temperature: of a soft detector, in log-odds; 0.25 is a start, a lower one is closer to a run itself
        progress: show progress on stderr

    Raises:
        RpojaxError: a key or a metric has no derivative, runs are not independent, or the temperature is missing for a
            rendered camera, or given for another.
    """
    argument_checks.check_numbers(runs, first_run, seed, None)
    _check_request(file, mode, gates, temperature)
    used = _with_horizon(file, horizon_s)
    nominal, names = _nominals_of(used, keys), select_metrics(used, metrics)
    count, run_ids = sum(value.size for value in nominal.values()), first_run + np.arange(runs)
    if mode == "auto":
        mode = "forward" if count <= FORWARD_MODE_MAX_INPUTS * len(names) else "reverse"
    evaluator = RolloutEvaluator(used, _shifted_values(used, nominal), count, names, runs, stages)
    _set_derivative(evaluator, gates, temperature)
    with stage(f"derivatives in {mode} mode: compiling, then simulating", quiet=not progress):
        found, jacobian = _jacobian(evaluator, np.zeros((runs, count)), run_keys(seed, run_ids), mode)
    return Gradient(
        run_ids=run_ids,
        metrics={name: found.metrics[:, index] for index, name in enumerate(names)},
        derivatives={name: _by_key(jacobian[:, index], nominal) for index, name in enumerate(names)},
        completed=~found.failed,
        events=found.events,
        mode=mode,
        compile_s=evaluator.compile_s,
    )


def _set_derivative(evaluator: RolloutEvaluator, gates: str, temperature: float | None) -> None:
    if temperature is not None:
        evaluator.soften_detector(temperature)
    if gates == "steps":
        evaluator.take_gates_as_steps()


def _check_request(file: ScenarioFile, mode: str, gates: str, temperature: float | None) -> None:
    """Refuses words that name nothing, and scenarios without derivatives."""
    if mode not in ("auto", "forward", "reverse"):
        raise RpojaxError(f"mode: found {mode!r}, expected 'auto', 'forward' or 'reverse'")
    if gates not in ("slopes", "steps"):
        raise RpojaxError(f"gates: found {gates!r}, expected 'slopes' or 'steps'")
    if not has_independent_runs(file):
        raise RpojaxError(f"design: found {file.design.kind!r}, expected 'independent' for derivatives")
    if temperature is None:
        check_differentiable(file)
    else:
        _check_temperature(file, gates, temperature)


def _check_temperature(file: ScenarioFile, gates: str, temperature: float) -> None:
    """Refuses a soft detector without a rendered camera, or beside gates that decide, or of no temperature."""
    if file.camera.model != "rendered":
        raise RpojaxError(f"temperature: found camera.model = {file.camera.model!r}, expected 'rendered' beside it")
    if gates != "slopes":
        raise RpojaxError(f"gates: found {gates!r}, expected 'slopes' with a soft detector")
    if not 0.0 < temperature < float("inf"):
        raise RpojaxError(f"temperature: found {temperature:g}, expected a positive number")


def _jacobian(
    evaluator: RolloutEvaluator, inputs: np.ndarray, keys: np.ndarray, mode: str
) -> tuple[RolloutResult, np.ndarray]:
    """Metrics of runs and their Jacobian (runs, metrics, k): at once in forward mode, else metric by metric."""
    if mode == "forward":
        found = evaluator.jacobian(inputs, keys)
        assert found.jacobian is not None
        return found, found.jacobian
    count = len(evaluator.metric_names)
    rows = [evaluator.gradient(inputs, keys, np.tile(row, (len(inputs), 1))) for row in np.eye(count)]
    return rows[0], np.stack([np.asarray(row.gradient) for row in rows], axis=1)


def _with_horizon(file: ScenarioFile, horizon_s: float | None) -> ScenarioFile:
    """The scenario simulated for another time [s], if one is given.

    Raises:
        RpojaxError: it does not suit that time.
    """
    if horizon_s is None:
        return file
    try:
        return scenario_loader.with_duration(file, horizon_s)
    except ScenarioError as error:
        raise RpojaxError.of_argument(
            "horizon_s", f"found {horizon_s:g} ({error}), expected a time that suits the scenario"
        ) from None


def _nominals_of(file: ScenarioFile, keys: Sequence[str]) -> dict[str, np.ndarray]:
    """Key -> nominal value, of each key once."""
    nominal = {key: _nominal_of(file, key) for key in dict.fromkeys(keys)}
    if not nominal:
        raise RpojaxError("keys: found none, expected at least one key of a number in the scenario")
    return nominal


def _nominal_of(file: ScenarioFile, key: str) -> np.ndarray:
    """Nominal value of a key.

    Raises:
        ScenarioError: it does not name a number of a scenario.
        RpojaxError: that number is not continuous, or this scenario does not have it.
    """
    if trained_tensors.is_tensor(key):
        return trained_tensors.nominal(single_run.nominal_parameters(file)[1], key)
    leaf_path_and_factor(key)
    value = nominal_of_key(file, key)
    if value is None or key.startswith("faults."):
        raise RpojaxError(f"{key}: found no continuous number of the scenario, expected one")
    _check_delay(file, key)
    return np.asarray(value, dtype=np.float64)


def _check_delay(file: ScenarioFile, key: str) -> None:
    """Refuses times that decide the tick of an arrival, and time tags where no measurement is late.

    Raises:
        RpojaxError: the derivative would be zero, which says nothing of the effect.
    """
    name, late = delayed_sensor(file, key), delay_settings(file)
    if name is None:
        return
    if not key.endswith(TIME_TAG):
        raise RpojaxError(f"{key}: found a time that decides the tick of an arrival, expected a key with a derivative")
    if late is None or name not in late.sensors or not late.compensated:
        expected = "a delay that is not 0 and that the filter compensates beside it"
        raise RpojaxError(f"{key}: found measurements without an age, expected {expected}")


def _shifted_values(file: ScenarioFile, nominal: Mapping[str, np.ndarray]) -> Callable[[Array, Array], Values]:
    """Map from shifts (k,) and the random key of a run to its dispersed values with the shifts added."""

    def values(shifts: Float[Array, " k"], run_key: Array) -> Values:
        found = dispersed_values.draw(file, run_key, {})
        first = 0
        for key, value in nominal.items():
            shift = shifts[first : first + value.size].reshape(value.shape)
            found[key] = found.get(key, jnp.asarray(value)) + shift
            first += value.size
        return found

    return values


def _by_key(jacobian: np.ndarray, nominal: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Columns (runs, k) as key -> (runs, ...)."""
    ends = np.cumsum([value.size for value in nominal.values()])
    parts = zip(nominal.items(), ends, strict=True)
    return {key: jacobian[:, end - value.size : end].reshape(-1, *value.shape) for (key, value), end in parts}
