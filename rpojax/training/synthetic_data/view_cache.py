"""Files of finished ray-traced views, so that an interrupted call continues."""

import dataclasses
import hashlib
import zipfile
import zlib
from pathlib import Path

import numpy as np

from rpojax.errors import RpojaxError
from rpojax.training.synthetic_data.meshes.target_mesh import TargetMesh
from rpojax.training.synthetic_data.random_views import ViewSampling

_FORMAT = 2


class ViewCache:
    """Blocks of finished views of one mesh and one sampling, in a folder."""

    def __init__(self, folder: Path, mesh: TargetMesh, sampling: ViewSampling) -> None:
        self.folder = folder
        digest = hashlib.sha256()
        for part in mesh.parts:
            digest.update(np.ascontiguousarray(part.vertices).tobytes())
            digest.update(np.ascontiguousarray(part.faces).tobytes())
            digest.update(b"" if part.uv is None else np.ascontiguousarray(part.uv).tobytes())
            digest.update(repr(dataclasses.replace(part.material, texture=None)).encode())
            digest.update(b"" if part.material.texture is None else np.ascontiguousarray(part.material.texture).data)
        settings = dataclasses.replace(sampling, count=0)
        self.key = f"{_FORMAT} {digest.hexdigest()} {settings}"

    def _path(self, start: int) -> Path:
        return self.folder / f"views_{start:05d}.npz"

    def read(self, start: int, count: int) -> np.ndarray | None:
        """Finished views from `start` on, or None if they are missing, damaged, or of another mesh or sampling."""
        try:
            with np.load(self._path(start), allow_pickle=False) as content:
                if str(content["key"]) == self.key and len(content["film"]) >= count:
                    return content["film"][:count]
        except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile, zlib.error):
            pass
        return None

    def write(self, start: int, film: np.ndarray) -> None:
        """Stores views; a file is written as a whole."""
        path = self._path(start)
        partial = path.with_suffix(".part")
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            with partial.open("wb") as stream:
                np.savez_compressed(stream, film=film, key=np.array(self.key))
            partial.replace(path)
        except OSError as error:
            text = f"{path}: cannot be written ({error.strerror}), expected a folder for views"
            raise RpojaxError(text) from None
