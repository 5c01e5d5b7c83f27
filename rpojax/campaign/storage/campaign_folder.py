"""The folder of a campaign.

| path | holds |
|---|---|
| `campaign.json` | scenario, its hash, seed, runs, block size, versions, device; written before anything is compiled |
| `scenario.toml` | the scenario as a file that `rpojax run` takes |
| `results.zarr` | of every run: `metrics/NAME`, `status/NAME`, `events/NAME`, `drawn/KEY`, `used/KEY`, `traces/NAME` |
| `results.zarr/coverage` | of every run of a scenario with coverage: `lit_samples`, `seen_samples` of each facet |
| `results.zarr/servicer_GROUP` | of every run of a team: `NAME` of each servicer, which are the second axis |
| `results.zarr/phases` | of every run of a scenario with phases: `NAME` of each phase, and its transitions |
| `results.zarr/signs` | of every run: `NAME` in intervals of time, signs of what goes wrong |
| `results.zarr/surface` | facets of the target, of a scenario with coverage |
| `results.zarr/histories/RUN` | channels of a run with a history, time first |
| `manifest/000000.json` | one per finished block, written last; a resume runs the blocks without one |
| `looks.json` | looks that a sequential campaign has taken, with their verdicts |
| `requirements/000001.json` | changes of the requirements after the campaign, one file each |
| `manifest/000000.attempts` | one per unfinished block that was begun: a line for every attempt |
| `report.html`, `report.json`, `figures/` | the report |
"""

import pkgutil
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, SupportsIndex

import numpy as np

from rpojax.campaign.storage import (
    block_manifests,
    campaign_configuration,
    campaign_seal,
    folder_creation,
    labelled_results,
    look_records,
    provenance,
)
from rpojax.campaign.storage.arrays import array_files, zarr_encoding, zarr_reader
from rpojax.campaign.storage.arrays.zarr_encoding import NOT_RECORDED
from rpojax.campaign.storage.arrays.zarr_writer import ZarrWriter
from rpojax.campaign.storage.block_manifests import Manifest
from rpojax.campaign.storage.campaign_configuration import CampaignConfiguration
from rpojax.campaign.storage.campaign_plots import CampaignPlots
from rpojax.campaign.storage.campaign_seal import RequirementChange, array_binding
from rpojax.campaign.storage.look_records import Look
from rpojax.errors import ResultError, UnfinishedError
from rpojax.scenario.former_fault import present_key
from rpojax.scenario.loading import scenario_loader
from rpojax.scenario.plugins import plugin_registry
from rpojax.scenario.schema import RequirementSection, ScenarioFile
from rpojax.simulation.metrics.phase_records import PhaseTransition, listed_transitions
from rpojax.simulation.outcomes import outcome_kinds
from rpojax.simulation.outcomes.outcome_events import OutcomeEvent, listed_events
from rpojax.simulation.outcomes.outcome_kinds import REASONS
from rpojax.summary_text import Summarised, Summary
from rpojax.value_types import whole_number

if TYPE_CHECKING:
    import pandas
    import xarray

TRACE_INTERVAL_S = 10.0
"""Sampling interval of the traces that are stored of every run [s]."""


@dataclass(frozen=True)
class BlockTiming:
    """Computation time of a block, and the device that computed it.

    Attributes:
        began_s: when its computation began, seconds since 1970 [s]
        wall_s: time from then until its runs had ended [s]
        compile_s: time to compile the programs [s]
        device: description of the devices
    """

    began_s: float
    wall_s: float
    compile_s: float
    device: str


