"""Derivatives of the metrics of runs with respect to keys of a scenario."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from rpojax.analysis.gradients.derivative_sensitivity import select_metrics
from rpojax.analysis.gradients.rollout_evaluator import RolloutEvaluator, run_keys
from rpojax.dispersions import dispersed_values
from rpojax.dispersions.designs.experiment_design import has_independent_runs
from rpojax.dispersions.dispersed_values import Values
from rpojax.errors import RpojaxError
from rpojax.flight.computer import Stages
from rpojax.runtime.progress import busy
from rpojax.scenario.loading import scenario_loader
from rpojax.scenario.parameter_keys import nominal_of_key
from rpojax.scenario.params import leaf_path_and_factor
from rpojax.scenario.schema import ScenarioFile


@dataclass(frozen=True)
class Gradient:
    """Metrics of runs and their derivatives with respect to scenario keys, in the units of the keys.

    Attributes:
        run_ids: (runs,)
        metrics: metric -> (runs,)
        derivatives: metric -> key -> (runs, ...), the key's own shape behind the runs
        completed: (runs,) bool; the values of other runs end with their failure
        events: (runs,) hash of accepted boxes and guidance modes; runs of the same hash differ smoothly
        compile_s: time to compile [s]
    """

    run_ids: np.ndarray
    metrics: dict[str, np.ndarray]
    derivatives: dict[str, dict[str, np.ndarray]]
    completed: np.ndarray
    events: np.ndarray
    compile_s: float

    def mean(self, metric: str) -> dict[str, np.ndarray]:
        """Key -> mean derivative of a metric over completed runs, of the key's own shape."""
        return {
            key: np.asarray(values[self.completed].mean(axis=0)) for key, values in self.derivatives[metric].items()
        }


def gradient(
    file: ScenarioFile,
    keys: Sequence[str],
    metrics: Sequence[str] = (),
    *,
    runs: int = 16,
    first_run: int = 0,
    horizon_s: float | None = None,
    seed: int = 0,
    stages: Stages | None = None,
    progress: bool = True,
) -> Gradient:
    """Derivatives of metrics of single runs with respect to scenario keys, by forward-mode differentiation.

    A key that is dispersed is shifted by the same amount in all runs. Boxes, gates and burns are decided as in the
    run itself: the derivative holds between two changes of such an event.

    Args:
        file: scenario with independent runs
        keys: such as `formation.delta_v_weight`; a vector counts with all its components
        metrics: names of metrics with a derivative; by default those of the scenario's requirements
        runs: number of runs, those of a campaign with the same seed
        first_run: number of the first run
        horizon_s: simulated time of a run [s], by default that of the scenario
        seed: master seed of the runs
        stages: of the flight software, replaced ones included
        progress: show progress on stderr

    Raises:
        RpojaxError: a key is no number of the scenario, a metric has no derivative, or runs are not independent.
    """
    if runs < 1 or first_run < 0:
        raise RpojaxError(f"runs, first_run: found {runs}, {first_run}, expected at least one run, numbered from 0")
    if not has_independent_runs(file):
        raise RpojaxError(f"design: found {file.design.kind!r}, expected 'independent' for derivatives")
    used = file if horizon_s is None else scenario_loader.validate({**file.model_dump(), "duration_s": horizon_s})
    nominal = {key: _nominal_of(used, key) for key in dict.fromkeys(keys)}
    if not nominal:
        raise RpojaxError("keys: found none, expected at least one key of a number in the scenario")
    names = select_metrics(used, metrics)
    count = sum(value.size for value in nominal.values())
    run_ids = first_run + np.arange(runs)
    evaluator = RolloutEvaluator(used, _shifted_values(used, nominal), count, names, runs, stages)
    with busy("compiling runs and their derivatives, then simulating", quiet=not progress):
        found = evaluator.jacobian(np.zeros((runs, count)), run_keys(seed, run_ids))
    assert found.jacobian is not None
    return Gradient(
        run_ids=run_ids,
        metrics={name: found.metrics[:, index] for index, name in enumerate(names)},
        derivatives={name: _by_key(found.jacobian[:, index], nominal) for index, name in enumerate(names)},
        completed=~found.failed,
        events=found.events,
        compile_s=evaluator.compile_s,
    )


def _nominal_of(file: ScenarioFile, key: str) -> np.ndarray:
    """Nominal value of a key.

    Raises:
        ScenarioError: it is no number that `Params` hold.
    """
    leaf_path_and_factor(key)
    value = nominal_of_key(file, key)
    if value is None or key.startswith("fault."):
        raise RpojaxError(f"{key}: found no continuous number of the scenario, expected one")
    return np.asarray(value, dtype=np.float64)


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
