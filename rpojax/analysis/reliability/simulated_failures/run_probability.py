"""Probability that a run of a scenario fails, estimated from simulated runs in a folder that can be resumed."""

import heapq
import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import scipy

from rpojax.analysis.reliability.described_points import dispersions_at, run_command, values_of
from rpojax.analysis.reliability.rare_events import estimate_by_method
from rpojax.analysis.reliability.rare_events.estimate_probability import MIN_BUDGET
from rpojax.analysis.reliability.rare_events.latent_points import LatentPoints, LimitFunction, LimitStateCalls
from rpojax.analysis.reliability.rare_events.probability_estimate import ProbabilityEstimate
from rpojax.analysis.reliability.search_settings import EstimateSettings, FailureChoice
from rpojax.analysis.reliability.simulated_failures import failure_margin
from rpojax.analysis.reliability.simulated_failures.estimate_folder import RESULT_NAME, EstimateFolder, read_result
from rpojax.analysis.reliability.simulated_failures.failure_margin import Failure, choose_failure
from rpojax.analysis.reliability.simulated_failures.simulated_margins import SimulatedMargins
from rpojax.campaign import argument_checks
from rpojax.campaign.storage.atomic_outputs import to_json_types, write_atomically
from rpojax.campaign.storage.provenance import package_versions
from rpojax.errors import RpojaxError
from rpojax.runtime.progress import Progress, ProgressCallback
from rpojax.scenario.dispersed_numbers import standard_normal_space
from rpojax.scenario.dispersed_numbers.standard_normal_space import StandardNormalSpace
from rpojax.scenario.scenario_digest import scenario_digest
from rpojax.scenario.schema import ScenarioFile
from rpojax.scenario.team.members import refuse_team

MOST = 10
_RUN_ID_MASK = np.uint32(2**31 - 1)
_REPEATS = 256
"""Runs with which failures of chains are repeated, so that a run command can show them."""


@dataclass(frozen=True)
class FailingRun:
    """A failing run.

    Attributes:
        run_id: whose noise it has
        z: (k,) standard normal variables of its dispersions
        margin: to the failure
    """

    run_id: int
    z: np.ndarray
    margin: float

    @property
    def distance(self) -> float:
        """Distance of its dispersions from the median run [sigmas]."""
        return float(np.linalg.norm(self.z))


class FailureLog:
    """Keeps the most likely failures of all points that pass through.

    Attributes:
        own_noise: failures with the noise of a run number, which a run command can repeat
        any_noise: all failures
    """

    def __init__(self) -> None:
        self.own_noise: list[tuple[float, int, FailingRun]] = []
        self.any_noise: list[tuple[float, int, FailingRun]] = []
        self._count = itertools.count()

    def watched(self, function: LimitFunction) -> LimitFunction:
        """The function, whose failures are kept."""

        def margins(points: LatentPoints) -> np.ndarray:
            found = function(points)
            for row in np.flatnonzero(found <= 0.0):
                run = FailingRun(int(points.keys[row, 0] & _RUN_ID_MASK), points.x[row].copy(), float(found[row]))
                self._keep(self.any_noise, run)
                if not points.keys[row, 1:].any():
                    self._keep(self.own_noise, run)
            return found

        return margins

    def _keep(self, heap: list[tuple[float, int, FailingRun]], run: FailingRun) -> None:
        if any(entry[2].run_id == run.run_id and np.array_equal(entry[2].z, run.z) for entry in heap):
            return
        entry = (-run.distance, next(self._count), run)
        if len(heap) < MOST:
            heapq.heappush(heap, entry)
        else:
            heapq.heappushpop(heap, entry)

    @property
    def most_likely(self) -> list[FailingRun]:
        """Failures that can be repeated, the most likely dispersions first."""
        return sorted((entry[2] for entry in self.own_noise), key=lambda run: run.distance)

    @property
    def unrepeatable(self) -> list[FailingRun]:
        """Most likely failures whatever their noise."""
        return sorted((entry[2] for entry in self.any_noise), key=lambda run: run.distance)


def repeated_with_own_noise(log: FailureLog, margins: LimitFunction, rng: np.random.Generator, tries: int) -> int:
    """Simulates the dispersions of failures that cannot be repeated with the noise of new runs; the runs it took.

    Failures among them enter the log. `margins` are those of a function that the log watches.
    """
    starts = log.unrepeatable
    if len(log.own_noise) >= MOST or not starts:
        return 0
    x = np.stack([starts[number % len(starts)].z for number in range(tries)])
    keys = np.zeros((tries, 2), dtype=np.uint32)
    keys[:, 0] = rng.integers(1, 2**31, tries)
    margins(LatentPoints(x, keys))
    return tries


def write_scenarios(
    space: StandardNormalSpace, seed: int, runs: list[FailingRun], directory: Path
) -> list[dict[str, Any]]:
    """Writes a scenario with the dispersions of each run into a folder; entries with the command that simulates it."""
    import tomli_w

    entries = []
    for number, run in enumerate(runs, 1):
        values = values_of(space, seed, run.z, run.run_id)
        path = directory / "failing_runs" / f"{number:02d}.toml"
        command = run_command(space, path, seed, run.run_id, f"{directory.name}_run_{number:02d}")
        fixed = standard_normal_space.with_fixed_values(space, values)
        write_atomically(path, (f"# {command}\n\n" + tomli_w.dumps(fixed.model_dump(mode="json"))).encode())
        entries.append(
            {
                "run_id": run.run_id,
                "distance_sigmas": run.distance,
                "margin": run.margin,
                "scenario": f"failing_runs/{path.name}",
                "command": command,
                "dispersions": dispersions_at(space, run.z, values),
            }
        )
    return entries


