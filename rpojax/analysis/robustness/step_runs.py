"""Runs of steps: the same runs with one quantity moved, simulated by one compiled program, and what they break."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final

import jax
import numpy as np

from rpojax.analysis.robustness.believed_quantities import Quantity
from rpojax.analysis.robustness.margin_search import StepVerdict
from rpojax.analysis.statistics.intervals import success_bounds
from rpojax.campaign.execution import block_runner
from rpojax.campaign.execution.batch_engine import BatchEngine, fitted_block_size
from rpojax.campaign.execution.passive_safety import NoDrifts
from rpojax.campaign.experiment_design import Design, make_design
from rpojax.campaign.options.history_retention import Retention
from rpojax.core.pytree import concatenate
from rpojax.dispersions.designs.design_sections import GridDesign
from rpojax.dispersions.designs.run_range import RunRange
from rpojax.runtime import programs_per_device
from rpojax.scenario.dispersed_numbers import dispersed_values
from rpojax.scenario.dispersed_numbers.dispersion_keys import varied_keys
from rpojax.scenario.parameter_keys import nominal_of_key
from rpojax.scenario.schema import RequirementSection, ScenarioFile
from rpojax.simulation.noise import run_keys
from rpojax.simulation.outcomes.outcome_kinds import Outcome, of_codes
from rpojax.simulation.outcomes.requirement_violations import counts, required_values, violates

COMPLETED: Final = "completed"
"""Name under which runs that fail are counted, beside the requirements."""
DEFAULT_PROBABILITY, DEFAULT_RISK = 0.99, 0.1
"""Share of runs that must not fail, and its risk, in a scenario without requirements."""
_STEPS_AT_ONCE: Final = 4
"""Steps that a batch holds: a round of few sides wastes little."""
BatchCallback = Callable[[float, int, int], None]
"""Called with the finished fraction of a batch, the number of its runs, and of those that failed."""
Step = tuple[Quantity, float]
"""A quantity and its offset, in its unit."""


class StepRuns:
    """Runs 0 to `runs` - 1 of a seed, with quantities moved.

    Every number that varies is assigned to the runs: as the scenario's dispersions draw it, and moved. So all steps
    share one program and the same random numbers.
    """

    def __init__(
        self, file: ScenarioFile, quantities: Sequence[Quantity], runs: int, seed: int, free_drifts: bool
    ) -> None:
        self._seed, self._ids, self._free_drifts = seed, np.arange(runs), free_drifts
        self._values = values_of_runs(file, [key for each in quantities for key in each.keys], seed, self._ids)
        grid = GridDesign.model_construct(kind="grid", values={key: [] for key in self._values})
        assigned = file.model_copy(update={"dispersions": [], "design": grid})
        devices = programs_per_device.choose_devices()
        size = fitted_block_size(file, _STEPS_AT_ONCE * runs, len(devices))
        self._engine = BatchEngine(assigned, size, devices, design=Design(RunRange(0, runs), self._values))
        if not free_drifts:
            engine = self._engine
            batch = (assigned, engine.scenario, engine.member_params[0], engine.runs_per_device, engine.devices)
            engine.passive_safety = NoDrifts(*batch)

    def compile(self) -> None:
        """Compiles the programs, once."""
        self._engine.compile()

    def simulate(self, steps: Sequence[Step], on_batch: BatchCallback) -> list[dict[str, np.ndarray]]:
        """Metrics and `outcomes` (runs,) by name of each step; `on_batch` is called during it."""
        runs, capacity = len(self._ids), self._engine.capacity
        moved = [{**self._values, **each.moved(self._values, offset, self._ids)} for each, offset in steps]
        rows = {key: np.concatenate([values[key] for values in moved]) for key in self._values}
        parts = []
        for first in range(0, len(steps) * runs, capacity):
            places = np.arange(first, first + capacity)
            unpadded = places < len(steps) * runs
            parts.append(self._simulate(rows, np.where(unpadded, places, first), unpadded, on_batch))
        joined = concatenate(parts)
        return [{name: values[k * runs : (k + 1) * runs] for name, values in joined.items()} for k in range(len(steps))]

    def _simulate(
        self,
        rows: Mapping[str, np.ndarray],
        places: np.ndarray,
        unpadded: np.ndarray,
        on_batch: BatchCallback,
    ) -> dict[str, np.ndarray]:
        count = int(unpadded.sum())
        batch = block_runner.simulate_batch(
            self._engine,
            self._seed,
            self._ids[places % len(self._ids)],
            [],
            unpadded,
            Retention.from_run_ids(()),
            lambda fraction, failed: on_batch(fraction, count, failed),
            drifts=self._free_drifts,
            assigned={key: values[places] for key, values in rows.items()},
        )
        arrays = batch.block_arrays(slice(0, count), self._engine)
        found = {name.removeprefix("metrics/"): each for name, each in arrays.items() if name.startswith("metrics/")}
        return {**found, "outcomes": of_codes(arrays["status/failure"])}


def values_of_runs(file: ScenarioFile, keys: Sequence[str], seed: int, run_ids: np.ndarray) -> dict[str, np.ndarray]:
    """Values (runs, ...) of all keys that vary, as drawn for the runs, and of further `keys`, which have one value."""
    assigned = make_design(file, seed, RunRange(0, len(run_ids))).for_runs(run_ids)
    draw = jax.jit(jax.vmap(lambda key, own: dispersed_values.draw(file, key, own)))
    drawn = draw(run_keys(seed, run_ids), assigned)
    found = {key: np.asarray(drawn[key], dtype=np.float64) for key in varied_keys(file)}
    for key in keys:
        if key not in found:
            nominal = np.asarray(nominal_of_key(file, key), dtype=np.float64)
            found[key] = np.broadcast_to(nominal, (len(run_ids), *nominal.shape))
    return found


def requirement_names(requirements: Sequence[RequirementSection]) -> list[str]:
    """Name of each requirement: its metric, with the limit where several are on one metric."""
    names = [each.metric_name for each in requirements]
    return [
        f"{name} {each.bound} {each.limit:g}" if names.count(name) > 1 else name
        for name, each in zip(names, requirements, strict=True)
    ]


def judge_step(
    requirements: Sequence[RequirementSection], found: Mapping[str, np.ndarray], judged: Sequence[str] | None = None
) -> StepVerdict:
    """Verdict on the runs of a step, on what is named in `judged`, by default on all whose metrics there are.

    The share of runs that fail must not exceed what the strictest requirement allows to violate it.
    """
    probability = max((each.probability for each in requirements), default=DEFAULT_PROBABILITY)
    risk = min((each.consumer_risk for each in requirements), default=DEFAULT_RISK)
    failed = np.isin(found["outcomes"], [str(kind) for kind in Outcome if kind.is_failure])
    rows = {COMPLETED: (int(failed.sum()), len(failed), probability, risk)}
    for name, each in zip(requirement_names(requirements), requirements, strict=True):
        if each.metric_name in found:
            counted = counts(each, found, found["outcomes"])
            broken = violates(each, required_values(each, found)) & counted
            rows[name] = (int(broken.sum()), int(counted.sum()), each.probability, each.consumer_risk)
    rows = {name: row for name, row in rows.items() if judged is None or name in judged}
    bounds = {name: success_bounds(number, total, risk) for name, (number, total, _, risk) in rows.items() if total}
    excess = {name: number / total / (1.0 - share) for name, (number, total, share, _) in rows.items() if total}
    # Whole numbers of violations that meet the probability exactly are allowed.
    broken = [name for name in excess if excess[name] > 1.0 + 1e-9]
    return StepVerdict(
        broken=tuple(sorted(broken, key=lambda name: -excess[name])),
        surely_broken=any(bounds[name][1] < rows[name][2] for name in bounds),
        surely_holds=all(bounds[name][0] >= rows[name][2] for name in bounds),
        record=_record(rows, found["outcomes"]),
    )


def _record(rows: Mapping[str, tuple[Any, ...]], outcomes: np.ndarray) -> dict[str, Any]:
    kinds, numbers = np.unique(outcomes, return_counts=True)
    return {
        "violations": {name: row[0] for name, row in rows.items()},
        "outcomes": dict(zip(kinds.tolist(), numbers.tolist(), strict=True)),
    }
