"""Tuning of gains and filter noises by gradient, and validation of the result on runs never used in tuning."""

import dataclasses
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rpojax.analysis.gradients.tuning import gradient_descent, tunable_parameters, tuned_file
from rpojax.analysis.gradients.tuning.gradient_descent import TuningResult, TuningStep
from rpojax.analysis.gradients.tuning.tuning_settings import TuningSettings
from rpojax.analysis.statistics import paired_comparison
from rpojax.analysis.statistics.paired_comparison import MIN_PAIRS, PairedComparison, RunMetrics
from rpojax.campaign.execution import block_runner
from rpojax.campaign.execution.batch_engine import BatchEngine, default_block_size
from rpojax.campaign.experiment_design import make_design
from rpojax.campaign.options.history_retention import Retention
from rpojax.campaign.storage.atomic_outputs import check_replaceable, to_json_types, write_atomically, write_json
from rpojax.core.pytree import concatenate
from rpojax.dispersions.designs.run_range import RunRange
from rpojax.errors import RpojaxError
from rpojax.flight.stages import Stages
from rpojax.optional_packages import require_package
from rpojax.runtime.programs_per_device import share_runs
from rpojax.runtime.progress import items
from rpojax.scenario.loading import scenario_loader
from rpojax.scenario.parameter_keys import nominal_of_key
from rpojax.scenario.schema import ScenarioFile
from rpojax.simulation.outcomes.outcome_kinds import of_codes
from rpojax.summary_text import Summarised, Summary, counted, numbers

if TYPE_CHECKING:
    import pandas

OnProgress = Callable[[float], None]
_RESAMPLES = 999
_METRICS = "metrics/"
_SUMMARY_METRICS = (
    "nees_mean",
    "nav_relative_position_error_rms_m",
    "formation_error_rms_m",
    "delta_v_m_s",
    "pointing_error_p95_deg",
)
"""Metrics whose means a summary shows."""


@dataclass(frozen=True)
class MeanChange:
    """Mean of a metric over runs that have it in both settings, and 95 % intervals from resampled pairs.

    The intervals are None with fewer pairs than `paired_comparison.MIN_PAIRS`.
    """

    pairs: int
    first: float
    second: float
    first_95: tuple[float, float] | None
    second_95: tuple[float, float] | None
    ratio: float
    ratio_95: tuple[float, float] | None


@dataclass(frozen=True)
class Validation:
    """Paired comparison of two settings of a scenario.

    Attributes:
        seed: of the runs
        baseline: runs with the initial settings
        tuned: the same runs with the tuned ones
        medians: comparison of medians, failures and requirements
        means: comparison of means by metric
    """

    seed: int
    baseline: RunMetrics
    tuned: RunMetrics
    medians: PairedComparison
    means: dict[str, MeanChange]

    @property
    def undefined(self) -> dict[str, tuple[int, int]]:
        """Runs without a value with either setting, by metric that some do not have; means leave them out."""
        counts = {
            name: (int(np.isnan(values).sum()), int(np.isnan(self.tuned.metrics[name]).sum()))
            for name, values in self.baseline.metrics.items()
        }
        return {name: count for name, count in counts.items() if any(count)}


def validate(
    baseline: ScenarioFile,
    tuned: ScenarioFile,
    seed: int,
    runs: int,
    on_progress: OnProgress = lambda fraction: None,
    stages: Stages | None = None,
) -> Validation:
    """Simulates `runs` runs with both settings and compares them pair by pair."""
    one = simulate_runs(baseline, seed, runs, lambda fraction: on_progress(0.5 * fraction), stages)
    other = simulate_runs(tuned, seed, runs, lambda fraction: on_progress(0.5 + 0.5 * fraction), stages)
    medians = paired_comparison.compare_paired_runs(one, other, baseline.requirements, independent=True)
    return Validation(seed, one, other, medians, compare_means(one, other))


