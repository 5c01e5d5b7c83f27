"""Meshes of a user from glb, obj, ply and stl files, with their materials."""

import dataclasses
import io
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from rpojax.errors import RpojaxError
from rpojax.optional_packages import require_package
from rpojax.training.synthetic_data.meshes.mesh_folder import MeshFolder
from rpojax.training.synthetic_data.meshes.packaged_target import PACKAGED_TARGET, packaged_target
from rpojax.training.synthetic_data.meshes.target_mesh import Material, MeshPart, TargetMesh
from rpojax.untrusted.file_reading import FileError, FileKind, is_regular, read_bytes

METRES_PER_UNIT = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "in": 0.0254, "ft": 0.3048}
SUFFIXES = (".glb", ".obj", ".ply", ".stl")
FACE_LIMIT = 2_000_000
_SPAN_LIMITS_M = (0.05, 200.0)
_MAX_OFFSET_FRACTION = 0.25
_MAX_COLOR_PARTS = 64
"""Most parts made of the vertex or face colours of one geometry."""
_COLOR_LIMITS = (0.0002, 0.9)
"""Least and largest base colour."""
_MIN_ROUGHNESS = 0.2


class MeshError(RpojaxError):
    """A mesh cannot be used as a target."""


def load_mesh(source: str | Path, units: str | None = None, center: bool = False) -> TargetMesh:
    """The packaged target (`target`) or the mesh of a file, in metres; `center` moves its bounding box to the origin.

    Raises `MeshError` if the file cannot be read, is empty, or has a size unlike that of a spacecraft.
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
    require_package("trimesh")
    parts = _all_parts(path, METRES_PER_UNIT[units or "m"])
    if not parts:
        raise MeshError(f"{path}: found no triangles, expected a mesh with a surface")
    mesh = TargetMesh(path.stem, tuple(parts))
    if mesh.face_count > FACE_LIMIT:
        raise MeshError(f"{path}: found {mesh.face_count} triangles, expected at most {FACE_LIMIT}")
    if center:
        box_center = mesh.bounds.mean(axis=0)
        moved = (dataclasses.replace(part, vertices=part.vertices - box_center) for part in mesh.parts)
        mesh = dataclasses.replace(mesh, parts=tuple(moved))
    _check_size(path, mesh, units)
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


def _all_parts(path: Path, scale: float) -> list[MeshPart]:
    """Parts of a file.

    Raises:
        MeshError: it cannot be read, or its triangles do not fit its vertices.
    """
    try:
        return list(_read_parts(path, scale))
    except (ValueError, IndexError, TypeError) as error:
        raise MeshError(f"{path}: cannot be read as a mesh ({type(error).__name__}: {error})") from None


def _read_parts(path: Path, scale: float) -> Iterable[MeshPart]:
    """Parts of a file, without faces of zero area."""
    trimesh = require_package("trimesh")
    for geometry in _geometries(path):
        if not isinstance(geometry, trimesh.Trimesh) or len(geometry.faces) == 0:
            continue
        vertices = np.asarray(geometry.vertices, dtype=np.float64) * scale
        if not np.isfinite(vertices).all():
            raise MeshError(f"{path}: found a vertex that is not finite, expected finite coordinates")
        faces = np.asarray(geometry.faces)
        corners = vertices[faces]
        area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
        faces = faces[area > 0.0]
        if len(faces) == 0:
            continue
        for material, uv, own in _materials(geometry.visual, faces, np.flatnonzero(area > 0.0)):
            used, inverse = np.unique(own, return_inverse=True)
            yield MeshPart(vertices[used], inverse.reshape(-1, 3), material, None if uv is None else uv[used])


def _geometries(path: Path) -> list[Any]:
    """Geometries of a file, all of whose coordinates are finite; materials and textures are read from its folder.

    Raises:
        MeshError: it cannot be read, or has a coordinate that is not finite.
    """
    trimesh = require_package("trimesh")
    try:
        content, resolver = read_bytes(path, FileKind.MESH), MeshFolder(path.parent)
        kind = path.suffix.lower().removeprefix(".")
        # The first reading keeps what the second one, which merges vertices, would drop without a word.
        raw = trimesh.load_scene(io.BytesIO(content), file_type=kind, resolver=resolver, process=False)
        unlike = [each for each in raw.geometry.values() if not np.isfinite(np.asarray(each.vertices)).all()]
        scene = trimesh.load_scene(io.BytesIO(content), file_type=kind, resolver=resolver)
        geometries = list(scene.dump())
    except FileError as error:
        raise MeshError(str(error)) from None
    # The readers of meshes raise errors of many kinds.
    except Exception as error:
        raise MeshError(f"{path}: cannot be read as a mesh ({type(error).__name__}: {error})") from None
    if unlike:
        raise MeshError(f"{path}: found a vertex that is not finite, expected finite coordinates")
    return geometries


def _materials(
    visual: Any, faces: np.ndarray, number: np.ndarray
) -> Iterable[tuple[Material, np.ndarray | None, np.ndarray]]:
    """Material, texture coordinates and faces of every part of a geometry; `number` are the indices of its faces."""
    if getattr(visual, "kind", None) not in ("vertex", "face"):
        yield *_material(visual), faces
        return
    colors = np.asarray(visual.face_colors)[number, :3].astype(np.int64)
    group = np.zeros(len(colors), np.int64)
    # The finest quantisation of colours that gives few enough parts.
    for shift in (0, 3, 4, 5, 6):
        _, group = np.unique(colors >> shift, axis=0, return_inverse=True)
        group = group.reshape(-1)
        if group.max() < _MAX_COLOR_PARTS:
            break
    for index in range(int(group.max()) + 1):
        mean = colors[group == index].mean(axis=0)
        yield Material(color=_linear_color(mean)), None, faces[group == index]


def _material(visual: Any) -> tuple[Material, np.ndarray | None]:
    """Material of a trimesh visual, by default grey, and texture coordinates if it has a texture.

    Materials of glTF follow the format, with its defaults; a texture of metallicity and roughness is replaced by its
    mean. Colours of other formats are sRGB codes.
    """
    found = getattr(visual, "material", None)
    if getattr(visual, "kind", None) != "texture" or found is None:
        return Material(), None
    uv = getattr(visual, "uv", None)
    is_gltf = hasattr(found, "baseColorFactor")
    material = _gltf_material(found) if is_gltf else _obj_material(found)
    image = found.baseColorTexture if is_gltf else getattr(found, "image", None)
    if image is None or uv is None:
        return material, None
    texture = np.asarray(image.convert("RGB"))
    if is_gltf and found.baseColorFactor is not None:
        scaled = (texture / 255.0) * (np.asarray(found.baseColorFactor)[:3] / 255.0) ** (1.0 / 2.2)
        texture = np.round(255.0 * scaled).astype(np.uint8)
    return dataclasses.replace(material, texture=texture), np.asarray(uv, dtype=np.float64)


def _gltf_material(found: Any) -> Material:
    """Material of glTF, whose factors are linear; trimesh stores them in 8 bit."""
    factor = np.full(3, 255.0) if found.baseColorFactor is None else np.asarray(found.baseColorFactor, np.float64)[:3]
    red, green, blue = np.clip(factor / 255.0, _COLOR_LIMITS[0], _COLOR_LIMITS[1])
    metallic = 1.0 if found.metallicFactor is None else float(found.metallicFactor)
    roughness = 1.0 if found.roughnessFactor is None else float(found.roughnessFactor)
    image = found.metallicRoughnessTexture
    if image is not None:
        mean = np.asarray(image.convert("RGB"), np.float64).mean(axis=(0, 1)) / 255.0
        roughness, metallic = roughness * mean[1], metallic * mean[2]
    return Material(
        color=(float(red), float(green), float(blue)),
        metallic=float(np.clip(metallic, 0.0, 1.0)),
        roughness=float(np.clip(roughness, _MIN_ROUGHNESS, 1.0)),
    )


def _obj_material(found: Any) -> Material:
    """Material of OBJ and similar formats: colour and shininess."""
    pbr = found.to_pbr()
    color = Material().color if found.diffuse is None else _linear_color(np.asarray(found.diffuse, np.float64)[:3])
    roughness = Material().roughness if pbr.roughnessFactor is None else float(pbr.roughnessFactor)
    return Material(color=color, roughness=float(np.clip(roughness, _MIN_ROUGHNESS, 1.0)))


def _linear_color(codes: np.ndarray) -> tuple[float, float, float]:
    """Linear colour of 8 bit sRGB codes."""
    red, green, blue = np.clip((codes / 255.0) ** 2.2, _COLOR_LIMITS[0], _COLOR_LIMITS[1])
    return float(red), float(green), float(blue)
