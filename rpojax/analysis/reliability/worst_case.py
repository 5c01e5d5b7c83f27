"""Worst case: the most likely combination of dispersions that violates a requirement, confirmed by simulation.

Everything that is not a function of standard normal variables (sensor noise, hand-over errors, choices) keeps what a
run's own random key gives: a search is on one run of a campaign, and several runs are searched.
"""

import dataclasses
import math
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.special import ndtr

from rpojax.analysis.gradients.rollout_evaluator import RolloutEvaluator
from rpojax.analysis.reliability.described_points import dispersions_at, run_command, values_of
from rpojax.analysis.reliability.evaluation_log import EvaluatedPoint, SearchResult
from rpojax.analysis.reliability.form_search import find_design_point
from rpojax.analysis.reliability.search_settings import LimitChoice, SearchSettings
from rpojax.analysis.reliability.simulated_limit_state import (
    EvaluationCosts,
    MetricLimit,
    SimulatedLimitState,
    make_evaluator,
    measure_costs,
    select_limit,
)
from rpojax.campaign import argument_checks, run_and_resume
from rpojax.campaign.storage import folder_creation
from rpojax.campaign.storage.atomic_outputs import check_replaceable, to_json_types, write_atomically, write_json
from rpojax.errors import RpojaxError
from rpojax.optional_packages import require_package
from rpojax.runtime.progress import stage
from rpojax.scenario.dispersed_numbers import standard_normal_space
from rpojax.scenario.dispersed_numbers.standard_normal_space import StandardNormalSpace
from rpojax.scenario.plugins import plugin_registry
from rpojax.scenario.schema import ScenarioFile
from rpojax.scenario.team.members import refuse_team
from rpojax.summary_text import Summarised, Summary, number, numbers

if TYPE_CHECKING:
    import pandas

_OF_DISPERSION = ("name", "kind", "distance_sigmas")
SCENARIO_NAME, RECORD_NAME = "worst_case.toml", "worst_case.json"
_MAX_STARTS = 64
_SHOWN_DISPERSIONS = 4
"""Dispersions of a summary, those farthest from their median."""


