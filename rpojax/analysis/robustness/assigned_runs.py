"""Runs with some of their values changed, simulated by one compiled program: what studies of a scenario share."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final

import jax
import numpy as np

from rpojax.campaign import argument_checks
from rpojax.campaign.execution import block_runner
from rpojax.campaign.execution.batch_engine import BatchEngine, fitted_block_size
from rpojax.campaign.execution.passive_safety import NoDrifts
from rpojax.campaign.experiment_design import Design, make_design
from rpojax.campaign.options.history_retention import Retention
from rpojax.campaign.storage.provenance import package_versions
from rpojax.core.pytree import concatenate
from rpojax.dispersions.designs.design_sections import GridDesign
from rpojax.dispersions.designs.run_range import RunRange
from rpojax.errors import RpojaxError
from rpojax.runtime import programs_per_device
from rpojax.runtime.progress import Progress, ProgressCallback
from rpojax.scenario.dispersed_numbers import dispersed_values
from rpojax.scenario.dispersed_numbers.dispersion_keys import design_keys, varied_keys
from rpojax.scenario.parameter_keys import nominal_of_key
from rpojax.scenario.scenario_digest import scenario_digest
from rpojax.scenario.schema import ScenarioFile
from rpojax.scenario.team.members import refuse_team
from rpojax.simulation.noise import run_keys
from rpojax.simulation.outcomes.outcome_kinds import of_codes

Values = Mapping[str, np.ndarray]
BatchCallback = Callable[[float, int, int], None]
"""Called with the finished fraction of a batch, the number of its runs, and of those that failed."""
_MOST_RUNS: Final = 100_000


def check_study(file: ScenarioFile, purpose: str, runs: int, seed: int) -> None:
    """Refuses what cannot be studied, before anything is simulated.

    Raises:
        RpojaxError: naming the argument or the key.
    """
    refuse_team(file, purpose)
    argument_checks.check_numbers(runs, 0, seed, None)
    if runs > _MOST_RUNS:
        raise RpojaxError.of_argument("runs", f"found {runs}, expected at most {_MOST_RUNS} runs of each step")
    if design_keys(file):
        raise RpojaxError(f"design.kind: found {file.design.kind!r}, expected a design whose values dispersions draw")


def provenance(file: ScenarioFile, runs: int, seed: int, free_drifts: bool) -> dict[str, Any]:
    """What a study's record says of its scenario, runs and versions."""
    return {
        "scenario": file.name,
        "scenario_hash": scenario_digest(file),
        "seed": seed,
        "runs": runs,
        "free_drifts": free_drifts,
        "versions": package_versions(),
    }


class AssignedRuns:
    """Runs 0 to `runs` - 1 of a seed, with some of their values changed.

    Every number that varies is assigned to the runs: as the scenario's dispersions draw it, or changed. So all changes
    share one program and the same random numbers.

    Attributes:
        ids: (runs,) numbers of the runs
        values: key -> (runs, ...) without a change
    """

    def __init__(
        self, file: ScenarioFile, keys: Sequence[str], runs: int, seed: int, free_drifts: bool, at_once: int
    ) -> None:
        """`keys` are those that may be changed; a batch holds the runs of `at_once` changes, if it can."""
        self._seed, self.ids, self._free_drifts = seed, np.arange(runs), free_drifts
        self.values = values_of_runs(file, keys, seed, self.ids)
        grid = GridDesign.model_construct(kind="grid", values={key: [] for key in self.values})
        assigned = file.model_copy(update={"dispersions": [], "design": grid})
        devices = programs_per_device.choose_devices()
        size = fitted_block_size(file, at_once * runs, len(devices))
        self._engine = BatchEngine(assigned, size, devices, design=Design(RunRange(0, runs), self.values))
        if not free_drifts:
            engine = self._engine
            batch = (assigned, engine.scenario, engine.member_params[0], engine.runs_per_device, engine.devices)
            engine.passive_safety = NoDrifts(*batch)

    def compile(self) -> None:
        """Compiles the programs, once."""
        self._engine.compile()

    def simulate_changes(self, changes: Sequence[Values], on_batch: BatchCallback) -> list[dict[str, np.ndarray]]:
        """Metrics and `outcomes` (runs,) by name with the values (runs, ...) of each change in place of the own ones.

        `on_batch` is called during it.
        """
        runs, capacity = len(self.ids), self._engine.capacity
        moved = [{**self.values, **change} for change in changes]
        rows = {key: np.concatenate([values[key] for values in moved]) for key in self.values}
        parts = []
        for first in range(0, len(changes) * runs, capacity):
            places = np.arange(first, first + capacity)
            unpadded = places < len(changes) * runs
            parts.append(self._simulate(rows, np.where(unpadded, places, first), unpadded, on_batch))
        joined = concatenate(parts)
        return [
            {name: values[k * runs : (k + 1) * runs] for name, values in joined.items()} for k in range(len(changes))
        ]

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
            self.ids[places % len(self.ids)],
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


class StudyProgress:
    """Progress of a study: runs that are done, of those of the rounds so far."""

    def __init__(self, runs: int, on_progress: ProgressCallback, stage: str = "simulating steps") -> None:
        self._stage, self._runs, self._on_progress = stage, runs, on_progress
        self.done, self._failed, self._total = 0, 0, runs

    def show(self, compiled: bool, more: float = 0.0, failed: int = 0) -> None:
        done = Progress(self.done + more, self._total, self._failed + failed, compiled, stage=self._stage)
        self._on_progress(done)

    def round(self, steps: int) -> BatchCallback:
        """Callback for the batches of a round of steps."""
        self._total = self.done + steps * self._runs

        def on_batch(fraction: float, runs: int, failed: int) -> None:
            if fraction < 1.0:
                self.show(True, fraction * runs, failed)
            else:
                self.done, self._failed = self.done + runs, self._failed + failed
                self.show(True)

        return on_batch
