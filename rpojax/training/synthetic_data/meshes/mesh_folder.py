"""Files that a mesh refers to, such as materials and textures: read from its own folder alone."""

from pathlib import Path
from typing import Any

from rpojax.errors import RpojaxError
from rpojax.untrusted.file_reading import FileKind, absolute_path, read_bytes


class MeshFolder:
    """Resolver of trimesh for the files beside a mesh.

    Args:
        folder: of the mesh
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def get(self, name: str) -> bytes:
        """Content of a file by the name that the mesh gives.

        Raises:
            RpojaxError: it leads out of the folder, or cannot be read.
        """
        place = absolute_path(self._folder / name)
        if not place.is_relative_to(absolute_path(self._folder)):
            raise RpojaxError(f"{name}: found a file outside of the folder of the mesh, expected one inside")
        return read_bytes(place, FileKind.PICTURE)

    def __getitem__(self, name: str) -> bytes:
        """As `get`."""
        return self.get(name)

    def namespaced(self, _: Any) -> "MeshFolder":
        """The same resolver for the parts of a mesh."""
        return self

    def keys(self) -> list[str]:
        """Names of the files that can be read."""
        return sorted(path.name for path in self._folder.iterdir() if path.is_file())
