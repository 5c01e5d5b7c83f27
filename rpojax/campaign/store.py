"""The folder that a campaign leaves.

| path | holds |
|---|---|
| `campaign.json` | scenario, its hash, seed, runs, block size, versions, device; written before anything is compiled |
| `results.zarr` | of every run: `metrics/NAME`, `status/NAME`, `drawn/KEY`, `used/KEY`, `traces/NAME` |
| `results.zarr/histories/RUN` | every channel of a kept run, time first |
| `manifest/000000.json` | one per finished block, written last; a block without one is run again by a resume |
| `report.html`, `report.json`, `figures/` | the report |
"""

import datetime
import json
import os
import platform
import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import zarr

from rpojax import __version__
from rpojax.campaign import admission
from rpojax.errors import OutputError, ResultError
from rpojax.simulation import scenario
from rpojax.simulation.closed_loop import FAILURES
from rpojax.simulation.schema import ScenarioFile

FORMAT = 1
TRACE_EVERY_S = 10.0
"""Sampling of the traces that are kept of every run [s]."""


def create(
    directory: Path,
    file: ScenarioFile,
    seed: int,
    runs: int,
    first_run: int,
    block_size: int,
    history_ids: list[int],
    force: bool,
) -> "Campaign":
    """New campaign folder with its `campaign.json`.

    Raises:
        OutputError: the folder exists and `force` is not given, or it holds something that is no campaign.
    """
    admission.check_folder(directory, force)
    info = {
        "format": FORMAT,
        "name": file.name,
        "description": file.description,
        "scenario": file.model_dump(mode="json"),
        "scenario_hash": scenario.digest(file),
        "seed": seed,
        "runs": runs,
        "first_run": first_run,
        "block_size": block_size,
        "history_ids": history_ids,
        "versions": _versions(),
        "device": _device(),
        "dtype": "float64",
        "created": datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
    }
    try:
        if directory.exists():
            shutil.rmtree(directory)
        directory.mkdir(parents=True)
        write_json(directory / "campaign.json", info)
    except OSError as error:
        reason = f"{str(directory)!r} ({error.strerror})"
        raise OutputError(f"--out: found {reason}, expected a folder to write to") from None
    return Campaign(directory)


def _versions() -> dict[str, str]:
    import jax

    return {
        "rpojax": __version__,
        "jax": jax.__version__,
        "numpy": np.__version__,
        "python": platform.python_version(),
    }


def _device() -> str:
    import jax

    devices = jax.devices()
    return f"{len(devices)} x {devices[0].device_kind} ({platform.machine()})"


def write_json(path: Path, content: Any) -> None:
    """Writes JSON so that a reader sees the old file or the whole new one."""
    temporary = path.with_name(f".{path.name}.partial")
    with temporary.open("w", encoding="utf-8") as stream:
        json.dump(content, stream, indent=2, allow_nan=False)
        stream.write("\n")
        stream.flush()
        os.fsync(stream.fileno())
    temporary.replace(path)


