"""The folder that a campaign leaves.

| path | holds |
|---|---|
| `campaign.json` | scenario, its hash, seed, runs, block size, versions, device; written before anything is compiled |
| `scenario.toml` | the scenario as a file that `rpojax run` takes |
| `results.zarr` | of every run: `metrics/NAME`, `status/NAME`, `drawn/KEY`, `used/KEY`, `traces/NAME` |
| `results.zarr/histories/RUN` | channels of a kept run, time first |
| `manifest/000000.json` | one per finished block, written last; a block without one is run again by a resume |
| `manifest/000000.attempts` | one per block under way or broken off: a line for every attempt |
| `report.html`, `report.json`, `figures/` | the report |
"""

from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from rpojax.campaign.storage import (
    atomic_files,
    block_manifests,
    campaign_json,
    folder_creation,
    zarr_encoding,
    zarr_reader,
)
from rpojax.campaign.storage.block_manifests import Manifest
from rpojax.errors import ResultError, UnfinishedError
from rpojax.scenario import key_units, metric_catalogue, scenario_file
from rpojax.scenario.schema import ScenarioFile
from rpojax.simulation import trace_channels
from rpojax.simulation.closed_loop import FAILURE_REASONS

TRACE_INTERVAL_S = 10.0
"""Sampling of the traces that are kept of every run [s]."""


@dataclass(frozen=True)
class BlockTiming:
    """What a block took.

    Attributes:
        began_s: when its computation began, seconds since 1970 [s]
        wall_s: time from then until its runs had ended [s]
        compile_s: time to compile the programs [s]
        device: what computed it
    """

    began_s: float
    wall_s: float
    compile_s: float
    device: str


