"""Facets and visibility tables in the folder of compiled programs, so that later processes need not make them again."""

import hashlib
import os
import zipfile
import zlib
from pathlib import Path
from typing import Final

import numpy as np

from rpojax.vision.surface.facets import Facets, make_facets
from rpojax.vision.surface.visibility_table import CELLS, visibility_table

_FORMAT: Final = 1
"""To be counted up with every change of what facets and tables are made of."""


def facets_and_table(triangles: np.ndarray, size_m: float) -> tuple[Facets, np.ndarray]:
    """Facets of a surface of triangles (n, 3, 3) [m] and their visibility table, made or from an earlier process.

    They are kept if JAX_COMPILATION_CACHE_DIR is set, as the command line does.
    """
    path = _path(triangles, size_m)
    found = None if path is None else _read(path)
    if found is not None:
        return found
    facets = make_facets(triangles, size_m)
    table = visibility_table(facets, triangles)
    if path is not None:
        _write(path, facets, table)
    return facets, table


def _path(triangles: np.ndarray, size_m: float) -> Path | None:
    folder = os.environ.get("JAX_COMPILATION_CACHE_DIR")
    if not folder:
        return None
    digest = hashlib.sha256(f"{_FORMAT} {CELLS} {size_m!r} {triangles.shape}".encode())
    digest.update(np.ascontiguousarray(triangles, dtype=np.float64).tobytes())
    return Path(folder) / "rpojax_surfaces" / f"{digest.hexdigest()}.npz"


def _read(path: Path) -> tuple[Facets, np.ndarray] | None:
    """Content of a file, None if it is missing or damaged."""
    try:
        with np.load(path, allow_pickle=False) as content:
            arrays = dict(content)
        table = arrays.pop("visible")
        return Facets(**arrays), table
    except (OSError, ValueError, KeyError, TypeError, EOFError, zipfile.BadZipFile, zlib.error):
        return None


def _write(path: Path, facets: Facets, table: np.ndarray) -> None:
    """Writes a file as a whole; without effect where that is impossible."""
    partial = path.with_name(f"{path.name}.{os.getpid()}.part")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with partial.open("wb") as stream:
            np.savez_compressed(
                stream,
                centers=facets.centers,
                normals=facets.normals,
                areas=facets.areas,
                pieces=facets.pieces,
                piece_facets=facets.piece_facets,
                visible=table,
            )
        partial.replace(path)
    except OSError:
        partial.unlink(missing_ok=True)