class Campaign:
    """A campaign folder, for writing block by block and for reading.

    Raises:
        ResultError: the folder is no campaign, or not one that this version reads.
    """

    def __init__(self, directory: Path | str) -> None:
        self.directory = Path(directory)
        self._read_before: dict[str, tuple[int, dict[str, np.ndarray]]] = {}
        try:
            self.info: dict[str, Any] = json.loads((self.directory / "campaign.json").read_text(encoding="utf-8"))
        except (OSError, ValueError) as error:
            raise ResultError(
                f"{self.directory}: found no readable campaign.json ({error}), expected a campaign folder"
            ) from None
        found = self.info.get("format") if isinstance(self.info, dict) else None
        if found != FORMAT:
            raise ResultError(f"{self.directory}: found format {found!r}, expected {FORMAT}")

    @property
    def file(self) -> ScenarioFile:
        """The scenario that was run."""
        return scenario.validate(self.info["scenario"])

    @property
    def blocks(self) -> int:
        """Number of blocks."""
        return -(-self.info["runs"] // self.info["block_size"])

    def block_ids(self, block: int) -> np.ndarray:
        """Run numbers of a block, padding included; numbers past the end pad the last block to full size."""
        size = self.info["block_size"]
        return self.info["first_run"] + np.arange(block * size, (block + 1) * size)

    def is_done(self, block: int) -> bool:
        """True if the block's manifest is there."""
        return self._manifest(block).is_file()

    def missing(self) -> list[int]:
        """Blocks still to be run."""
        return [block for block in range(self.blocks) if not self.is_done(block)]

    def _manifest(self, block: int) -> Path:
        return self.directory / "manifest" / f"{block:06d}.json"

    def write_block(self, block: int, results: Mapping[str, np.ndarray], note: Mapping[str, Any]) -> None:
        """Stores a block's arrays (`group/name` -> (runs of the block, ...)), then its manifest."""
        size = self.info["block_size"]
        begin = block * size
        count = min(size, self.info["runs"] - begin)
        root = zarr.open_group(str(self.directory / "results.zarr"), mode="a")
        for name, values in results.items():
            self._array(root, name, values)[begin : begin + count] = values[:count]
        manifest = self._manifest(block)
        manifest.parent.mkdir(exist_ok=True)
        write_json(manifest, {"first": int(begin), "count": int(count), **note})

    def _array(self, root: zarr.Group, name: str, values: np.ndarray) -> Any:
        if name in root:
            return root[name]
        shape = (self.info["runs"], *values.shape[1:])
        chunks = (min(self.info["block_size"], shape[0]), *values.shape[1:])
        fill = np.nan if np.issubdtype(values.dtype, np.floating) else 0
        return root.create_array(name, shape=shape, chunks=chunks, dtype=values.dtype, fill_value=fill)

    def write_history(self, run_id: int, channels: Mapping[str, np.ndarray]) -> None:
        """Stores the full history of one run."""
        root = zarr.open_group(str(self.directory / "results.zarr"), mode="a")
        group = root.require_group(f"histories/{run_id}")
        for name, values in channels.items():
            group.create_array(name, data=np.ascontiguousarray(values), chunks=values.shape, overwrite=True)

    def write_timing(self, timing: Mapping[str, float]) -> None:
        """Adds how long it took to `campaign.json`."""
        self.info["timing"] = dict(timing)
        write_json(self.directory / "campaign.json", self.info)

    def _read(self, group: str) -> dict[str, np.ndarray]:
        """Arrays of a group, rows of finished blocks only; read again only when there are more of them."""
        rows = self._rows()
        known, arrays = self._read_before.get(group, (-1, {}))
        if known != len(rows):
            arrays = self._read_now(group, rows)
            self._read_before[group] = (len(rows), arrays)
        return dict(arrays)

    def _read_now(self, group: str, rows: np.ndarray) -> dict[str, np.ndarray]:
        try:
            node = zarr.open_group(str(self.directory / "results.zarr"), mode="r")[group]
        except (FileNotFoundError, KeyError):
            return {}
        assert isinstance(node, zarr.Group)
        arrays = {name: np.asarray(array[:])[rows] for name, array in sorted(node.arrays())}  # pyright: ignore[reportIndexIssue]
        for values in arrays.values():
            values.setflags(write=False)
        return arrays

    def _rows(self) -> np.ndarray:
        size, runs = self.info["block_size"], self.info["runs"]
        rows = [np.arange(b * size, min((b + 1) * size, runs)) for b in range(self.blocks) if self.is_done(b)]
        return np.concatenate(rows) if rows else np.zeros(0, dtype=int)

    @property
    def run_ids(self) -> np.ndarray:
        """Numbers of the runs that are done."""
        return self.info["first_run"] + self._rows()

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
        return np.array(FAILURES)[self._read("status").get("failure", np.zeros(0, dtype=int))]

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
        """Runs whose full history was kept."""
        try:
            node = zarr.open_group(str(self.directory / "results.zarr"), mode="r")["histories"]
        except (FileNotFoundError, KeyError):
            return []
        assert isinstance(node, zarr.Group)
        return sorted(int(name) for name, _ in node.groups())

    def history(self, run_id: int) -> dict[str, np.ndarray]:
        """Full history of a kept run, time first.

        Raises:
            ResultError: the run's history was not kept.
        """
        if run_id not in self.history_ids:
            raise ResultError(f"run {run_id}: found no history, expected one of {self.history_ids}")
        node = zarr.open_group(str(self.directory / "results.zarr"), mode="r")[f"histories/{run_id}"]
        assert isinstance(node, zarr.Group)
        return {name: np.asarray(array[:]) for name, array in node.arrays()}  # pyright: ignore[reportIndexIssue]


def trace_stride(file: ScenarioFile) -> int:
    """Ticks between samples of the traces."""
    return max(1, round(TRACE_EVERY_S * file.rates.camera_hz))
