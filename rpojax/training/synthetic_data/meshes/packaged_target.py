"""Mesh of the target of the packaged scenarios, built from primitives."""

from collections.abc import Iterable
from typing import Any

import numpy as np

from rpojax.optional_packages import require_package
from rpojax.training.synthetic_data.meshes.target_mesh import Material, MeshPart, TargetMesh

PACKAGED_TARGET = "target"
FOIL = Material(color=(0.83, 0.52, 0.17), metallic=1.0, roughness=0.32)
RADIATOR = Material(color=(0.78, 0.78, 0.76), roughness=0.6)
CELL = Material(color=(0.03, 0.05, 0.16), roughness=0.3)
SUBSTRATE = Material(color=(0.42, 0.41, 0.38), roughness=0.7)
BLACK = Material(color=(0.04, 0.04, 0.045), roughness=0.5)
DISH = Material(color=(0.65, 0.65, 0.68), roughness=0.5)
STEEL = Material(color=(0.5, 0.5, 0.52), metallic=1.0, roughness=0.4)


def packaged_target() -> TargetMesh:
    """The packaged target: bus 0.5 x 0.5 x 0.6 m, two panels along y, 1.6 m span."""
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
            center = ((column - 1.5) * 0.106, side * (0.355 + row * 0.1265), 0.0115)
            pieces.append((CELL, _box(center, (0.094, 0.114, 0.004))))
    return pieces


def _box(center: tuple[float, float, float], size: tuple[float, float, float]) -> Any:
    box = require_package("trimesh").creation.box(extents=size)
    box.apply_translation(center)
    return box


def _cylinder(radius: float, height: float) -> Any:
    return require_package("trimesh").creation.cylinder(radius=radius, height=height, sections=32)


def _ring(inner: float, outer: float, height: float) -> Any:
    return require_package("trimesh").creation.annulus(r_min=inner, r_max=outer, height=height, sections=40)


def _open_paraboloid(radius: float, height: float) -> Any:
    """An open paraboloid, apex at the origin, rim at +z."""
    fraction = np.linspace(0.1, 1.0, 8)
    rim = np.stack([radius * fraction, height * fraction**2], axis=1)
    return require_package("trimesh").creation.revolve(
        np.concatenate([rim, rim[::-1] + np.array([0.0, 0.004])]), sections=32
    )


def _along_axis(piece: Any, axis: str, center: tuple[float, float, float]) -> Any:
    """A piece along z, rotated to another axis and moved."""
    rotations = {
        "x": [[0, 0, 1], [0, 1, 0], [-1, 0, 0]],
        "-x": [[0, 0, -1], [0, 1, 0], [1, 0, 0]],
        "y": [[1, 0, 0], [0, 0, 1], [0, -1, 0]],
    }
    transform = np.eye(4)
    transform[:3, :3], transform[:3, 3] = rotations[axis], center
    return piece.apply_transform(transform)


def _merge_by_material(pieces: list[tuple[Material, Any]]) -> Iterable[MeshPart]:
    """One part per material; faces of different pieces share no vertex."""
    for material in dict.fromkeys(material for material, _ in pieces):
        whole = require_package("trimesh").util.concatenate([piece for other, piece in pieces if other == material])
        yield MeshPart(np.asarray(whole.vertices), np.asarray(whole.faces), material)