class Campaign(Summarised):
    """A campaign folder: written block by block, and read as arrays with one row per finished run.

    Results of a scenario with a plugin are read without the plugin's code, which is executed only with `allow_plugin`.

    Attributes:
        directory: the folder
        configuration: content of `campaign.json`
        failed_blocks: blocks that executors of this process gave up -> reason
        requirement_changes: changes of the requirements after the campaign, in their order
        looks: taken at a sequential campaign

    Raises:
        ResultError: the folder is no campaign, or not one that this version reads, or its identity was changed.
    """

    def __init__(self, directory: Path | str, *, allow_plugin: bool = False) -> None:
        self.directory = Path(directory)
        self.configuration: CampaignConfiguration = campaign_configuration.read(self.directory)
        if allow_plugin:
            plugin_registry.load_for(dict(self.configuration.scenario), allow=True)
        plugin_registry.add_description(self.configuration.scenario, self.configuration.plugin or {})
        self.failed_blocks: dict[int, str] = {}
        self._manifests: dict[int, Manifest] = {}
        self._read_cache: dict[str, tuple[int, dict[str, np.ndarray]]] = {}
        options, seal = self.configuration.options, self.configuration.seal
        self._writer = ZarrWriter(self.directory, options.runs, self.configuration.block_size, seal)
        self.requirement_changes: list[RequirementChange] = campaign_seal.read_changes(self.directory, seal)
        self.looks: list[Look] = look_records.read(self.directory, seal)

    @property
    def info(self) -> dict[str, Any]:
        """Content of `campaign.json` with the requirements that hold now, whether it is sealed, and timing.

        `timing` is the computation time of the finished blocks, `requirement_changes` what was changed after them.
        """
        timing = block_manifests.timing(
            list(self.manifests.values()), float(self.configuration.scenario.get("duration_s", 0.0))
        )
        record = self.configuration.to_record() | {"sealed": self.is_sealed, "seal": self.configuration.seal}
        record |= {"runs": self.configuration.runs}
        if self.requirement_changes:
            record["scenario"] = {**record["scenario"], "requirements": self.requirement_changes[-1].requirements}
            record["requirement_changes"] = [asdict(change) for change in self.requirement_changes]
        return record | {"timing": timing} if timing else record

    @property
    def is_sealed(self) -> bool:
        """Whether digests bind identity, blocks and histories; older folders get figures without verdicts."""
        return self.configuration.seal is not None

    @cached_property
    def requirements(self) -> list[RequirementSection]:
        """Requirements that hold now: those of the scenario, or of the last change."""
        return self.judged_file.requirements

    @cached_property
    def judged_file(self) -> ScenarioFile:
        """The scenario of the runs with the requirements that hold now."""
        return scenario_loader.validate_recorded(self.info["scenario"]) if self.requirement_changes else self.file

    @cached_property
    def file(self) -> ScenarioFile:
        """The scenario of the runs."""
        return scenario_loader.validate_recorded(self.configuration.scenario)

    @property
    def block_count(self) -> int:
        """Number of blocks."""
        return self.configuration.block_count

    def block_run_ids(self, block: int) -> np.ndarray:
        """Run numbers of a block, padding included; numbers past the end pad the last block to full size."""
        size = self.configuration.block_size
        return self.configuration.options.first_run + np.arange(block * size, (block + 1) * size)

    @property
    def manifests(self) -> dict[int, Manifest]:
        """Finished block -> its manifest, in order."""
        finished = block_manifests.finished_blocks(self.directory, self.block_count)
        self._manifests = {
            block: self._manifests.get(block) or block_manifests.read(self.directory, self.configuration, block)
            for block in finished
        }
        return self._manifests

    def missing_blocks(self) -> list[int]:
        """Blocks that are not finished."""
        finished = set(block_manifests.finished_blocks(self.directory, self.block_count))
        return [block for block in range(self.block_count) if block not in finished]

    def write_block(self, block: int, results: Mapping[str, np.ndarray], timing: BlockTiming) -> None:
        """Stores a block's arrays (`group/name` -> (runs of the block, ...)), then its manifest.

        Raises:
            UnfinishedError: they cannot be written.
        """
        self._check_not_replaced()
        count = self.configuration.runs_in_block(block)
        groups: dict[str, dict[str, np.ndarray]] = {}
        for path, values in results.items():
            group, _, name = path.partition("/")
            groups.setdefault(group, {})[name] = values[:count]
        for group, arrays in groups.items():
            self._writer.write_rows(group, block, arrays)
        self._writer.flush()
        block_manifests.write(self.directory, block, self._manifest(block, groups, timing))

    def _manifest(self, block: int, groups: Mapping[str, Mapping[str, np.ndarray]], timing: BlockTiming) -> Manifest:
        failure = groups["status"]["failure"]
        reasons = Counter(REASONS[code] for code in failure.tolist() if REASONS[code])
        return Manifest(
            campaign=self.configuration.id,
            first=block * self.configuration.block_size,
            count=self.configuration.runs_in_block(block),
            completed=int((failure == 0).sum()),
            failed=reasons.total(),
            reasons=dict(sorted(reasons.items())),
            sha256={
                group: zarr_encoding.digest(arrays, self._binding(group, block))
                for group, arrays in sorted(groups.items())
            },
            began_s=timing.began_s,
            wall_s=timing.wall_s,
            compile_s=timing.compile_s,
            attempts=max(1, block_manifests.count_attempts(self.directory, block)),
            device=timing.device,
            versions=provenance.package_versions(),
            campaign_seal=self.configuration.seal,
        )

    def _binding(self, group: str, block: int) -> str:
        first = self.configuration.options.first_run + block * self.configuration.block_size
        return array_binding(self.configuration.seal, group, first, self.configuration.runs_in_block(block))

    @property
    def has_ended(self) -> bool:
        """Whether no further run is wanted by the plan of a sequential campaign; true of any other."""
        plan = self.configuration.options.plan
        return plan is None or self.configuration.ended_at is not None or len(self.looks) == len(plan.looks)

    def record_look(self, look: Look) -> None:
        """Records a look at a sequential campaign, which ends the campaign if it decides.

        Raises:
            UnfinishedError: it cannot be written.
        """
        self._check_not_replaced()
        assert self.configuration.seal is not None
        self.looks.append(look)
        look_records.write(self.directory, self.configuration.seal, self.looks)
        self.configuration = self.configuration.after(self.looks)

    def _check_not_replaced(self) -> None:
        """Refuses to write if another campaign has replaced this one in its folder."""
        if campaign_configuration.read(self.directory).id != self.configuration.id:
            raise UnfinishedError(f"{self.directory}: found another campaign, expected the one that was begun there")

    def write_history(self, run_id: int, channels: Mapping[str, np.ndarray]) -> None:
        """Stores the history of one run: its channels, time first.

        Raises:
            UnfinishedError: it cannot be written.
        """
        self._writer.write_history(run_id, channels)

    def remove_history(self, run_id: int) -> None:
        """Removes the history of one run, if it is stored.

        Raises:
            UnfinishedError: it cannot be removed.
        """
        self._writer.remove_history(run_id)

    def write_surface(self, arrays: Mapping[str, np.ndarray]) -> None:
        """Stores the facets of the target, if they are not stored yet.

        Raises:
            UnfinishedError: they cannot be written.
        """
        self._writer.write_surface(arrays)

    def _read(self, group: str) -> dict[str, np.ndarray]:
        """Arrays of a group, rows of finished blocks only; read again only when there are more of them."""
        finished = self.manifests
        known, arrays = self._read_cache.get(group, (-1, {}))
        if known != len(finished):
            arrays = zarr_reader.read_group(self.directory, self.configuration, group, finished)
            if group == "status":
                self._check_status(arrays, finished.values())
            for values in arrays.values():
                values.setflags(write=False)
            self._read_cache[group] = (len(finished), arrays)
        return dict(arrays)

    def verify(self) -> None:
        """Reads everything that the folder holds, and compares it with the digests recorded when it was written.

        Raises:
            ResultError: naming what was changed.
        """
        for group in sorted({name for entry in self.manifests.values() for name in entry.sha256}):
            self._read(group)
        for run_id in self.history_ids:
            zarr_reader.read_history(self.directory, self.configuration, run_id)
        _ = self.surface
        folder_creation.check_scenario_copy(self.directory, self.configuration)

    def _check_status(self, status: Mapping[str, np.ndarray], finished: Iterable[Manifest]) -> None:
        """Refuses a status array that disagrees with the counts of the manifests."""
        failure = status.get("failure", np.zeros(0, dtype=int))
        known = outcome_kinds.of_codes(failure[(failure >= 0) & (failure < len(REASONS))])
        found = (int((failure == 0).sum()), int(outcome_kinds.is_failed(known).sum()))
        expected = (sum(entry.completed for entry in finished), sum(entry.failed for entry in finished))
        if found != expected:
            place = self.directory / "results.zarr" / "status" / "failure"
            raise ResultError(f"{place}: found {found} completed and failed runs, expected {expected} by the manifests")

    @property
    def run_ids(self) -> np.ndarray:
        """(runs,) numbers of the finished runs."""
        rows = [np.arange(entry.first, entry.first + entry.count) for entry in self.manifests.values()]
        return self.configuration.options.first_run + (np.concatenate(rows) if rows else np.zeros(0, dtype=int))

    @property
    def metrics(self) -> dict[str, np.ndarray]:
        """Metric -> (runs,), nan where undefined; of a team also those of each servicer, as `METRIC/SERVICER`."""
        return self._read("metrics") | self._of_each_servicer("metrics")

    @property
    def drawn(self) -> dict[str, np.ndarray]:
        """Dispersed key -> (runs, ...) values drawn, in the user's units; `KEY/SERVICER` if each has its own."""
        return _with_present_names(self._read("drawn") | self._of_each_servicer("drawn"))

    @property
    def used(self) -> dict[str, np.ndarray]:
        """As `drawn`, values read back from the runs' Params."""
        return _with_present_names(self._read("used") | self._of_each_servicer("used"))

    @property
    def servicer_names(self) -> tuple[str, ...]:
        """Names of the servicers of a team; empty for a single one."""
        return tuple(servicer.name for servicer in self.file.servicers)

    def servicers(self, group: str) -> dict[str, np.ndarray]:
        """Arrays of a group of each servicer of a team (runs, servicers, ...); empty for a single one."""
        return self._read(f"servicer_{group}") if self.servicer_names else {}

    def _of_each_servicer(self, group: str) -> dict[str, np.ndarray]:
        return {
            f"{name}/{servicer}": values[:, number]
            for name, values in self.servicers(group).items()
            for number, servicer in enumerate(self.servicer_names)
        }

    @property
    def failed_at_s(self) -> np.ndarray:
        """(runs,) time since which a failed run has been in its final state [s], nan for runs that did not fail."""
        return self._read("status").get("failed_at_s", np.zeros(0))

    @property
    def outcomes(self) -> np.ndarray:
        """(runs,) outcome as text, such as `completed` or `lost`."""
        return outcome_kinds.of_codes(self._failure)

    @property
    def failure_reason(self) -> np.ndarray:
        """(runs,) reason of failure, empty for runs that did not fail."""
        return np.array(REASONS)[self._failure]

    @property
    def _failure(self) -> np.ndarray:
        return self._read("status").get("failure", np.zeros(0, dtype=int))

    @property
    def completed(self) -> np.ndarray:
        """(runs,) whether the run did what it should: its outcome is `completed`."""
        return self._failure == outcome_kinds.Outcome.COMPLETED.code

    @property
    def failed(self) -> np.ndarray:
        """(runs,) whether the run failed: its outcome is neither `completed` nor `not_judged`."""
        return outcome_kinds.is_failed(self.outcomes)

    @property
    def reached_end(self) -> np.ndarray:
        """(runs,) whether the run was simulated to its end, in whatever state: it was not frozen, and has metrics."""
        return ~outcome_kinds.is_frozen(self.outcomes)

    @property
    def frozen_at_s(self) -> np.ndarray:
        """(runs,) time at which the run was frozen [s], nan for runs that reached their end."""
        return np.where(self.reached_end, np.nan, self.failed_at_s)

    @property
    def events(self) -> list[OutcomeEvent]:
        """Flags of failure that were raised in the runs, with the time at which they were cleared, if they were."""
        return listed_events(self.run_ids, self._read("events"))

    @property
    def phases(self) -> dict[str, np.ndarray]:
        """Arrays of `rpojax.simulation.metrics.phase_records.evaluate` of the runs; empty without phases."""
        return self._read("phases")

    @property
    def signs(self) -> dict[str, np.ndarray]:
        """Arrays of `rpojax.simulation.metrics.failure_signs.evaluate` of the runs; empty in folders without them."""
        return self._read("signs")

    @property
    def phase_names(self) -> tuple[str, ...]:
        """Names of the phases, in the order of those arrays; empty without phases."""
        return self.file.phase_names

    @property
    def transitions(self) -> list[PhaseTransition]:
        """Phases that began in the runs, with cause and time; the first phase begins with the run."""
        return listed_transitions(self.run_ids, self.phase_names, self.phases)

    @property
    def is_judged(self) -> np.ndarray:
        """(runs,) whether the run was judged by all outcomes; older versions recorded only why a run was frozen."""
        counts = self._read("events").get("count", np.full(len(self.run_ids), NOT_RECORDED))
        return counts != NOT_RECORDED

    @property
    def traces(self) -> dict[str, np.ndarray]:
        """Channel -> (runs, samples), nan after a run was frozen."""
        return self._read("traces")

    @property
    def coverage(self) -> dict[str, np.ndarray]:
        """`lit_samples` and `seen_samples` (runs, facets) of the target's surface; empty without coverage."""
        return self._read("coverage")

    @property
    def surface(self) -> dict[str, np.ndarray]:
        """Facets of the target's surface: arrays of `rpojax.vision.surface.facets.Facets`; empty without coverage.

        Raises:
            ResultError: they cannot be read.
        """
        found = zarr_reader.read_surface(self.directory, self.configuration)
        if not found and any("coverage" in entry.sha256 for entry in self.manifests.values()):
            place = self.directory / "results.zarr" / "surface"
            raise ResultError(f"{place}: missing, expected the facets of the target (`rpojax resume` makes them again)")
        return found

    @property
    def trace_time_s(self) -> np.ndarray:
        """(samples,) sampling times of the traces [s]."""
        traces = self.traces
        count = next(iter(traces.values())).shape[1] if traces else 0
        return np.arange(count) * trace_stride(self.file) / self.file.rates.camera_hz

    @property
    def history_ids(self) -> list[int]:
        """Numbers of the runs with a stored history."""
        options = self.configuration.options
        return array_files.stored_history_ids(self.directory, options.first_run, options.runs)

    def history(self, run_id: SupportsIndex, servicer: SupportsIndex | str | None = None) -> dict[str, np.ndarray]:
        """Stored history of a run, time first; of a team the servicers are the second axis.

        Args:
            run_id: number of the run
            servicer: number or name of the servicer of a team whose history is wanted; a single one has the number 0

        Raises:
            ResultError: the run has no history, the team no such servicer, or it cannot be read.
        """
        number = None if servicer is None else self.servicer_number(servicer)
        if (run := whole_number(run_id)) not in (stored := self.history_ids):
            raise ResultError(f"run {run_id}: found no history, expected one of {stored}")
        history = zarr_reader.read_history(self.directory, self.configuration, run)
        return of_servicer(history, number) if number is not None and self.servicer_names else history

    def servicer_number(self, servicer: SupportsIndex | str) -> int:
        """Number of a servicer of a team, by it or by its name; 0 without a team.

        Raises:
            ResultError: there is no such servicer.
        """
        names = list(self.servicer_names)
        number = names.index(servicer) if isinstance(servicer, str) and servicer in names else whole_number(servicer)
        if number is None or not 0 <= number < max(1, len(names)):
            several = f"one of {', '.join(names)}, or a number from 0 to {len(names) - 1}"
            expected = several if names else "none, as the campaign has no team"
            raise ResultError(f"servicer: found {servicer!r}, expected {expected}")
        return number

    @property
    def plot(self) -> CampaignPlots:
        """Figures of the finished runs, for consoles and notebooks, each a `matplotlib.figure.Figure`.

        `envelope(channel)` is a channel of the traces over time, `histogram(metric)` a metric, `scatter(x, y)` metrics
        or dispersed numbers against each other, and `path(run_ids)` runs with a history around the target; with units
        and the limits of requirements.
        """
        return CampaignPlots(self)

    def _summary(self) -> Summary:
        # The report, which judges requirements, is above the storage of campaigns.
        return pkgutil.resolve_name("rpojax.report.campaign_text:campaign_summary")(self)

    def to_xarray(self) -> "xarray.Dataset":
        """Finished runs as an `xarray.Dataset` with units, as `rpojax.open_campaign` describes it.

        Raises:
            MissingExtraError: xarray is not installed.
        """
        names = ("metrics", "traces", "drawn", "used", "phases")
        groups = {name: self._read(name) for name in names}
        if self.servicer_names:
            groups |= {f"servicer_{name}": self.servicers(name) for name in names[:4]}
        labels = labelled_results.Labels(self.run_ids, self.trace_time_s, self.phase_names, self.servicer_names)
        return labelled_results.dataset(labels, self._status(), groups, self.configuration)

    def to_dataframe(self) -> "pandas.DataFrame":
        """Finished runs as a table, one row a run by `run_id`: status, metrics, and dispersed values by their keys.

        Raises:
            MissingExtraError: pandas is not installed.
        """
        groups = {"metrics": self.metrics, "drawn": self.drawn}
        return labelled_results.data_frame(self.run_ids, self._status(), groups)

    def _status(self) -> dict[str, np.ndarray]:
        return {
            "failed_at_s": self.failed_at_s,
            "failure_reason": self.failure_reason.astype(object),
            "outcome": self.outcomes.astype(object),
            "completed": self.completed,
        }


def of_servicer(history: Mapping[str, np.ndarray], servicer: int) -> dict[str, np.ndarray]:
    """History of servicer number `servicer`, from the history of a team with channels (ticks, servicers, ...)."""
    ticks = len(history["time_s"])
    return {
        name: values if name == "time_s" else values[:, servicer] if len(values) == ticks else values[servicer]
        for name, values in history.items()
    }


def trace_stride(file: ScenarioFile) -> int:
    """Ticks between samples of the traces."""
    return max(1, round(TRACE_INTERVAL_S * file.rates.camera_hz))


def _with_present_names(values: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Values by key, also those of a campaign whose scenario had another name for it."""
    return {present_key(key): each for key, each in values.items()}