def simulate_runs(
    file: ScenarioFile,
    seed: int,
    runs: int,
    on_progress: OnProgress = lambda fraction: None,
    stages: Stages | None = None,
) -> RunMetrics:
    """Metrics of runs 0 to `runs` - 1 of a seed, simulated in memory."""
    devices, size = share_runs(runs, default_block_size(file))
    engine = BatchEngine(file, size, devices, stages, make_design(file, seed, RunRange(0, runs)))
    batches = -(-runs // engine.capacity)
    results = []
    for number in range(batches):
        ids = number * engine.capacity + np.arange(engine.capacity)

        def during(fraction: float, _: int, number: int = number) -> None:
            on_progress((number + fraction) / batches)

        block = block_runner.simulate_batch(engine, seed, ids, [], ids < runs, Retention.from_run_ids(()), during)
        results.append(block.block_arrays(slice(0, min(engine.capacity, runs - int(ids[0]))), engine))
    joined = concatenate(results)
    metrics = {name.removeprefix(_METRICS): values for name, values in joined.items() if name.startswith(_METRICS)}
    return RunMetrics(np.arange(runs), of_codes(joined["status/failure"]), metrics)


def compare_means(one: RunMetrics, other: RunMetrics) -> dict[str, MeanChange]:
    """Means by metric over the runs that have it in both settings.

    Left out where they give no ratio: a mean that may be zero or of either sign, as of correlations.
    """
    rng = np.random.default_rng(0)
    found = {}
    for name in one.metrics:
        pair = np.stack([one.metrics[name], other.metrics[name]]).astype(float)
        pair = pair[:, np.isfinite(pair).all(axis=0)]
        pairs = pair.shape[1]
        if pairs == 0:
            continue
        drawn = rng.integers(pairs, size=(_RESAMPLES, pairs))
        resampled = pair[:, drawn].mean(axis=2)
        first, second = map(float, pair.mean(axis=1))
        if resampled[0].min() <= 0.0 <= resampled[0].max():
            continue
        samples = (*resampled, resampled[1] / resampled[0])
        first_95, second_95, ratio_95 = map(_interval_95, samples) if pairs >= MIN_PAIRS else (None, None, None)
        found[name] = MeanChange(pairs, first, second, first_95, second_95, second / first, ratio_95)
    return found


def _interval_95(samples: np.ndarray) -> tuple[float, float]:
    low, high = np.quantile(samples, [0.025, 0.975])
    return float(low), float(high)


@dataclass(frozen=True, repr=False)
class Tuning(Summarised):
    """A finished tuning.

    Attributes:
        initial: scenario that was tuned
        scenario: the tuned scenario
        settings: of the tuning
        result: of the gradient descent
        validation: of the tuned scenario against the initial one; None without validation runs
        total_s: time of everything [s]
    """

    initial: ScenarioFile
    scenario: ScenarioFile
    settings: TuningSettings
    result: TuningResult
    validation: Validation | None
    total_s: float

    @property
    def values(self) -> dict[str, Any]:
        """Tuned values by scenario key, in the user's units."""
        return self.result.values

    def to_dict(self) -> dict[str, Any]:
        """Content of the JSON file, in the types of JSON."""
        result = self.result
        content: dict[str, Any] = {
            "scenario": self.initial.name,
            "settings": self.settings.descent_record(),
            "weights": self.initial.tuning.model_dump(),
            "changes": {
                key: {"from": nominal_of_key(self.initial, key), "to": value} for key, value in result.values.items()
            },
            "mode": result.mode,
            "compile_s": result.compile_s,
            "tuning_s": sum(step.run_s for step in result.steps),
            "total_s": self.total_s,
            "memory_mb": result.memory_bytes / 1e6,
            "steps": [dataclasses.asdict(step) for step in result.steps],
        }
        if self.validation is not None:
            content["judged"] = _validation_entry(self.validation)
        return to_json_types(content)

    def to_dataframe(self) -> "pandas.DataFrame":
        """Steps of the descent, one a row by `step`: objective, its parts as `part.NAME`, norm of the gradient, runs.

        `undefined.NAME` is the number of runs without a value of a part, which count as the worst.

        Raises:
            MissingExtraError: pandas is not installed.
        """
        tables = require_package("pandas")
        rows = []
        for step in self.result.steps:
            entry = dataclasses.asdict(step)
            for column, field in (("part", "parts"), ("undefined", "undefined")):
                entry |= {f"{column}.{name}": value for name, value in entry.pop(field).items()}
            rows.append(entry)
        return tables.DataFrame(rows, index=tables.RangeIndex(1, len(rows) + 1, name="step"))

    def _summary(self) -> Summary:
        steps = self.result.steps
        return Summary(f"Tuning of {self.initial.name} in {counted(len(steps), 'step')}", list(self._summary_rows()))

    def _summary_rows(self) -> Iterator[tuple[str, str]]:
        for key, value in self.result.values.items():
            yield "tuned", f"{key}: {numbers(nominal_of_key(self.initial, key))} -> {numbers(value)}"
        first, last = self.result.steps[0], self.result.steps[-1]
        yield "objective", f"{first.objective:.4f} -> {last.objective:.4f}, of other runs"
        if self.validation is None:
            yield "unseen", "not validated"
            return
        found = self.validation
        start, tuned = (int(each.failed.sum()) for each in (found.baseline, found.tuned))
        yield "unseen", f"{counted(len(found.baseline.run_ids), 'run')}, failed {start} -> {tuned}"
        for name in _SUMMARY_METRICS:
            if change := found.means.get(name):
                ends = change.ratio_95
                interval = f"{ends[0]:.3g} to {ends[1]:.3g}" if ends else f"no interval from {change.pairs} pairs"
                means = f"{change.first:.4g} -> {change.second:.4g}"
                yield "means", f"{name}: {means}, ratio {change.ratio:.3g} ({interval})"

    def write(self, path: Path | str, force: bool = False, extends: str | Path | None = None) -> None:
        """Writes the tuned scenario as TOML, and beside it a JSON file of the same name.

        Args:
            path: of the scenario
            force: replace files that are there
            extends: packaged name or file of the scenario that was tuned, of which the new file holds the numbers that
                differ; by default a packaged scenario of its name. A file that differs in more is written as a whole.

        Raises:
            OutputError: a file exists and is not to be replaced by `force`, or cannot be written.
        """
        path = Path(path)
        report = path.with_suffix(".json")
        check_replaceable((path, report), force)
        write_json(report, self.to_dict())
        text = tuned_file.extending_text(self.scenario, str(extends or self.initial.name), path)
        write_atomically(path, self._encoded(text or self._whole_text, report.name))
        if text is not None and not self._is_read_from(path):
            write_atomically(path, self._encoded(self._whole_text, report.name))

    @property
    def _whole_text(self) -> str:
        import tomli_w

        return tomli_w.dumps(self.scenario.model_dump(mode="json", exclude_none=True))

    def _encoded(self, text: str, report: str) -> bytes:
        """A text of the scenario below comments on what was tuned."""
        names = ", ".join(self.settings.parameters)
        lines = [f"# {self.initial.name} with {names} tuned by gradient; {report} holds the steps and the validation"]
        for key, value in self.result.values.items():
            lines.append(f"# {key}: {numbers(nominal_of_key(self.initial, key))} -> {numbers(value)}")
        return "\n".join([*lines, text]).encode("utf-8", "backslashreplace")

    def _is_read_from(self, path: Path) -> bool:
        """Whether a file is read as the tuned scenario."""
        try:
            return scenario_loader.load(path).model_dump() == self.scenario.model_dump()
        except RpojaxError:
            return False


def tune(
    file: ScenarioFile,
    parameters: Sequence[str] = ("navigation",),
    *,
    runs: int = 64,
    steps: int = 80,
    horizon_s: float | None = None,
    rate: float = 0.2,
    validation_runs: int = 500,
    seed: int = 0,
    progress_file: Path | str | None = None,
    resume: bool = False,
    stages: Stages | None = None,
    progress: bool = True,
) -> Tuning:
    """Tunes gains and filter noises by gradient, and compares the result with the start on runs never used in tuning.

    Args:
        file: scenario to tune; its section `tuning` holds the weights of the objective
        parameters: groups (navigation, pose, gate, formation, attitude, schedule) and scenario keys
        runs: per step
        steps: of the gradient descent
        horizon_s: simulated time of a run [s]; None for 2000 s at most, of several phases for all of them
        rate: size of the first steps, in logarithms of the numbers; 0.2 is about twenty per cent
        validation_runs: unseen full runs, of seed `seed + 1`; 0 for no validation
        seed: master seed of the runs
        progress_file: JSON file that keeps every step, to resume an interrupted tuning from
        resume: go on from `progress_file`
        stages: of the flight software, replaced ones included
        progress: show progress on stderr

    Raises:
        RpojaxError: an argument is out of range, the scenario cannot be tuned, or no step has a finite gradient.
    """
    settings = TuningSettings(tuple(parameters), runs, steps, horizon_s, rate, validation_runs, seed)
    return run_tuning(file, settings, progress_file, resume=resume, stages=stages, progress=progress)


def run_tuning(
    file: ScenarioFile,
    settings: TuningSettings,
    progress_file: Path | str | None = None,
    *,
    resume: bool = False,
    stages: Stages | None = None,
    progress: bool = True,
) -> Tuning:
    """Tunes a scenario with a record of settings, as `tune` does.

    Raises:
        RpojaxError: the scenario cannot be tuned, or no step has a finite gradient.
    """
    settings = dataclasses.replace(settings, horizon_s=tunable_parameters.horizon(file, settings))
    kept = None if progress_file is None else Path(progress_file)
    begin = time.perf_counter()
    with items("tuning", quiet=not progress) as watch:
        result = gradient_descent.descend(
            file,
            settings,
            kept,
            resume,
            lambda number, step: watch(number, settings.steps, _progress_text(step, settings.runs)),
            stages,
            lambda number, words: watch(number, settings.steps, words),
        )
    tuned = tuned_scenario(file, result.values)
    validation = _validate(file, tuned, settings, stages, progress) if settings.validation_runs else None
    return Tuning(file, tuned, settings, result, validation, time.perf_counter() - begin)


def _progress_text(step: TuningStep, runs: int) -> str:
    """Objective of a step, and which of its parts some of the runs have no value of."""
    missing = [f"{name} undefined in {count} of {runs} runs" for name, count in step.undefined.items() if count]
    return ", ".join([f"objective {step.objective:.4f}", *missing])


def _validate(
    file: ScenarioFile, tuned: ScenarioFile, settings: TuningSettings, stages: Stages | None, progress: bool
) -> Validation:
    seed, runs = settings.seed + 1, settings.validation_runs
    with items("validating", quiet=not progress) as watch:
        return validate(file, tuned, seed, runs, lambda fraction: watch(round(100 * fraction), 100), stages)


def tuned_scenario(file: ScenarioFile, values: dict[str, Any]) -> ScenarioFile:
    """The scenario with other values, in the user's units, for some of its keys."""
    tables = file.model_dump(mode="json")
    for key, value in values.items():
        section, _, name = key.partition(".")
        tables[section][name] = value
    return scenario_loader.validate(tables)


def _validation_entry(found: Validation) -> dict[str, Any]:
    return {
        "seed": found.seed,
        "runs": len(found.baseline.run_ids),
        "failed": [int(each.failed.sum()) for each in (found.baseline, found.tuned)],
        "undefined": found.undefined,
        "means": {name: dataclasses.asdict(change) for name, change in found.means.items()},
        "medians": [dataclasses.asdict(change) for change in found.medians.metrics],
    }
