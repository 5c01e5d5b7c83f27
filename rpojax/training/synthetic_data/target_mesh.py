"""The target as a mesh: the packaged one, built from primitives, and those that a user brings."""

import dataclasses
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from rpojax.errors import RpojaxError
from rpojax.optional import require_package

METRES_PER_UNIT = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "in": 0.0254, "ft": 0.3048}
SUFFIXES = (".glb", ".obj", ".ply", ".stl")
PACKAGED_TARGET = "target"
FACE_LIMIT = 2_000_000
_SPAN_LIMITS_M = (0.05, 200.0)
_MAX_OFFSET_FRACTION = 0.25
_MAX_COLOR_PARTS = 64
"""Most parts that one geometry's vertex or face colours make."""
_COLOR_LIMITS = (0.0002, 0.9)
"""Nothing in space is blacker or whiter."""
_MIN_ROUGHNESS = 0.2


class MeshError(RpojaxError):
    """A mesh cannot be used as a target."""


@dataclasses.dataclass(frozen=True)
class Material:
    """How a surface reflects: linear base colour, metallic, roughness; a texture (8 bit sRGB) replaces the colour."""

    color: tuple[float, float, float] = (0.5, 0.5, 0.5)
    metallic: float = 0.0
    roughness: float = 0.5
    texture: np.ndarray | None = None


@dataclasses.dataclass(frozen=True)
class MeshPart:
    """Triangles of one material: vertices (n, 3) [m], faces (m, 3), texture coordinates (n, 2) if there is one."""

    vertices: np.ndarray
    faces: np.ndarray
    material: Material
    uv: np.ndarray | None = None


