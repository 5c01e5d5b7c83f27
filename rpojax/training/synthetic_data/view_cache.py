"""Finished blocks of ray-traced views in a folder, so that an interrupted call continues."""

import dataclasses
import hashlib
import zipfile
import zlib
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from rpojax.errors import RpojaxError
from rpojax.training.synthetic_data.meshes.target_mesh import TargetMesh


def mesh_digest(mesh: TargetMesh) -> str:
    """Digest of all that is seen of a mesh."""
    digest = hashlib.sha256()
    for part in mesh.parts:
        digest.update(np.ascontiguousarray(part.vertices).tobytes())
        digest.update(np.ascontiguousarray(part.faces).tobytes())
        digest.update(b"" if part.uv is None else np.ascontiguousarray(part.uv).tobytes())
        digest.update(repr(dataclasses.replace(part.material, texture=None)).encode())
        digest.update(b"" if part.material.texture is None else np.ascontiguousarray(part.material.texture).data)
    return digest.hexdigest()


@dataclasses.dataclass(frozen=True)
class ViewCache:
    """Blocks of views; `key` tells mesh and settings from others."""

    folder: Path
    key: str

    def _path(self, start: int) -> Path:
        return self.folder / f"views_{start:05d}.npz"

    def read(self, start: int, count: int, names: Sequence[str]) -> dict[str, np.ndarray] | None:
        """Arrays (n, ...) of finished views from `start` on; None if they are missing, damaged, or of another key."""
        try:
            with np.load(self._path(start), allow_pickle=False) as content:
                if str(content["key"]) == self.key:
                    found = {name: content[name][:count] for name in names}
                    if all(len(values) == count for values in found.values()):
                        return found
        except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile, zlib.error):
            pass
        return None

    def write(self, start: int, arrays: Mapping[str, np.ndarray]) -> None:
        """Stores views; a file is written as a whole."""
        path = self._path(start)
        partial = path.with_suffix(".part")
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            with partial.open("wb") as stream:
                np.savez_compressed(stream, allow_pickle=False, key=np.array(self.key), **arrays)
            partial.replace(path)
        except OSError as error:
            text = f"{path}: cannot be written ({error.strerror}), expected a folder for views"
            raise RpojaxError(text) from None
