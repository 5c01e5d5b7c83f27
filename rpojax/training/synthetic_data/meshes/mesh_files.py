"""Meshes of a user from glb, gltf, obj, ply and stl files, with their materials."""

import dataclasses
import struct
import warnings
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from rpojax.training.synthetic_data.meshes.formats import gltf, ply, stl, wavefront_obj
from rpojax.training.synthetic_data.meshes.formats.mesh_source import FACE_LIMIT, MeshError, MeshSource, Surface
from rpojax.training.synthetic_data.meshes.packaged_target import PACKAGED_TARGET, packaged_target
from rpojax.training.synthetic_data.meshes.target_mesh import Material, MeshPart, TargetMesh
from rpojax.untrusted.file_reading import FileError, is_regular

METRES_PER_UNIT = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "in": 0.0254, "ft": 0.3048}
_READERS = {
    ".glb": gltf.read_surfaces,
    ".gltf": gltf.read_surfaces,
    ".obj": wavefront_obj.read_surfaces,
    ".ply": ply.read_surfaces,
    ".stl": stl.read_surfaces,
}
SUFFIXES = tuple(_READERS)
_SPAN_LIMITS_M = (0.05, 200.0)
_LARGEST_UNASKED_M = 60.0
"""Few spacecraft are larger; a CubeSat in millimetres looks so."""
_MAX_OFFSET_FRACTION = 0.25
_MAX_COLOR_PARTS = 64
"""Most parts made of the vertex or face colours of one geometry."""
_COLOR_LIMITS = (0.0002, 0.9)
"""Least and largest base colour."""
_LEAST_OPAQUE = 0.998
"""Opacity that counts as full: that of codes of 8 bit is known to half a code."""


class MeshWarning(UserWarning):
    """Something of a mesh file is not used, or is read in another way than it says; the text says what."""


def load_mesh(source: str | Path, units: str | None = None, center: bool = False) -> TargetMesh:
    """The packaged target (`target`) or the mesh of a file, in metres; `center` moves its bounding box to the origin.

    What of the file is not used is in `notes` of the mesh, and each of them is a `MeshWarning`. Raises `MeshError` if
    the file cannot be read, is empty, or has a size unlike that of a spacecraft.
    """
    if str(source) == PACKAGED_TARGET:
        if units is not None or center:
            raise MeshError.of_argument(
                "units, center", f"found with {PACKAGED_TARGET!r}, expected only with a mesh file"
            )
        return packaged_target()
    path = Path(source)
    if not is_regular(path):
        raise MeshError(
            f"{path}: no such file, expected a mesh ({', '.join(SUFFIXES)}) or the name {PACKAGED_TARGET!r}"
        )
    if path.suffix.lower() not in SUFFIXES:
        raise MeshError(f"{path}: found {path.suffix or 'no suffix'!r}, expected one of {', '.join(SUFFIXES)}")
    if units is not None and units not in METRES_PER_UNIT:
        raise MeshError.of_argument("units", f"found {units!r}, expected one of {', '.join(METRES_PER_UNIT)}")
    mesh = _read_mesh(path, METRES_PER_UNIT[units or "m"])
    if center:
        box_center = mesh.bounds.mean(axis=0)
        moved = (dataclasses.replace(part, vertices=part.vertices - box_center) for part in mesh.parts)
        mesh = dataclasses.replace(mesh, parts=tuple(moved))
    _check_size(path, mesh, units)
    span = float(np.ptp(mesh.bounds, axis=0).max())
    if units is None and span > _LARGEST_UNASKED_M:
        note = f"a span of {span:.4g} m, since metres are assumed unless units are given: is it in mm?"
        mesh = dataclasses.replace(mesh, notes=(*mesh.notes, note))
    for note in mesh.notes:
        warnings.warn(f"{path}: {note}", MeshWarning, stacklevel=2)
    return mesh


