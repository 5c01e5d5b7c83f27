"""Surface of the target, for inspection coverage and for ranges: packaged, hull of the scenario, or a mesh file."""

import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from rpojax.errors import RpojaxError, ScenarioError
from rpojax.scenario.plugins import plugin_registry
from rpojax.scenario.trained.trained_files import PACKAGED, file_digest
from rpojax.training.synthetic_data.meshes import mesh_files
from rpojax.training.synthetic_data.meshes.packaged_target import packaged_target
from rpojax.training.synthetic_data.meshes.target_mesh import TargetMesh
from rpojax.untrusted.file_reading import is_regular

HULL = "hull"
"""Value of `coverage.surface` that selects the convex hull of `target.hull_m`."""
SURFACES = (PACKAGED, HULL)
"""Values of `coverage.surface` that are no paths."""
MAX_FACETS = 20_000
MAX_TRIANGLES = 20_000


def meets_surface(tables: Mapping[str, Any]) -> bool:
    """Whether a sensor of a scenario measures the target's surface."""
    return any(each.meets_surface for each in plugin_registry.sensors_for(tables).values())


def is_surface_used(tables: Mapping[str, Any]) -> bool:
    """Whether coverage or a sensor of a scenario needs the target's surface."""
    return bool(tables.get("coverage", {}).get("enabled")) or meets_surface(tables)


def mesh_path(tables: Mapping[str, Any]) -> Path | None:
    """Path of the mesh file of a scenario, None if it has none or nothing needs it.

    Raises:
        ScenarioError: there is no such file.
    """
    coverage = tables.get("coverage", {})
    name = coverage.get("surface", HULL)
    if name in SURFACES or not is_surface_used(tables):
        return None
    path = Path(name)
    if not is_regular(path):
        raise ScenarioError("coverage.surface", name, f"'{PACKAGED}', '{HULL}' or the path of a mesh file")
    return path


def mesh_digest(tables: Mapping[str, Any]) -> str | None:
    """SHA-256 of the mesh file of a scenario, None if it needs none."""
    path = mesh_path(tables)
    return None if path is None else file_digest(path)


def surface_triangles(tables: Mapping[str, Any]) -> np.ndarray:
    """Triangles (n, 3, 3) of the nominal surface in T [m], counter-clockwise from outside.

    Raises:
        RpojaxError: the mesh file cannot be used, or facets and triangles are too many.
    """
    triangles = _triangles(tables)
    name, size = tables["coverage"]["surface"], tables["coverage"]["facet_size_m"]
    if len(triangles) > MAX_TRIANGLES:
        found = f"{len(triangles)} triangles in {name!r}"
        raise ScenarioError("coverage.surface", found, f"a mesh of at most {MAX_TRIANGLES}")
    sides = triangles[:, 1:] - triangles[:, :1]
    area = 0.5 * float(np.sum(np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1)))
    if area > MAX_FACETS * size * size:
        least = (area / MAX_FACETS) ** 0.5
        raise ScenarioError("coverage.facet_size_m", size, f"at least {least:.2g}, for at most {MAX_FACETS} facets")
    return triangles


def surface_warnings(tables: Mapping[str, Any]) -> list[str]:
    """What of the mesh file of a scenario is not used, a line for each kind; empty if it cannot be read, or is none."""
    try:
        path = mesh_path(tables)
        notes = () if path is None else _mesh(path, tables["coverage"]["mesh_units"]).notes
    except RpojaxError:  # raised when the surface is needed
        return []
    return [f"coverage.surface: {path}: {note}" for note in notes]


def _triangles(tables: Mapping[str, Any]) -> np.ndarray:
    return reflecting_triangles(tables)[0]


def reflecting_triangles(tables: Mapping[str, Any]) -> tuple[np.ndarray, np.ndarray | None]:
    """Triangles (n, 3, 3) of the nominal surface in T [m], and reflectivity (n,) by their colour, None of a hull.

    Raises:
        RpojaxError: the mesh file cannot be used, or the hull spans no volume.
    """
    coverage = tables["coverage"]
    if coverage["surface"] == HULL:
        return hull_triangles(np.array(tables["target"]["hull_m"])), None
    path = mesh_path(tables)
    mesh = packaged_target() if path is None else _mesh(path, coverage["mesh_units"])
    triangles = np.concatenate([part.vertices[part.faces] for part in mesh.parts])
    return triangles, np.concatenate([np.full(len(part.faces), np.mean(part.material.color)) for part in mesh.parts])


def _mesh(path: Path, units: str) -> TargetMesh:
    """Mesh of a file, whose notes are among the warnings about the scenario."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", mesh_files.MeshWarning)
        return mesh_files.load_mesh(path, units)


def hull_triangles(points: np.ndarray) -> np.ndarray:
    """Triangles (n, 3, 3) of the convex hull of points [m], counter-clockwise from outside.

    Raises:
        ScenarioError: the points span no volume.
    """
    try:
        hull = ConvexHull(points)
    except QhullError:
        raise ScenarioError("target.hull_m", points.tolist(), "points that span a volume") from None
    triangles = points[hull.simplices]
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    inwards = np.sum(normals * hull.equations[:, :3], axis=1) < 0.0
    return np.where(inwards[:, None, None], triangles[:, ::-1], triangles)