class Campaign:
    """A campaign folder, for writing block by block and for reading.

    Raises:
        ResultError: the folder is no campaign, or not one that this version reads.
    """

    def __init__(self, directory: Path | str) -> None:
        self.directory = Path(directory)
        self.configuration: dict[str, Any] = campaign_json.read(self.directory)
        """Content of `campaign.json`."""
        self.failed_blocks: dict[int, str] = {}
        """Blocks that this session could not finish, and why."""
        self._manifests: dict[int, Manifest] = {}
        self._read_cache: dict[str, tuple[int, dict[str, np.ndarray]]] = {}
        self._encoder = zarr_encoding.ArrayEncoder()
        self._written_metadata: set[Path] = set()

    @property
    def info(self) -> dict[str, Any]:
        """Content of `campaign.json`, and as `timing` how long the finished blocks took."""
        timing = block_manifests.timing(
            list(self.manifests.values()), float(self.configuration["scenario"].get("duration_s", 0.0))
        )
        return {**self.configuration, "timing": timing} if timing else dict(self.configuration)

    @cached_property
    def file(self) -> ScenarioFile:
        """The scenario that was run."""
        return scenario_file.validate(self.configuration["scenario"])

    @property
    def block_count(self) -> int:
        """Number of blocks."""
        return campaign_json.block_count(self.configuration)

    def block_run_ids(self, block: int) -> np.ndarray:
        """Run numbers of a block, padding included; numbers past the end pad the last block to full size."""
        size = self.configuration["block_size"]
        return self.configuration["first_run"] + np.arange(block * size, (block + 1) * size)

    @property
    def manifests(self) -> dict[int, Manifest]:
        """Finished block -> its manifest, in order."""
        done = block_manifests.finished_blocks(self.directory, self.block_count)
        known = {
            block: self._manifests.get(block) or block_manifests.read(self.directory, self.configuration, block)
            for block in done
        }
        self._manifests = known
        return known

    def missing_blocks(self) -> list[int]:
        """Blocks still to be run."""
        done = set(block_manifests.finished_blocks(self.directory, self.block_count))
        return [block for block in range(self.block_count) if block not in done]

    def write_block(self, block: int, results: Mapping[str, np.ndarray], timing: BlockTiming) -> None:
        """Stores a block's arrays (`group/name` -> (runs of the block, ...)), then its manifest.

        Raises:
            UnfinishedError: they cannot be written.
        """
        self._check_not_replaced()
        count = campaign_json.runs_in_block(self.configuration, block)
        groups: dict[str, dict[str, np.ndarray]] = {}
        for path, values in results.items():
            group, _, name = path.partition("/")
            groups.setdefault(group, {})[name] = values[:count]
        for group, arrays in groups.items():
            self._write_group_metadata(Path(group))
            for name, values in arrays.items():
                self._write_rows(group, name, block, values)
        failure = groups["status"]["failure"]
        failed = Counter(FAILURE_REASONS[code] for code in failure.tolist() if code > 0)
        manifest = Manifest(
            campaign=self.configuration["id"],
            first=block * self.configuration["block_size"],
            count=count,
            completed=int((failure == 0).sum()),
            failed=failed.total(),
            reasons=dict(sorted(failed.items())),
            sha256={group: zarr_encoding.digest(arrays) for group, arrays in sorted(groups.items())},
            began_s=timing.began_s,
            wall_s=timing.wall_s,
            compile_s=timing.compile_s,
            attempts=max(1, block_manifests.count_attempts(self.directory, block)),
            device=timing.device,
            versions=folder_creation.package_versions(),
        )
        block_manifests.write(self.directory, block, manifest)

    def _check_not_replaced(self) -> None:
        """Refuses to write where another campaign has taken this one's place."""
        if campaign_json.read(self.directory)["id"] != self.configuration["id"]:
            raise UnfinishedError(f"{self.directory}: found another campaign, expected the one that was begun there")

    def _write_rows(self, group: str, name: str, block: int, values: np.ndarray) -> None:
        layout = zarr_encoding.per_run_layout(
            self.configuration["runs"], self.configuration["block_size"], group, values, array_units(group, name)
        )
        self._write_array(Path(group, name), layout, block, values)

    def _write_array(self, path: Path, layout: zarr_encoding.ArrayLayout, block: int, values: np.ndarray) -> None:
        if path not in self._written_metadata:
            self._write_file(path / "zarr.json", self._encoder.metadata(layout))
            self._written_metadata.add(path)
        key, content = self._encoder.encode_block(layout, block, values)
        self._write_file(path / key, content)

    def _write_group_metadata(self, path: Path) -> None:
        for part in (Path(), *reversed(path.parents[:-1]), path):
            if part not in self._written_metadata:
                self._write_file(part / "zarr.json", zarr_encoding.group_metadata())
                self._written_metadata.add(part)

    def _write_file(self, path: Path, content: bytes) -> None:
        """Writes a file of the store; who else writes it writes the same."""
        full = self.directory / "results.zarr" / path
        block_manifests.make_folder(self.directory, full.parent)
        atomic_files.write(full, content, sync=True)

    def write_history(self, run_id: int, channels: Mapping[str, np.ndarray]) -> None:
        """Stores the history of one run; its group, written last, says that it is whole.

        Raises:
            UnfinishedError: it cannot be written.
        """
        path = Path("histories", str(run_id))
        self._write_group_metadata(path.parent)
        samples = len(channels["time_s"]) if "time_s" in channels else -1
        for name, values in channels.items():
            layout = zarr_encoding.history_layout(name, values, values.ndim > 0 and len(values) == samples)
            self._written_metadata.discard(path / name)
            self._write_array(path / name, layout, 0, values)
        self._write_file(path / "zarr.json", zarr_encoding.group_metadata({"sha256": zarr_encoding.digest(channels)}))

    def _read(self, group: str) -> dict[str, np.ndarray]:
        """Arrays of a group, rows of finished blocks only; read again only when there are more of them."""
        done = self.manifests
        known, arrays = self._read_cache.get(group, (-1, {}))
        if known != len(done):
            arrays = zarr_reader.read_group(self.directory, self.configuration, group, done)
            if group == "status":
                self._check_status(arrays, done.values())
            for values in arrays.values():
                values.setflags(write=False)
            self._read_cache[group] = (len(done), arrays)
        return dict(arrays)

    def _check_status(self, status: Mapping[str, np.ndarray], done: Iterable[Manifest]) -> None:
        """Refuses statuses that are not those which the manifests counted."""
        failure = status.get("failure", np.zeros(0, dtype=int))
        found = (int((failure == 0).sum()), int(((failure > 0) & (failure < len(FAILURE_REASONS))).sum()))
        expected = (sum(entry.completed for entry in done), sum(entry.failed for entry in done))
        if found != expected:
            place = self.directory / "results.zarr" / "status" / "failure"
            raise ResultError(f"{place}: found {found} completed and failed runs, expected {expected} by the manifests")

    def _finished_rows(self) -> np.ndarray:
        rows = [np.arange(entry.first, entry.first + entry.count) for entry in self.manifests.values()]
        return np.concatenate(rows) if rows else np.zeros(0, dtype=int)

    @property
    def run_ids(self) -> np.ndarray:
        """Numbers of the runs that are done."""
        return self.configuration["first_run"] + self._finished_rows()

    @property
    def metrics(self) -> dict[str, np.ndarray]:
        """Metric -> (runs,), nan where undefined."""
        return self._read("metrics")

    @property
    def drawn(self) -> dict[str, np.ndarray]:
        """Dispersed key -> (runs, ...) values drawn, in the user's units."""
        return self._read("drawn")

    @property
    def used(self) -> dict[str, np.ndarray]:
        """Dispersed key -> (runs, ...) values that the runs held, in the user's units."""
        return self._read("used")

    @property
    def failed_at_s(self) -> np.ndarray:
        """(runs,) time of failure [s], nan for completed runs."""
        return self._read("status").get("failed_at_s", np.zeros(0))

    @property
    def failure_reason(self) -> np.ndarray:
        """(runs,) reason of failure, empty for completed runs."""
        return np.array(FAILURE_REASONS)[self._read("status").get("failure", np.zeros(0, dtype=int))]

    @property
    def completed(self) -> np.ndarray:
        """(runs,) whether the run reached its end."""
        return self.failure_reason == ""

    @property
    def traces(self) -> dict[str, np.ndarray]:
        """Channel -> (runs, samples), nan after a failure."""
        return self._read("traces")

    @property
    def trace_time_s(self) -> np.ndarray:
        """(samples,) [s]."""
        traces = self.traces
        count = next(iter(traces.values())).shape[1] if traces else 0
        return np.arange(count) * trace_stride(self.file) / self.file.rates.camera_hz

    @property
    def history_ids(self) -> list[int]:
        """Runs whose history was kept."""
        return zarr_reader.stored_history_ids(
            self.directory, self.configuration["first_run"], self.configuration["runs"]
        )

    def history(self, run_id: int) -> dict[str, np.ndarray]:
        """History of a kept run, time first.

        Raises:
            ResultError: the run's history was not kept, or cannot be read.
        """
        if run_id not in (kept := self.history_ids):
            raise ResultError(f"run {run_id}: found no history, expected one of {kept}")
        return zarr_reader.read_history(self.directory, run_id)


def array_units(group: str, name: str) -> str:
    """Unit of an array as text; 1 for pure numbers."""
    match group:
        case "metrics":
            unit = metric_catalogue.UNITS.get(name, "-")
        case "traces":
            unit = trace_channels.TRACE_UNITS.get(name, "-")
        case "status":
            unit = "s" if name.endswith("_s") else "-"
        case _:
            unit = key_units.unit_symbol(name)
    return "1" if unit == "-" else unit


def trace_stride(file: ScenarioFile) -> int:
    """Ticks between samples of the traces."""
    return max(1, round(TRACE_INTERVAL_S * file.rates.camera_hz))
