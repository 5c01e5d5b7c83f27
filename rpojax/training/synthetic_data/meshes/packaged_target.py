"""Mesh of the target of the packaged scenarios, built from primitives."""

import dataclasses
from collections.abc import Iterable

import numpy as np

from rpojax.training.synthetic_data.meshes.mesh_primitives import (
    Solid,
    Solids,
    box,
    frustum,
    merge_solids,
    surface_of_revolution,
)
from rpojax.training.synthetic_data.meshes.target_mesh import Material, MeshPart, TargetMesh

PACKAGED_TARGET = "target"
PORT_POSITION = (0.0, 0.0, 0.303)
"""Docking port [m]: on the side of the cells, from where the way out is free, and corners of bus and panels are seen
face on and in two depths. From the sides along x the panels are seen edge on, and that along -z has four corners."""
PORT_AXIS = (0.0, 0.0, 1.0)
FOIL = Material(color=(0.83, 0.52, 0.17), metallic=1.0, roughness=0.32)
RADIATOR = Material(color=(0.78, 0.78, 0.76), roughness=0.6)
CELL = Material(color=(0.03, 0.05, 0.16), roughness=0.3)
SUBSTRATE = Material(color=(0.42, 0.41, 0.38), roughness=0.7)
BLACK = Material(color=(0.04, 0.04, 0.045), roughness=0.5)
DISH = Material(color=(0.65, 0.65, 0.68), roughness=0.5)
STEEL = Material(color=(0.5, 0.5, 0.52), metallic=1.0, roughness=0.4)


def packaged_target() -> TargetMesh:
    """The packaged target: bus 0.5 x 0.5 x 0.6 m, two panels along y, 1.6 m span."""
    solids = [_box(FOIL, (0.0, 0.0, 0.0), (0.494, 0.494, 0.594))]
    solids += [_box(RADIATOR, (0.0, 0.0, 0.2985), (0.46, 0.46, 0.009))]
    solids += [_box(BLACK, (0.0, 0.0, -0.2985), (0.46, 0.46, 0.009))]
    solids += [_box(RADIATOR, (x, 0.12, -0.13), (0.007, 0.18, 0.24)) for x in (-0.2485, 0.2485)]
    for side in (-1.0, 1.0):
        solids += _panel(side)
    solids += [
        _along_axis(_open_paraboloid(DISH, 0.11, 0.05), "y", (0.0, 0.262, 0.15)),
        _along_axis(frustum(BLACK, 0.012, 0.06, sections=32), "y", (0.0, 0.28, 0.15)),
        _along_axis(_open_paraboloid(STEEL, 0.09, 0.11), "-x", (-0.157, 0.0, 0.06)),
        _along_axis(_ring(STEEL, 0.15, 0.17, 0.02), "x", (-0.257, 0.0, 0.06)),
        _along_axis(frustum(BLACK, 0.045, 0.04, sections=32), "x", (0.246, -0.12, 0.14)),
        _along_axis(frustum(DISH, 0.08, 0.02, sections=32), "x", (0.257, 0.0, -0.18)),
        _box(DISH, (0.12, -0.12, 0.3105), (0.1, 0.14, 0.018)),
    ]
    return TargetMesh(PACKAGED_TARGET, tuple(_merge_by_material(solids)))


def _panel(side: float) -> Solids:
    """A panel with its yoke, and rows of cells on its +z side."""
    solids = [_box(SUBSTRATE, (0.0, side * 0.545, 0.0), (0.44, 0.51, 0.02))]
    solids += [_box(STEEL, (x, side * 0.27, 0.0), (0.03, 0.06, 0.02)) for x in (-0.1, 0.1)]
    for row in range(4):
        for column in range(4):
            center = ((column - 1.5) * 0.106, side * (0.355 + row * 0.1265), 0.0115)
            solids.append(_box(CELL, center, (0.094, 0.114, 0.004)))
    return solids


def _box(material: Material, center: tuple[float, float, float], size: tuple[float, float, float]) -> Solid:
    return box(material, *size).translated(*center)


def _ring(material: Material, inner: float, outer: float, height: float) -> Solid:
    half = 0.5 * height
    profile = [(inner, -half), (outer, -half), (outer, half), (inner, half), (inner, -half)]
    return surface_of_revolution(material, profile, sections=40)


def _open_paraboloid(material: Material, radius: float, height: float) -> Solid:
    """An open paraboloid, apex at the origin, rim at +z."""
    rim = [(radius * fraction, height * fraction**2) for fraction in np.linspace(0.1, 1.0, 8).tolist()]
    inside = [(distance, level + 0.004) for distance, level in reversed(rim)]
    return surface_of_revolution(material, [*rim, *inside], sections=32)


def _along_axis(solid: Solid, axis: str, center: tuple[float, float, float]) -> Solid:
    """A solid of revolution along z, rotated to another axis and moved, its faces counter-clockwise from outside."""
    rotations = {
        "x": [[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]],
        "-x": [[0.0, 0.0, -1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]],
        "y": [[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]],
    }
    vertices = solid.vertices @ np.array(rotations[axis]).T + np.array(center)
    return dataclasses.replace(solid, vertices=vertices, faces=solid.faces[:, ::-1])


def _merge_by_material(solids: Solids) -> Iterable[MeshPart]:
    """One part per material; faces of different solids share no vertex."""
    for material in dict.fromkeys(solid.material for solid in solids):
        whole = merge_solids([solid for solid in solids if solid.material == material])
        corners = whole.vertices[whole.faces]
        area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
        # On the axis of a solid of revolution faces have no area.
        yield MeshPart(whole.vertices, whole.faces[area > 1e-12], material)