def _check_size(path: Path, mesh: TargetMesh, units: str | None) -> None:
    low, high = mesh.bounds
    span = float((high - low).max())
    smallest, largest = _SPAN_LIMITS_M
    if not smallest <= span <= largest:
        hint = "" if units else "; metres are assumed unless units are given"
        raise MeshError(f"{path}: found a span of {span:.4g} m, expected {smallest} to {largest:g} m{hint}")
    offset = float(np.abs(0.5 * (low + high)).max())
    if offset > _MAX_OFFSET_FRACTION * span:
        raise MeshError(
            f"{path}: found its centre {offset:.3g} m from the origin, expected within a quarter of its span "
            f"({_MAX_OFFSET_FRACTION * span:.3g} m); center=True moves it there"
        )


def _read_mesh(path: Path, scale: float) -> TargetMesh:
    """Mesh of a file, whose lengths are multiplied with `scale`.

    Raises:
        MeshError: it cannot be read, or has no triangles or too many.
    """
    try:
        source = MeshSource(path)
        parts = tuple(_parts(source, _READERS[path.suffix.lower()](source), scale))
    except FileError as error:
        raise MeshError(str(error)) from None
    except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError, struct.error) as error:
        raise MeshError(f"{path}: cannot be read as a mesh ({type(error).__name__}: {error})") from None
    notes = source.notes.lines()
    if not parts:
        found = f"no triangles that can be seen ({'; '.join(notes)})" if notes else "no triangles"
        raise source.fault(found, "a mesh with a surface")
    mesh = TargetMesh(path.stem, parts, notes)
    if mesh.face_count > FACE_LIMIT:
        raise source.fault(f"{mesh.face_count} triangles", f"at most {FACE_LIMIT}")
    return mesh


def _parts(source: MeshSource, surfaces: Iterable[Surface], scale: float) -> Iterable[MeshPart]:
    """Parts, each of one colour or picture, without invisible triangles and triangles of zero area."""
    for surface in surfaces:
        vertices = surface.vertices * scale
        corners = vertices[surface.faces]
        has_area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1) > 0.0
        kept = has_area & _is_visible(source, surface, has_area)
        if not kept.any():
            continue
        faces = surface.faces[kept]
        for material, own in _materials(surface, faces, kept):
            used, inverse = np.unique(own, return_inverse=True)
            uv = None if surface.uv is None or material.texture is None else surface.uv[used]
            yield MeshPart(vertices[used], inverse.reshape(-1, 3), material, uv)


def _is_visible(source: MeshSource, surface: Surface, counted: np.ndarray) -> np.ndarray:
    """Whether each triangle has any opacity; those of none, and of some, are noted where they are `counted`."""
    if surface.alpha is None:
        return np.ones(len(surface.faces), bool)
    hidden, partial = surface.alpha <= 0.0, (surface.alpha > 0.0) & (surface.alpha < _LEAST_OPAQUE)
    for kind, found in (
        ("triangles that are fully transparent, left out", hidden & counted),
        ("triangles that are partly transparent, drawn opaque", partial & counted),
    ):
        if found.any():
            source.notes.add(kind, "", int(found.sum()))
    return ~hidden


def _materials(surface: Surface, faces: np.ndarray, kept: np.ndarray) -> Iterable[tuple[Material, np.ndarray]]:
    """Material and faces of every part of a surface."""
    if surface.colors is None:
        yield dataclasses.replace(surface.material, color=_limited(np.array(surface.material.color))), faces
        return
    colors = surface.colors[kept]
    codes = np.round(255.0 * colors ** (1.0 / 2.2)).astype(np.int64)
    group = np.zeros(len(colors), np.int64)
    # The finest quantisation of colours that gives few enough parts.
    for shift in (0, 3, 4, 5, 6):
        _, group = np.unique(codes >> shift, axis=0, return_inverse=True)
        group = group.reshape(-1)
        if group.max() < _MAX_COLOR_PARTS:
            break
    for index in range(int(group.max()) + 1):
        mean = _limited(colors[group == index].mean(axis=0))
        yield dataclasses.replace(surface.material, color=mean), faces[group == index]


def _limited(color: np.ndarray) -> tuple[float, float, float]:
    """A linear colour within the limits of a surface."""
    red, green, blue = np.clip(color, _COLOR_LIMITS[0], _COLOR_LIMITS[1])
    return float(red), float(green), float(blue)