@dataclass(frozen=True, repr=False)
class WorstCase(Summarised):
    """The most likely violation of a limit that was found, or the closest approach to it.

    Attributes:
        limit: of the metric
        space: standard normal variables of the scenario
        seed: of the campaign
        search: its result, in those variables
        costs: of runs and gradients
        compile_s: compilation [s]
        values: of the dispersed keys at the reported point, in the user's units
        simulated_value: metric of the confirming run, not a number where it failed; None before it is simulated
    """

    limit: MetricLimit
    space: StandardNormalSpace
    seed: int
    search: SearchResult
    costs: EvaluationCosts
    compile_s: float
    values: dict[str, Any]
    simulated_value: float | None = None

    @property
    def reported_point(self) -> EvaluatedPoint:
        """The nearest violation, or the point with the smallest margin where there is none."""
        return self.search.nearest_violation or self.search.smallest_margin

    @property
    def _unit(self) -> str:
        return plugin_registry.catalogue_of(self.space.file)[self.limit.metric].unit

    @property
    def probability(self) -> float | None:
        """First-order probability of a violation in runs with this run's noise; None without one, or at the median.

        A limit that the median run breaks has no nearest point beyond it: the probability is that of staying within.
        """
        found = self.search.nearest_violation
        return None if found is None or self.breaks_at_median else float(ndtr(-found.distance))

    @property
    def breaks_at_median(self) -> bool:
        """Whether the limit is broken with every dispersion at its median already."""
        found = self.search.nearest_violation
        return found is not None and found.distance == 0.0

    @property
    def lack_of_gradients(self) -> str | None:
        """That the budget allowed no gradient, so that runs and line searches are all there was; None if it did."""
        if self.search.gradient_evaluations > 0 or self.breaks_at_median:
            return None
        batch, each = self.costs.batch_size, self.costs.gradient_run_equivalents
        return (
            f"no gradient was evaluated: a batch of {batch} costs {batch * each:g} run-equivalents, more than the "
            "budget left, so this is the best of random runs and line searches"
        )

    @property
    def pinned_scenario(self) -> ScenarioFile:
        """The scenario with the dispersions of the reported point as choices of one value."""
        return standard_normal_space.with_fixed_values(self.space, self.values)

    @property
    def confirmed(self) -> bool:
        """Whether a violation was found and the confirming run violates the limit, too."""
        if self.search.nearest_violation is None or self.simulated_value is None:
            return False
        return not math.isfinite(self.simulated_value) or self.limit.is_violated(self.simulated_value)

    @property
    def undefined(self) -> bool:
        """Whether what was found is a run without a value of the metric, which no limit bounds."""
        found = self.search.nearest_violation
        return found is not None and not math.isfinite(self.limit.value_at_margin(found.margin))

    def to_dict(self) -> dict[str, Any]:
        """Content of worst_case.json, in the types of JSON."""
        search, limit, point = self.search, self.limit, self.reported_point
        content = {
            "scenario": self.space.file.name,
            "metric": limit.metric,
            "unit": self._unit,
            "bound": limit.bound,
            "limit": limit.limit,
            "seed": self.seed,
            "run_id": point.replicate,
            "found": search.nearest_violation is not None,
            "distance_sigmas": point.distance,
            "probability_first_order": self.probability,
            "alignment": search.alignment,
            "value": limit.value_at_margin(point.margin),
            "value_flown": self.simulated_value,
            "confirmed": self.confirmed,
            "undefined": self.undefined,
            "breaks_at_median": self.breaks_at_median,
            "lack_of_gradients": self.lack_of_gradients,
            "dispersions": self._dispersions(),
            "held": list(self.space.unmapped),
            "cost": self._cost(),
        }
        return to_json_types(content)

    def to_dataframe(self) -> "pandas.DataFrame":
        """Dispersed numbers of the reported point, the farthest from their median first, in the users' units.

        Raises:
            MissingExtraError: pandas is not installed.
        """
        rows = [
            {"key": key + place, "value": value, "nominal": nominal} | {name: entry[name] for name in _OF_DISPERSION}
            for entry in self._dispersions()
            for key, values in entry["values"].items()
            for place, value, nominal in _components(values, entry["nominal"][key])
        ]
        return require_package("pandas").DataFrame(rows, columns=["key", "value", "nominal", *_OF_DISPERSION])

    def _summary(self) -> Summary:
        limit = self.limit
        unit = self._unit.replace("-", "")
        rule = f"{limit.metric} {limit.bound} {limit.limit:g} {unit}".strip()
        told = "no violation found" if self.search.nearest_violation is None else "broken"
        return Summary(f"Worst case of {self.space.file.name}: {rule}: {told}", list(self._summary_rows(unit)))

    def _summary_rows(self, unit: str) -> Iterator[tuple[str, str]]:
        point, value = self.reported_point, self.limit.value_at_margin(self.reported_point.margin)
        where = f"{point.distance:.2f} sigmas from the median, run {point.replicate} of seed {self.seed}"
        found = self.search.nearest_violation is not None
        yield ("nearest" if found else "closest"), f"{number(value)} {unit} at {where}"
        if self.breaks_at_median:
            yield "probability", "none: the median run is beyond the limit already"
        if self.probability is not None:
            yield "probability", f"{self.probability:.2g}, first order, with that run's noise"
        if self.simulated_value is not None:
            verdict = "" if not found else ", confirmed" if self.confirmed else ", NOT confirmed"
            yield "simulated", f"{number(self.simulated_value)} {unit}{verdict}"
        if self.lack_of_gradients is not None:
            yield "search", self.lack_of_gradients
        for entry in self._dispersions()[:_SHOWN_DISPERSIONS]:
            values = ", ".join(f"{key} {numbers(np.asarray(each).tolist())}" for key, each in entry["values"].items())
            yield "dispersions", f"{values} ({entry['distance_sigmas']:.2f} sigmas)"

    def write(self, directory: Path | str, force: bool = False) -> None:
        """Writes worst_case.toml, a scenario to simulate, and worst_case.json into a folder.

        Raises:
            OutputError: a file exists and is not to be replaced by `force`, or cannot be written.
        """
        directory = Path(directory)
        check_replaceable((directory / SCENARIO_NAME, directory / RECORD_NAME), force)
        write_atomically(directory / SCENARIO_NAME, self._scenario_text(directory).encode())
        write_json(directory / RECORD_NAME, self.to_dict())

    def _scenario_text(self, directory: Path) -> str:
        """The pinned scenario as TOML, with the command that simulates it."""
        import tomli_w

        limit, point = self.limit, self.reported_point
        what = "breaks" if self.search.nearest_violation is not None else "comes closest to breaking"
        command = run_command(self.space, directory / SCENARIO_NAME, self.seed, point.replicate, "DIR")
        head = (
            f"# Run {point.replicate} of seed {self.seed} {what} {limit.metric} {limit.bound} "
            f"{limit.limit:g} {self._unit}, {point.distance:.2f} sigmas from the median run.\n"
            f"# {command}\n\n"
        )
        return head + tomli_w.dumps(self.pinned_scenario.model_dump(mode="json"))

    def _dispersions(self) -> list[dict[str, Any]]:
        """Mapped dispersions with their values and sigmas, the farthest from their median first."""
        kinds = {entry.name: entry.kind for entry in self.space.mapped}
        found = dispersions_at(self.space, self.reported_point.z, self.values)
        return [{"name": entry["name"], "kind": kinds[entry["name"]], **entry} for entry in found]

    def _cost(self) -> dict[str, Any]:
        search, costs = self.search, self.costs
        return {
            "run_equivalents": search.cost,
            "run_equivalents_to_first_violation": (
                None if search.first_violation is None else search.first_violation.cost
            ),
            "flights": search.margin_evaluations,
            "gradients": search.gradient_evaluations,
            "batch": costs.batch_size,
            "flight_s": costs.run_s,
            "gradient_s": costs.gradient_s,
            "gradient_flights": costs.gradient_run_equivalents,
            "compile_s": self.compile_s,
        }


