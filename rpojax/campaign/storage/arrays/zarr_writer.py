"""Writing of `results.zarr`: rows of finished blocks and histories, each file whole, with groups and array metadata."""

import contextlib
import shutil
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from rpojax.campaign.storage import atomic_files, safe_paths
from rpojax.campaign.storage.arrays import zarr_encoding
from rpojax.campaign.storage.arrays.zarr_encoding import ArrayEncoder, ArrayLayout, array_units
from rpojax.campaign.storage.campaign_seal import array_binding


class ZarrWriter:
    """Writes the Zarr group of a campaign of `runs` runs in blocks of `block_size`, with the `seal` of the campaign.

    Several processes may write to one group: metadata and the rows of a block have the same bytes from each of them.
    Files are on the disk, and survive a loss of power, after `flush`; what says that they are complete is written then.
    """

    def __init__(self, directory: Path, runs: int, block_size: int, seal: str | None = None) -> None:
        self.directory = directory
        self.runs = runs
        self.block_size = block_size
        self.seal = seal
        self._encoder = ArrayEncoder()
        self._written_metadata: set[Path] = set()
        self._unflushed: set[Path] = set()

    def write_rows(self, group: str, block: int, arrays: Mapping[str, np.ndarray]) -> None:
        """Writes a block's rows of the arrays of a group, name -> (runs of the block, ...).

        Raises:
            UnfinishedError: they cannot be written.
        """
        self._write_group_metadata(Path(group))
        for name, values in arrays.items():
            units = array_units(group, name)
            layout = zarr_encoding.per_run_layout(self.runs, self.block_size, group, values, units)
            self._write_array(Path(group, name), layout, block, values)

    def write_history(self, run_id: int, channels: Mapping[str, np.ndarray]) -> None:
        """Writes the channels of one run; the metadata of their group, written last, says that they are complete.

        Raises:
            UnfinishedError: they cannot be written.
        """
        self._write_whole_group(Path("histories", str(run_id)), channels, array_binding(self.seal, "histories", run_id))

    def remove_history(self, run_id: int) -> None:
        """Removes the channels of one run; first the metadata of their group, which say that they are complete.

        Raises:
            UnfinishedError: they cannot be removed.
        """
        folder = self.directory / "results.zarr" / "histories" / str(run_id)
        safe_paths.check_no_links(self.directory, folder)
        try:
            (folder / "zarr.json").unlink(missing_ok=True)
            with contextlib.suppress(FileNotFoundError):  # another process that shares the campaign removes it, too
                shutil.rmtree(folder)
        except OSError as error:
            raise atomic_files.write_error(folder, error) from None

    def write_surface(self, arrays: Mapping[str, np.ndarray]) -> None:
        """Writes the facets of the target, once; the metadata of their group are written last.

        Raises:
            UnfinishedError: they cannot be written.
        """
        path = Path("surface")
        if not (self.directory / "results.zarr" / path / "zarr.json").is_file():
            self._write_whole_group(path, arrays, array_binding(self.seal, "surface", 0, self.runs))

    def _write_whole_group(self, path: Path, channels: Mapping[str, np.ndarray], binding: str) -> None:
        self._write_group_metadata(path.parent)
        samples = len(channels["time_s"]) if "time_s" in channels else -1
        for name, values in channels.items():
            layout = zarr_encoding.history_layout(name, values, values.ndim > 0 and len(values) == samples)
            self._written_metadata.discard(path / name)
            self._write_array(path / name, layout, 0, values)
        digest = zarr_encoding.digest(channels, binding)
        self.flush()
        self._write_file(path / "zarr.json", zarr_encoding.group_metadata({"sha256": digest}), sync=True)

    def _write_array(self, path: Path, layout: ArrayLayout, block: int, values: np.ndarray) -> None:
        if path not in self._written_metadata:
            self._write_metadata(path, self._encoder.metadata(layout))
        key, content = self._encoder.encode_block(layout, block, values)
        self._write_file(path / key, content)

    def _write_group_metadata(self, path: Path) -> None:
        for part in (Path(), *reversed(path.parents[:-1]), path):
            if part not in self._written_metadata:
                self._write_metadata(part, zarr_encoding.group_metadata())

    def _write_metadata(self, path: Path, content: bytes) -> None:
        """Writes `zarr.json`, which finished blocks need too, whole and on the disk before it replaces an equal one."""
        self._write_file(
            path / "zarr.json", content, sync=(self.directory / "results.zarr" / path / "zarr.json").exists()
        )
        self._written_metadata.add(path)

    def _write_file(self, path: Path, content: bytes, sync: bool = False) -> None:
        full = self.directory / "results.zarr" / path
        safe_paths.make_folder(self.directory, full.parent)
        atomic_files.write(full, content, sync)
        if not sync:
            self._unflushed.add(full)

    def flush(self) -> None:
        """Flushes all files written so far to the disk.

        Raises:
            UnfinishedError: one cannot be flushed.
        """
        atomic_files.flush(sorted(self._unflushed))
        self._unflushed.clear()
