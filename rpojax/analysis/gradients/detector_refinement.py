"""Refinement of the detector and of the filter's noises together, by the navigation error of the closed loop.

The gradient of runs with a soft detector goes through the picture. What is moved of the networks are their biases and
last layers, from the weights of the scenario on: a thousand numbers of half a million, so that little is forgotten
(Ben Zaken et al., "BitFit", ACL 2022). What was refined is judged by the detector as it runs, on unseen runs.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

import jax
import jax.numpy as jnp
import numpy as np
import optax
from jaxtyping import Array, Float

from rpojax.analysis.gradients import trained_tensors
from rpojax.analysis.gradients.rollout_evaluator import RolloutEvaluator
from rpojax.analysis.gradients.tuning import tune
from rpojax.analysis.gradients.tuning.gradient_descent import clipped_sum
from rpojax.analysis.gradients.tuning.tunable_parameters import TunableParameters, select_parameters
from rpojax.campaign import single_run
from rpojax.campaign.experiment_design import has_independent_runs
from rpojax.errors import RpojaxError, ScenarioError
from rpojax.scenario.dispersed_numbers import dispersed_values
from rpojax.scenario.dispersed_numbers.dispersed_values import Values
from rpojax.scenario.loading import scenario_loader
from rpojax.scenario.schema import ScenarioFile
from rpojax.sensors.rendered_camera import Networks
from rpojax.simulation.noise import run_keys
from rpojax.vision.detector.detector_file import round_to_half_precision
from rpojax.vision.detector.two_stage_detector import DetectorParams

FILTER_NOISES: Final = (
    "navigation.edge_noise_px",
    "navigation.center_sigma_m",
    "navigation.scale_sigma",
    "navigation.bearing_bias_sigma_deg",
)
"""Noises of the filter that are of boxes."""
NAVIGATION: Final = "nav_relative_position_error_rms_m"
_METRICS: Final = (NAVIGATION, "estimate_surprise")
_LAST_LAYERS: Final = ("first.out.kernel", "second.out.kernel", "second.out_quality.kernel")
_TENSOR_UNIT: Final = 0.02
"""Change of a weight that counts as one of the logarithm of a noise. A choice: weights are 0.05 to 0.2."""
_RESAMPLES: Final = 2000
MAP_LOSS: Final = 0.01
"""Average precision that a refined detector may lose on any data set."""


@dataclass(frozen=True)
class RefinementSettings:
    """Settings of a refinement.

    Attributes:
        runs: in each step
        steps: of the descent
        horizon_s: simulated time of these runs [s]
        temperature: of the soft detector, in log-odds
        rate: size of the first steps, in logarithms of the noises; weights change by 0.02 times that
        validation_runs: unseen, with the detector as it runs
        validation_s: simulated time of these [s]; None for that of the scenario
        seed: master seed; that of the unseen runs is the next
    """

    runs: int = 8
    steps: int = 20
    horizon_s: float = 120.0
    temperature: float = 0.25
    rate: float = 0.05
    validation_runs: int = 32
    validation_s: float | None = None
    seed: int = 0

    def __post_init__(self) -> None:
        for name in ("runs", "steps", "validation_runs"):
            if getattr(self, name) < 1:
                raise RpojaxError.of_argument(name, f"found {getattr(self, name)}, expected at least 1")
        for name in ("horizon_s", "temperature", "rate"):
            if not 0.0 < getattr(self, name) < float("inf"):
                raise RpojaxError.of_argument(name, f"found {getattr(self, name):g}, expected a positive number")


@dataclass(frozen=True)
class Refined:
    """Result of a descent.

    Attributes:
        values: noises of the filter by key
        detector: refined parameters, as a file holds them
        objectives: of the steps, each of other runs
        compile_s: time to compile [s]
        steps_s: time of the steps [s]
        memory_bytes: temporary memory of the compiled program [B]
    """

    values: dict[str, Any]
    detector: DetectorParams
    objectives: tuple[float, ...]
    compile_s: float
    steps_s: float
    memory_bytes: int


@dataclass(frozen=True)
class UnseenRuns:
    """Navigation errors of unseen runs with both detectors and filters, pair by pair.

    Attributes:
        runs: with a value of both
        failed: runs that failed, before and after
        p95: of the navigation error before and after [m]
        median: likewise [m]
        ratio: geometric mean of the errors after over those before
        ratio_95: its interval, from resampled pairs
    """

    runs: int
    failed: tuple[int, int]
    p95: tuple[float, float]
    median: tuple[float, float]
    ratio: float
    ratio_95: tuple[float, float]

    @property
    def is_better(self) -> bool:
        """Whether errors are smaller beyond chance, in the tail, too, and no more runs fail."""
        return self.ratio_95[1] < 1.0 and self.p95[1] < self.p95[0] and self.failed[1] <= self.failed[0]


class _Coordinates:
    """Coordinates of the noises and, in `_TENSOR_UNIT`, changes of the tensors."""

    def __init__(self, file: ScenarioFile) -> None:
        self.noises: TunableParameters = select_parameters(file, FILTER_NOISES)
        networks = single_run.nominal_parameters(file)[1].networks
        assert networks is not None
        self._networks: Networks = networks
        self._tensors = {key: np.asarray(value) for key, value in _moved_tensors(networks).items()}
        self._file = file

    @property
    def initial(self) -> np.ndarray:
        """Coordinates (k,) of the scenario."""
        return np.concatenate([self.noises.initial, np.zeros(sum(each.size for each in self._tensors.values()))])

    def values(self, x: Float[Array, " k"], run_key: Array) -> Values:
        """Values of a run by key."""
        drawn = dispersed_values.draw(self._file, run_key, {})
        return {**drawn, **self.noises.values(x[: self.noises.count]), **self._changed(x)}

    def detector(self, x: np.ndarray) -> DetectorParams:
        """Parameters of the detector at coordinates (k,), as a file holds them."""
        networks = trained_tensors.with_tensors(self._networks, self._changed(jnp.asarray(x)))
        return round_to_half_precision(networks.detector)

    def _changed(self, x: Float[Array, " k"]) -> Values:
        found, first = {}, self.noises.count
        for key, tensor in self._tensors.items():
            change = x[first : first + tensor.size].reshape(tensor.shape)
            found[key] = jnp.asarray(tensor, jnp.float64) + _TENSOR_UNIT * change
            first += tensor.size
        return found


def _moved_tensors(networks: Networks) -> dict[str, Array]:
    """Biases and last layers of the detector by key, without those of masks, which only a training uses."""
    return {
        key: value
        for key, value in trained_tensors.tensors(networks).items()
        if key.startswith(trained_tensors.DETECTOR)
        and (key.endswith(".bias") or key.removeprefix(trained_tensors.DETECTOR) in _LAST_LAYERS)
        and "out_mask" not in key
    }


def check(file: ScenarioFile) -> None:
    """Refuses scenarios whose detector cannot be refined.

    Raises:
        RpojaxError: the camera is not rendered, or runs are not independent.
    """
    if file.camera.model != "rendered":
        expected = "'rendered', whose detector is refined (--set camera.model=rendered)"
        raise ScenarioError("camera.model", file.camera.model, expected)
    if not has_independent_runs(file):
        raise RpojaxError(f"design: found {file.design.kind!r}, expected 'independent' for derivatives")


def refine(
    file: ScenarioFile,
    settings: RefinementSettings,
    on_step: Callable[[int, str], None] = lambda number, words: None,
) -> Refined:
    """Noises and detector after a descent on the objective of fresh runs in each step.

    The objective is the mean over runs of the logarithm of the navigation error and of the negative log likelihood of
    the truth under the estimate. `on_step` gets the number of steps done, and words.

    Raises:
        RpojaxError: the scenario has no detector, does not suit the time of the runs, or no run has a gradient.
    """
    check(file)
    used = scenario_loader.with_duration(file, settings.horizon_s)
    coordinates = _Coordinates(used)
    x, cotangent = coordinates.initial, jax.grad(objective)
    evaluator = RolloutEvaluator(
        used,
        coordinates.values,
        len(x),
        _METRICS,
        settings.runs,
        cotangent=cotangent,
        on_stage=lambda words: on_step(0, words),
    )
    evaluator.soften_detector(settings.temperature)
    optimizer = optax.scale_by_adam()
    adam, objectives, begin = optimizer.init(x), [], time.perf_counter()
    rate = optax.cosine_decay_schedule(settings.rate, settings.steps, 0.1)
    for number in range(settings.steps):
        keys = run_keys(settings.seed, number * settings.runs + np.arange(settings.runs))
        found = evaluator.gradient(np.tile(x, (settings.runs, 1)), keys)
        assert found.gradient is not None
        total, excluded, _ = clipped_sum(found.gradient)
        if excluded == settings.runs:
            raise RpojaxError(f"step {number + 1}: found no run with a finite gradient, expected some")
        objectives.append(float(objective(jnp.asarray(found.metrics), jnp.ones(settings.runs))))
        with jax.numpy_dtype_promotion("standard"):  # optax mixes types
            updates, adam = optimizer.update(total, adam)
            x = x - np.asarray(rate(number)) * np.asarray(updates)
        on_step(number + 1, f"objective {objectives[-1]:.4f}")
    noises = {key: np.asarray(value).tolist() for key, value in coordinates.noises.values(jnp.asarray(x)).items()}
    steps_s = time.perf_counter() - begin - evaluator.compile_s
    memory = evaluator.program_memory_bytes
    return Refined(noises, coordinates.detector(x), tuple(objectives), evaluator.compile_s, steps_s, memory)


def objective(metrics: Float[Array, "runs metrics"], mask: Float[Array, " runs"]) -> Float[Array, ""]:
    """Mean over the runs of the mask (runs,) with values of the log of the error, and of the surprise, each (runs,)."""
    error, surprise = metrics[:, 0], metrics[:, 1]
    counted = (mask > 0.0) & jnp.isfinite(error) & jnp.isfinite(surprise) & (error > 0.0)
    value = jnp.where(counted, jnp.log(jnp.where(counted, error, 1.0)) + jnp.where(counted, surprise, 0.0), 0.0)
    return jnp.sum(value) / jnp.maximum(jnp.sum(jnp.where(counted, 1.0, 0.0)), 1.0)


def judge(
    start: ScenarioFile,
    refined: ScenarioFile,
    settings: RefinementSettings,
    on_progress: Callable[[float], None] = lambda fraction: None,
) -> UnseenRuns:
    """Unseen runs with the detector as it runs, before and after.

    Raises:
        RpojaxError: no run has a navigation error with both.
    """
    if settings.validation_s is not None:
        start, refined = (scenario_loader.with_duration(each, settings.validation_s) for each in (start, refined))
    pair = []
    for index, file in enumerate((start, refined)):
        done = 0.5 * index
        pair.append(
            tune.simulate_runs(
                file,
                settings.seed + 1,
                settings.validation_runs,
                lambda fraction, done=done: on_progress(done + 0.5 * fraction),
            )
        )
    failed = tuple(int(each.failed.sum()) for each in pair)
    before, after = (each.metrics[NAVIGATION].astype(float) for each in pair)
    return compare(before, after, (failed[0], failed[1]))


def compare(before: np.ndarray, after: np.ndarray, failed: tuple[int, int]) -> UnseenRuns:
    """Comparison of errors (runs,) of the same runs, NaN where there is none.

    Raises:
        RpojaxError: no run has both.
    """
    both = np.isfinite(before) & np.isfinite(after)
    if not both.any():
        raise RpojaxError("unseen runs: found none with a navigation error before and after, expected some")
    pair = np.stack([before[both], after[both]])
    logs = np.log(pair[1] / pair[0])
    drawn = np.random.default_rng(0).integers(len(logs), size=(_RESAMPLES, len(logs)))
    low, high = np.exp(np.quantile(logs[drawn].mean(axis=1), [0.025, 0.975]))
    first, second = (tuple(map(float, np.quantile(pair, q, axis=1))) for q in (0.95, 0.5))
    return UnseenRuns(
        runs=len(logs),
        failed=failed,
        p95=(first[0], first[1]),
        median=(second[0], second[1]),
        ratio=float(np.exp(logs.mean())),
        ratio_95=(float(low), float(high)),
    )
