"""The folder that a campaign leaves.

| path | holds |
|---|---|
| `campaign.json` | scenario, its hash, seed, runs, block size, versions, device; written before anything is compiled |
| `scenario.toml` | the scenario as a file that `rpojax run` takes |
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
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w
import zarr

from rpojax.campaign import admission
from rpojax.errors import OutputError, ResultError, RpojaxError
from rpojax.simulation import scenario
from rpojax.simulation.closed_loop import FAILURES
from rpojax.simulation.schema import ScenarioFile
from rpojax.version import __version__

FORMAT = 2
TRACE_EVERY_S = 10.0
"""Sampling of the traces that are kept of every run [s]."""

_UNKNOWN = -1
"""Status of a run that was never written."""
_ENTRIES: dict[str, type] = {
    "name": str,
    "description": str,
    "scenario": dict,
    "scenario_hash": str,
    "seed": int,
    "runs": int,
    "first_run": int,
    "block_size": int,
    "history_ids": list,
    "stages": dict,
    "versions": dict,
}
"""What `campaign.json` must hold, and in which form."""


def create(
    directory: Path,
    file: ScenarioFile,
    seed: int,
    runs: int,
    first_run: int,
    block_size: int,
    history_ids: list[int],
    force: bool,
    stages: Mapping[str, Any] | None = None,
    design: Mapping[str, Any] | None = None,
) -> "Campaign":
    """New campaign folder with its `campaign.json` and `scenario.toml`.

    `stages` are those replaced, as text; `design` is the record of the design, by default that of just these runs.

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
        "stages": dict(stages or {}),
        "design": dict(design or {"first_run": first_run, "runs": runs}),
        "versions": _versions(),
        "device": _device(),
        "dtype": "float64",
        "created": datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
    }
    try:
        if directory.exists():
            shutil.rmtree(directory)
        directory.mkdir(parents=True)
        (directory / "scenario.toml").write_bytes(tomli_w.dumps(info["scenario"]).encode())
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
        self._check_info()

    def _check_info(self) -> None:
        found = self.info.get("format") if isinstance(self.info, dict) else None
        if found != FORMAT:
            raise ResultError(f"{self.directory}: found format {found!r}, expected {FORMAT}")
        for key, form in _ENTRIES.items():
            value: Any = self.info.get(key)
            if not isinstance(value, form) or (key in ("runs", "block_size") and value < 1):
                place = self.directory / "campaign.json"
                raise ResultError(
                    f"{place}: found {value!r:.60} for {key!r}, expected the {form.__name__} of a campaign"
                )

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

    def write_block(self, block: int, results: Mapping[str, np.ndarray]) -> None:
        """Stores a block's arrays (`group/name` -> (runs of the block, ...)), then its manifest."""
        size = self.info["block_size"]
        begin = block * size
        count = min(size, self.info["runs"] - begin)
        with _every_chunk():
            root = zarr.open_group(str(self.directory / "results.zarr"), mode="a")
            for name, values in results.items():
                self._array(root, name, values)[begin : begin + count] = values[:count]
        manifest = self._manifest(block)
        manifest.parent.mkdir(exist_ok=True)
        write_json(manifest, {"first": int(begin), "count": int(count), **_counts(results["status/failure"][:count])})

    def _array(self, root: zarr.Group, name: str, values: np.ndarray) -> Any:
        if name in root:
            return root[name]
        shape = (self.info["runs"], *values.shape[1:])
        chunks = (min(self.info["block_size"], shape[0]), *values.shape[1:])
        fill = np.nan if np.issubdtype(values.dtype, np.floating) else _UNKNOWN
        return root.create_array(name, shape=shape, chunks=chunks, dtype=values.dtype, fill_value=fill)

    def write_history(self, run_id: int, channels: Mapping[str, np.ndarray]) -> None:
        """Stores the full history of one run."""
        with _every_chunk():
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
        if len(rows) == 0:
            return {}
        done = [block for block in range(self.blocks) if self.is_done(block)]
        arrays = {name: values[rows] for name, values in self._load(group, done).items()}
        if group == "status":
            self._compare(done, rows, arrays)
        for values in arrays.values():
            values.setflags(write=False)
        return arrays

    def _load(self, group: str, blocks: list[int]) -> dict[str, np.ndarray]:
        """Arrays of a group as they are stored, with every chunk of some blocks there; none where there is no group.

        Raises:
            ResultError: something of it is lost or cannot be read.
        """
        results = self.directory / "results.zarr"
        try:
            root = zarr.open_group(str(results), mode="r")
            if group not in root:
                if group in ("drawn", "used") and not _disperses(self.info["scenario"]):
                    return {}
                raise ResultError(f"{results / group}: found nothing, expected the arrays of a campaign")
            node = root[group]
            assert isinstance(node, zarr.Group)
            return {name: _whole(results, array, blocks) for name, array in sorted(node.arrays())}
        except RpojaxError:
            raise
        # Each part of the store has exceptions of its own for bytes that it did not write.
        except Exception as error:
            reason = " ".join(str(error).split()) or type(error).__name__
            raise ResultError(f"{results / group}: found {reason}, expected readable arrays") from None

    def _compare(self, blocks: list[int], rows: np.ndarray, status: Mapping[str, np.ndarray]) -> None:
        """Refuses statuses that are not those which the manifests counted."""
        if "failure" not in status:
            raise ResultError(f"{self.directory / 'results.zarr' / 'status'}: found no 'failure', expected it")
        of_block = rows // self.info["block_size"]
        for block in blocks:
            found, expected = _counts(status["failure"][of_block == block]), self._counted(block)
            if found != expected:
                place = self.directory / "results.zarr" / "status" / "failure"
                raise ResultError(f"{place}: found {found} in block {block}, expected {expected} by its manifest")

    def _counted(self, block: int) -> dict[str, Any]:
        path = self._manifest(block)
        try:
            content = json.loads(path.read_text(encoding="utf-8"))
            return {name: content[name] for name in ("completed", "failed")}
        except (OSError, ValueError, KeyError, TypeError):
            expected = "the counts of a finished block (without the file, a resume runs the block again)"
            raise ResultError(f"{path}: found no readable counts, expected {expected}") from None

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
            assert isinstance(node, zarr.Group)
            return sorted(int(name) for name, _ in node.groups())
        except (FileNotFoundError, KeyError):
            return []
        except (OSError, ValueError, TypeError) as error:
            raise ResultError(f"{self.directory}: found histories with {error}, expected readable ones") from None

    def history(self, run_id: int) -> dict[str, np.ndarray]:
        """Full history of a kept run, time first.

        Raises:
            ResultError: the run's history was not kept, or cannot be read.
        """
        if run_id not in self.history_ids:
            raise ResultError(f"run {run_id}: found no history, expected one of {self.history_ids}")
        return self._load(f"histories/{run_id}", [0])