def _components(values: Any, nominal: Any) -> Iterator[tuple[str, float, float]]:
    """Place, value and nominal value of each number of a key: an empty place of a number alone, else `[0]`, ..."""
    found, expected = np.asarray(values), np.asarray(nominal)
    expected = np.broadcast_to(expected, found.shape) if expected.size == 1 else expected.reshape(found.shape)
    for place in np.ndindex(found.shape):
        yield "".join(f"[{index}]" for index in place), found[place].item(), expected[place].item()


def worst_case(
    file: ScenarioFile,
    *,
    requirement: str | None = None,
    metric: str | None = None,
    limit: float | None = None,
    bound: str | None = None,
    starts: int = 4,
    budget: float = 400.0,
    seed: int = 0,
    run_directory: Path | str | None = None,
    force: bool = False,
    progress: bool = True,
) -> WorstCase:
    """The most likely combination of dispersions that violates a limit, searched with derivatives and then simulated.

    Args:
        file: scenario with dispersions
        requirement: metric of one of the scenario's requirements
        metric: another metric, in place of `requirement`
        limit: of `metric`, in its unit
        bound: side of `limit` on which the metric must stay, 'at most' or 'at least'; by default where it is better
        starts: searches at a time, each with the sensor noise of another run
        budget: greatest cost of the search, in runs
        seed: master seed of the runs
        run_directory: campaign folder to make for the confirming run; by default it is not kept
        force: replace `run_directory` if it is there
        progress: show progress on stderr

    Raises:
        RpojaxError: an option names no limit or no search, nothing can be moved, or the folder cannot be used.
    """
    choice = LimitChoice(requirement, metric, limit, bound)
    settings = SearchSettings(starts=starts, budget=budget)
    return find_worst_case(file, choice, settings, seed, run_directory=run_directory, force=force, progress=progress)


def find_worst_case(
    file: ScenarioFile,
    choice: LimitChoice,
    settings: SearchSettings,
    seed: int,
    *,
    run_directory: Path | str | None = None,
    force: bool = False,
    progress: bool = True,
) -> WorstCase:
    """The worst case for records of a limit and of settings, as `worst_case` finds it.

    Raises:
        RpojaxError: an option names no limit or no search, nothing can be moved, or the folder cannot be used.
    """
    if run_directory is not None:
        argument_checks.check_folder(Path(run_directory), force)
    refuse_team(file, "derivatives of runs")
    chosen = select_limit(file, choice)
    space = standard_normal_space.make_space(file)
    settings = dataclasses.replace(settings, screening_points=max(settings.screening_points, settings.starts))
    check_settings(settings)
    with stage("searching (compiling takes minutes, seconds the next time)", not progress):
        found = search_worst_case(space, chosen, settings, seed)
    with stage("simulating the worst case", not progress):
        if run_directory is not None:
            with folder_creation.made_whole(Path(run_directory), force) as made:
                return dataclasses.replace(found, simulated_value=simulate_worst_case(found, made))
        with tempfile.TemporaryDirectory() as folder:
            return dataclasses.replace(found, simulated_value=simulate_worst_case(found, Path(folder) / "run"))


def check_settings(settings: SearchSettings) -> None:
    """Refuses settings of a search that finds nothing.

    Raises:
        RpojaxError: naming the argument.
    """
    if not 1 <= settings.starts <= _MAX_STARTS:
        raise RpojaxError.of_argument("starts", f"found {settings.starts}, expected 1 to {_MAX_STARTS}")
    if not settings.budget >= settings.screening_points:
        raise RpojaxError.of_argument(
            "budget", f"found {settings.budget:g}, expected at least the {settings.screening_points} first runs"
        )


def search_worst_case(
    space: StandardNormalSpace,
    limit: MetricLimit,
    settings: SearchSettings,
    seed: int,
    evaluator: RolloutEvaluator | None = None,
    costs: EvaluationCosts | None = None,
) -> WorstCase:
    """The most likely violation of a limit in runs of a seed; a compiled `evaluator` and its `costs` may be reused.

    Raises:
        RpojaxError: the settings can find nothing.
    """
    check_settings(settings)
    used = evaluator or make_evaluator(space, (limit.metric,), settings.starts)
    measured = costs or measure_costs(used)
    found = find_design_point(SimulatedLimitState(used, limit, measured, seed), space.dimension, settings, seed)
    point = found.nearest_violation or found.smallest_margin
    values = values_of(space, seed, point.z, point.replicate)
    return WorstCase(limit, space, seed, found, measured, used.compile_s, values)


def simulate_worst_case(found: WorstCase, directory: Path) -> float:
    """Metric of the reported point, simulated as `rpojax run` does into a campaign folder; NaN if it is frozen.

    Raises:
        RpojaxError: the folder cannot be used.
    """
    campaign = run_and_resume.run_campaign(
        found.pinned_scenario,
        1,
        directory,
        found.seed,
        first_run=found.reported_point.replicate,
        block_size=1,
        progress=False,
    )
    return float(campaign.metrics[found.limit.metric][0])