@dataclasses.dataclass(frozen=True)
class TargetMesh:
    """A target in body axes T, its parts by material."""

    name: str
    parts: tuple[MeshPart, ...]

    @property
    def vertices(self) -> np.ndarray:
        """All vertices (n, 3) [m]."""
        return np.concatenate([part.vertices for part in self.parts])

    @property
    def face_count(self) -> int:
        """Number of triangles."""
        return sum(len(part.faces) for part in self.parts)

    @property
    def bounds(self) -> np.ndarray:
        """(2, 3) lowest and highest corner [m]."""
        return np.stack([self.vertices.min(axis=0), self.vertices.max(axis=0)])

    def surface_points(self, spacing_m: float, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
        """Random points (n, 3) [m] of the surface and its normals there, a dozen to every square of `spacing_m`."""
        rng = np.random.default_rng(seed)
        points, normals = [], []
        for part in self.parts:
            a, b, c = (part.vertices[part.faces[:, i]] for i in range(3))
            normal = np.cross(b - a, c - a)
            area = 0.5 * np.linalg.norm(normal, axis=1)
            count = rng.poisson(12.0 * area / spacing_m**2)
            count = np.maximum(count, 1)
            face = np.repeat(np.arange(len(area)), count)
            u, v = rng.random((2, len(face), 1))
            folded = u + v > 1.0
            u, v = np.where(folded, 1.0 - u, u), np.where(folded, 1.0 - v, v)
            points.append(a[face] + u * (b - a)[face] + v * (c - a)[face])
            normals.append((normal / (2.0 * area[:, None]))[face])
        return np.concatenate(points), np.concatenate(normals)


def outline_vertices(mesh: TargetMesh, max_vertices: int = 64) -> np.ndarray:
    """At most so many vertices (n, 3) [m] that span the outline: the farthest in directions all round."""
    index = np.arange(max_vertices) + 0.5
    height, azimuth = 1.0 - 2.0 * index / max_vertices, np.pi * (1.0 + np.sqrt(5.0)) * index
    level = np.sqrt(1.0 - height**2)
    away = np.stack([level * np.cos(azimuth), level * np.sin(azimuth), height], axis=1)
    vertices = mesh.vertices
    farthest = [int(np.argmax(vertices @ direction)) for direction in away]
    return np.unique(np.round(vertices[farthest], 4), axis=0)


def apparent_size(points: np.ndarray) -> float:
    """Geometric mean of the root of width times height [m] of an outline (n, 3) over all attitudes."""
    turns = Rotation.from_quat(np.random.default_rng(0).normal(size=(4000, 4))).as_matrix()[:, :2]
    width = np.ptp(np.einsum("nij,vj->niv", turns, points), axis=2)
    return float(np.exp(np.mean(np.log(width))))


def load_mesh(source: str | Path, units: str | None = None, center: bool = False) -> TargetMesh:
    """The packaged target (`target`) or the mesh of a file, in metres; `center` moves its box's middle to the origin.

    Raises `MeshError` where the file cannot be read, is empty, or has a size that no spacecraft has.
    """
    if str(source) == PACKAGED_TARGET:
        if units is not None or center:
            raise MeshError(f"--units, --center: found with {PACKAGED_TARGET!r}, expected only with a mesh file")
        return packaged_target()
    path = Path(source)
    if not path.is_file():
        raise MeshError(
            f"{path}: no such file, expected a mesh ({', '.join(SUFFIXES)}) or the name {PACKAGED_TARGET!r}"
        )
    if path.suffix.lower() not in SUFFIXES:
        raise MeshError(f"{path}: found {path.suffix or 'no suffix'!r}, expected one of {', '.join(SUFFIXES)}")
    if units is not None and units not in METRES_PER_UNIT:
        raise MeshError(f"--units: found {units!r}, expected one of {', '.join(METRES_PER_UNIT)}")
    require_package("trimesh")
    parts = list(_read_parts(path, METRES_PER_UNIT[units or "m"]))
    if not parts:
        raise MeshError(f"{path}: found no triangles, expected a mesh with a surface")
    mesh = TargetMesh(path.stem, tuple(parts))
    if mesh.face_count > FACE_LIMIT:
        raise MeshError(f"{path}: found {mesh.face_count} triangles, expected at most {FACE_LIMIT}")
    if center:
        middle = mesh.bounds.mean(axis=0)
        moved = (dataclasses.replace(part, vertices=part.vertices - middle) for part in mesh.parts)
        mesh = dataclasses.replace(mesh, parts=tuple(moved))
    _check_size(path, mesh, units)
    return mesh


def _check_size(path: Path, mesh: TargetMesh, units: str | None) -> None:
    low, high = mesh.bounds
    span = float((high - low).max())
    smallest, largest = _SPAN_LIMITS_M
    if not smallest <= span <= largest:
        hint = "" if units else "; units are metres unless --units says otherwise, such as --units mm"
        raise MeshError(f"{path}: found a span of {span:.4g} m, expected {smallest} to {largest:g} m{hint}")
    offset = float(np.abs(0.5 * (low + high)).max())
    if offset > _MAX_OFFSET_FRACTION * span:
        raise MeshError(
            f"{path}: found its middle {offset:.3g} m from the origin, expected within a quarter of its span "
            f"({_MAX_OFFSET_FRACTION * span:.3g} m); --center moves it there"
        )


def _read_parts(path: Path, scale: float) -> Iterable[MeshPart]:
    """Parts of a file with faces that have an area."""
    trimesh = require_package("trimesh")
    try:
        scene = trimesh.load_scene(path)
        geometries = scene.dump()
    except Exception as error:
        raise MeshError(f"{path}: cannot be read as a mesh ({type(error).__name__}: {error})") from None
    for geometry in geometries:
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


def _materials(
    visual: Any, faces: np.ndarray, number: np.ndarray
) -> Iterable[tuple[Material, np.ndarray | None, np.ndarray]]:
    """Material, texture coordinates and faces of every part of a geometry; `number` are those of its faces."""
    if getattr(visual, "kind", None) not in ("vertex", "face"):
        yield *_material(visual), faces
        return
    colors = np.asarray(visual.face_colors)[number, :3].astype(np.int64)
    group = np.zeros(len(colors), np.int64)
    # As finely as gives a moderate number of parts.
    for shift in (0, 3, 4, 5, 6):
        _, group = np.unique(colors >> shift, axis=0, return_inverse=True)
        group = group.reshape(-1)
        if group.max() < _MAX_COLOR_PARTS:
            break
    for index in range(int(group.max()) + 1):
        mean = colors[group == index].mean(axis=0)
        yield Material(color=_linear_color(mean)), None, faces[group == index]


def _material(visual: Any) -> tuple[Material, np.ndarray | None]:
    """Material of a trimesh visual, grey where there is none, and texture coordinates if it has a texture.

    Materials of glTF are what the format says, its defaults included; of a texture of metallicity and roughness the
    mean counts. Colours of other formats are sRGB codes.
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
    """Material of glTF, whose factors are linear; trimesh holds them as 8 bit."""
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
    """Material of OBJ and the like: a colour, and how shiny it is."""
    pbr = found.to_pbr()
    color = Material().color if found.diffuse is None else _linear_color(np.asarray(found.diffuse, np.float64)[:3])
    roughness = Material().roughness if pbr.roughnessFactor is None else float(pbr.roughnessFactor)
    return Material(color=color, roughness=float(np.clip(roughness, _MIN_ROUGHNESS, 1.0)))


def _linear_color(codes: np.ndarray) -> tuple[float, float, float]:
    """Linear colour of 8 bit sRGB codes."""
    red, green, blue = np.clip((codes / 255.0) ** 2.2, _COLOR_LIMITS[0], _COLOR_LIMITS[1])
    return float(red), float(green), float(blue)


FOIL = Material(color=(0.83, 0.52, 0.17), metallic=1.0, roughness=0.32)
RADIATOR = Material(color=(0.78, 0.78, 0.76), roughness=0.6)
CELL = Material(color=(0.03, 0.05, 0.16), roughness=0.3)
SUBSTRATE = Material(color=(0.42, 0.41, 0.38), roughness=0.7)
BLACK = Material(color=(0.04, 0.04, 0.045), roughness=0.5)
DISH = Material(color=(0.65, 0.65, 0.68), roughness=0.5)
STEEL = Material(color=(0.5, 0.5, 0.52), metallic=1.0, roughness=0.4)


def packaged_target() -> TargetMesh:
    """The target of the packaged scenarios: bus 0.5 x 0.5 x 0.6 m, two panels along y, 1.6 m span."""
    pieces: list[tuple[Material, Any]] = [(FOIL, _box((0.0, 0.0, 0.0), (0.494, 0.494, 0.594)))]
    pieces += [(RADIATOR, _box((0.0, 0.0, 0.2985), (0.46, 0.46, 0.009)))]
    pieces += [(BLACK, _box((0.0, 0.0, -0.2985), (0.46, 0.46, 0.009)))]
    for x in (-0.2485, 0.2485):
        pieces += [(RADIATOR, _box((x, 0.12, -0.13), (0.007, 0.18, 0.24)))]
    for side in (-1.0, 1.0):
        pieces += _panel(side)
    pieces += [
        (DISH, _along_axis(_open_paraboloid(0.11, 0.05), "y", (0.0, 0.262, 0.15))),
        (BLACK, _along_axis(_cylinder(0.012, 0.06), "y", (0.0, 0.28, 0.15))),
        (STEEL, _along_axis(_open_paraboloid(0.09, 0.11), "-x", (-0.157, 0.0, 0.06))),
        (STEEL, _along_axis(_ring(0.15, 0.17, 0.02), "x", (-0.257, 0.0, 0.06))),
        (BLACK, _along_axis(_cylinder(0.045, 0.04), "x", (0.246, -0.12, 0.14))),
        (DISH, _along_axis(_cylinder(0.08, 0.02), "x", (0.257, 0.0, -0.18))),
        (DISH, _box((0.12, -0.12, 0.3105), (0.1, 0.14, 0.018))),
    ]
    return TargetMesh(PACKAGED_TARGET, tuple(_merge_by_material(pieces)))


def _panel(side: float) -> list[tuple[Material, Any]]:
    """A panel with its yoke, and rows of cells on its +z side."""
    pieces = [(SUBSTRATE, _box((0.0, side * 0.545, 0.0), (0.44, 0.51, 0.02)))]
    pieces += [(STEEL, _box((x, side * 0.27, 0.0), (0.03, 0.06, 0.02))) for x in (-0.1, 0.1)]
    for row in range(4):
        for column in range(4):
            middle = ((column - 1.5) * 0.106, side * (0.355 + row * 0.1265), 0.0115)
            pieces.append((CELL, _box(middle, (0.094, 0.114, 0.004))))
    return pieces


def _box(middle: tuple[float, float, float], size: tuple[float, float, float]) -> Any:
    box = require_package("trimesh").creation.box(extents=size)
    box.apply_translation(middle)
    return box


def _cylinder(radius: float, height: float) -> Any:
    return require_package("trimesh").creation.cylinder(radius=radius, height=height, sections=32)


def _ring(inner: float, outer: float, height: float) -> Any:
    return require_package("trimesh").creation.annulus(r_min=inner, r_max=outer, height=height, sections=40)


def _open_paraboloid(radius: float, height: float) -> Any:
    """An open shell of revolution, apex at the origin, rim at +z."""
    share = np.linspace(0.1, 1.0, 8)
    rim = np.stack([radius * share, height * share**2], axis=1)
    return require_package("trimesh").creation.revolve(
        np.concatenate([rim, rim[::-1] + np.array([0.0, 0.004])]), sections=32
    )


def _along_axis(piece: Any, axis: str, middle: tuple[float, float, float]) -> Any:
    """A piece of revolution about z, turned to another axis and moved."""
    turns = {
        "x": [[0, 0, 1], [0, 1, 0], [-1, 0, 0]],
        "-x": [[0, 0, -1], [0, 1, 0], [1, 0, 0]],
        "y": [[1, 0, 0], [0, 0, 1], [0, -1, 0]],
    }
    transform = np.eye(4)
    transform[:3, :3], transform[:3, 3] = turns[axis], middle
    return piece.apply_transform(transform)


def _merge_by_material(pieces: list[tuple[Material, Any]]) -> Iterable[MeshPart]:
    """One part for each material, flat-shaded: no vertex is shared by faces of different pieces."""
    for material in dict.fromkeys(material for material, _ in pieces):
        whole = require_package("trimesh").util.concatenate([piece for other, piece in pieces if other == material])
        yield MeshPart(np.asarray(whole.vertices), np.asarray(whole.faces), material)