def _disperses(tables: Mapping[str, Any]) -> bool:
    """Whether anything changes from run to run in a scenario's tables."""
    design = tables.get("design")
    return bool(tables.get("dispersions") or (isinstance(design, Mapping) and design.get("values")))


@contextmanager
def _every_chunk() -> Iterator[None]:
    """Chunks of nothing but the fill value are written too, so that one that is not there is one that was lost."""
    with zarr.config.set({"array.write_empty_chunks": True}):
        yield


def _whole(results: Path, array: Any, blocks: list[int]) -> np.ndarray:
    """Values of an array whose chunks of some blocks must all be there."""
    for block in blocks:
        key = array.metadata.encode_chunk_key((block, *(0,) * (array.ndim - 1)))
        if not (path := results / array.path / key).is_file():
            raise ResultError(f"{path}: found nothing, expected the values of block {block}")
    return np.asarray(array[:])


def _counts(failure: np.ndarray) -> dict[str, int]:
    """How many of some runs completed and how many failed, by their codes; unknown ones are neither."""
    failed = (failure > 0) & (failure < len(FAILURES))
    return {"completed": int((failure == 0).sum()), "failed": int(failed.sum())}


def trace_stride(file: ScenarioFile) -> int:
    """Ticks between samples of the traces."""
    return max(1, round(TRACE_EVERY_S * file.rates.camera_hz))