def run_probability(
    file: ScenarioFile,
    choice: FailureChoice,
    settings: EstimateSettings,
    seed: int,
    out: Path,
    *,
    force: bool = False,
    on_progress: ProgressCallback | None = None,
) -> dict[str, Any]:
    """Content of probability.json of an estimate, which goes on where the folder ends, or is there already.

    Args:
        file: the scenario
        choice: which runs fail
        settings: budget and method
        seed: master seed of runs and of the estimate
        out: folder
        force: replace another estimate in the folder
        on_progress: shows the progress

    Raises:
        RpojaxError: an option is out of range, or the folder holds something else.
        UnfinishedError: the folder cannot be written.
    """
    refuse_team(file, "the probability of failure")
    failure = choose_failure(file, choice)
    _check_settings(settings, seed)
    space = standard_normal_space.make_space(file)
    folder = EstimateFolder(out)
    folder.begin(_configuration(file, failure, settings, seed), force)
    if folder.is_finished:
        return read_result(out)
    content = _estimated(space, failure, settings, seed, folder, on_progress or (lambda progress: None))
    folder.write(RESULT_NAME, content)
    return content


def _check_settings(settings: EstimateSettings, seed: int) -> None:
    if not MIN_BUDGET <= settings.budget <= argument_checks.MAX_RUN_ID:
        raise RpojaxError.of_argument("budget", f"found {settings.budget}, expected at least {MIN_BUDGET} runs")
    argument_checks.check_numbers(1, 0, seed, None)


def _configuration(file: ScenarioFile, failure: Failure, settings: EstimateSettings, seed: int) -> dict[str, Any]:
    """What decides the bits of an estimate."""
    return {
        "scenario_name": file.name,
        "scenario_hash": scenario_digest(file),
        "scenario": file.model_dump(mode="json"),
        "failure": failure.to_record(),
        "budget": settings.budget,
        "method": settings.method,
        "seed": seed,
        "versions": {**package_versions(), "scipy": scipy.__version__},
    }


def _estimated(
    space: StandardNormalSpace,
    failure: Failure,
    settings: EstimateSettings,
    seed: int,
    folder: EstimateFolder,
    on_progress: ProgressCallback,
) -> dict[str, Any]:
    watch = _Watch(settings.budget, on_progress)
    simulated, log = SimulatedMargins(space, failure, seed, on_runs=watch.add_runs), FailureLog()
    watch.show(compiled=False)
    simulated.compile()
    watch.show(compiled=True)
    cached = log.watched(folder.cached(simulated))
    calls = LimitStateCalls(lambda points: watch.counted(points, cached), simulated.latent, settings.budget)
    found = estimate_by_method.estimate(calls, np.random.default_rng(seed), settings.method)
    repeats = repeated_with_own_noise(log, cached, np.random.default_rng([seed, 1]), _REPEATS)
    return to_json_types(
        {
            **_without_points(found),
            "scenario": space.file.name,
            "scenario_hash": scenario_digest(space.file),
            "seed": seed,
            "failure": failure.to_record(),
            "requirement": _verdict(failure, found),
            "plain_runs_for_equal_accuracy": _plain_runs(found),
            "repeats": repeats,
            "remark": failure_margin.ranking_remark(failure),
            "noise": "drawn with every run: sensors, hand-over errors, outliers",
            "unmapped": list(space.unmapped),
            "design_points": [
                {
                    "distance_sigmas": point.distance,
                    "share": point.share,
                    "dispersions": dispersions_at(space, point.x, values_of(space, seed, point.x, 0)),
                }
                for point in found.design_points
            ],
            "failing_runs": write_scenarios(space, seed, log.most_likely, folder.directory),
        }
    )


def _without_points(found: ProbabilityEstimate) -> dict[str, Any]:
    content = found.to_dict()
    del content["design_points"]
    return content


def _verdict(failure: Failure, found: ProbabilityEstimate) -> dict[str, Any] | None:
    """The requirement's greatest probability of failure, and what the interval says about it."""
    if failure.required_probability is None:
        return None
    allowed = 1.0 - failure.required_probability
    low, high = found.interval_95
    verdict = "open" if not found.trusted else "met" if high <= allowed else "violated" if low > allowed else "open"
    return {"allowed_probability_of_failure": allowed, "verdict": verdict}


def _plain_runs(found: ProbabilityEstimate) -> float | None:
    """Runs with which plain sampling would have the same coefficient of variation; None without one."""
    if not 0.0 < found.coefficient_of_variation < math.inf or found.probability <= 0.0:
        return None
    return (1.0 - found.probability) / (found.probability * found.coefficient_of_variation**2)


class _Watch:
    """Progress of an estimate: points that are done, of the budget."""

    def __init__(self, budget: int, on_progress: ProgressCallback) -> None:
        self._budget, self._on_progress = budget, on_progress
        self._done, self._failed, self._compiled = 0.0, 0, False

    def show(self, compiled: bool) -> None:
        self._compiled = compiled
        self._on_progress(Progress(self._done, self._budget, self._failed, self._compiled, stage="estimating"))

    def add_runs(self, runs: int, failed: int) -> None:
        self._done, self._failed = min(self._done + runs, float(self._budget)), self._failed + failed
        self.show(self._compiled)

    def counted(self, points: Any, function: Callable[[Any], np.ndarray]) -> np.ndarray:
        before = self._done, self._failed
        found = function(points)
        # Points that are remembered are not simulated.
        self._done, self._failed = before[0] + len(points), before[1] + int((found <= 0.0).sum())
        self.show(self._compiled)
        return found
