"""Choice of a target's landmarks: corners of its mesh that tell its pose best from where it is seen worst.

Candidates are the corners of the mesh that are seen from outside, no two of them close together. They are chosen one
after the other, each time the one that adds most to what the visible landmarks tell of the pose, averaged over that
quarter of the viewing directions in which they tell least. What they tell is the logarithm of the determinant of the
information on position and attitude from lines of sight to them, which grows with their number and with their spread. A
symmetric body gets its landmarks in whole orbits, so that each of its symmetries exchanges landmarks with one another.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.spatial import KDTree

from rpojax.core.numerics.fibonacci_sphere import fibonacci_sphere
from rpojax.vision.surface import octahedral_map
from rpojax.vision.surface.landmarks import (
    LandmarkError,
    Landmarks,
    are_free,
    free_rays,
    landmark_table,
    with_symmetries,
)
from rpojax.vision.surface.port_view import PortView
from rpojax.vision.surface.surface_corners import Corners, corners
from rpojax.vision.surface.surface_symmetries import TOLERANCE, SampledSurface, Symmetry, surface_symmetries

FEWEST: Final = 6
"""Landmarks below which a mesh has no pose that a picture tells."""
MOST: Final = 64
SPACING: Final = 0.03
"""Least distance of two landmarks, as a share of the body's size."""
_MOST_CORNERS: Final = 2000
"""Corners that are looked at: the sharpest ones."""
_COARSE_CELLS: Final = 8
_VIEWS: Final = 96
_VIEW_DISTANCE: Final = 2.5
"""Distance of the views from the middle of the body, in its sizes."""
_WORST_SHARE: Final = 0.25
_PRIOR: Final = 1e-3
"""Information on each component of a pose before any landmark, in units of what one landmark tells: so little that the
first ones count, and enough that a view without them has a determinant."""


@dataclass(frozen=True)
class _Candidates:
    """Corners that may become landmarks: in orbits, and with the directions from which they are seen.

    Attributes:
        positions: (m, 3) [m]
        normals: (m, 3)
        table: (cells^2, m) as in `Landmarks`
        orbits: (m,) number of the orbit of each
        information: (views, m, 6, 6) that each gives in each view, zero where it is hidden; without units
    """

    positions: np.ndarray
    normals: np.ndarray
    table: np.ndarray
    orbits: np.ndarray
    information: np.ndarray


def select_landmarks(triangles: np.ndarray, count: int = 20, port: PortView | None = None) -> Landmarks:
    """Landmarks of the surface of triangles (t, 3, 3) in T [m], counter-clockwise from outside; at most `count`.

    Raises:
        LandmarkError: the surface has too few corners, the port is not on it or not open, or has too few landmarks.
    """
    if not FEWEST <= count <= MOST:
        raise LandmarkError.of_argument("count", f"found {count}, expected {FEWEST} to {MOST}")
    surface = SampledSurface(triangles)
    if port is not None:
        port.check(triangles, surface)
    seen, exposure = _outer_corners(triangles)
    if len(seen.positions) < FEWEST:
        found = f"{len(seen.positions)} corners that can be seen"
        raise LandmarkError(f"mesh: found {found}, expected at least {FEWEST}, as a smooth body has no landmarks")
    symmetries = surface_symmetries(surface, seen.positions)
    orbits = _orbits(seen.positions, exposure, symmetries, surface.size)
    if not orbits or sum(map(len, orbits)) < FEWEST:
        apart = f"{SPACING * surface.size:.2g} m apart"
        raise LandmarkError(f"mesh: found {sum(map(len, orbits))} corners {apart}, expected at least {FEWEST}")
    candidates = _candidates(seen, orbits, triangles, surface)
    chosen = [] if port is None else _chosen_at_port(candidates, port, surface, count)
    chosen = _extended(candidates.orbits, chosen, count, candidates.information)
    if len(chosen) < FEWEST:
        least = f"at least {min(map(len, orbits))}, corners that symmetries exchange"
        raise LandmarkError.of_argument("count", f"found {count}, expected {least}")
    return with_symmetries(
        candidates.positions[chosen],
        candidates.normals[chosen],
        candidates.table[:, chosen],
        symmetries,
        None if port is None else (port.position, port.unit_axis),
    )


def landmarks_at(positions: np.ndarray, triangles: np.ndarray, port: PortView | None = None) -> Landmarks:
    """Landmarks at given places (n, 3) of a surface as above, with those symmetries that exchange them.

    Raises:
        LandmarkError: a place is not on the surface, or inside of the body; there are too few; the port does not fit.
    """
    if not FEWEST <= len(positions) <= MOST:
        raise LandmarkError.of_argument("points", f"found {len(positions)} places, expected {FEWEST} to {MOST}")
    surface = SampledSurface(triangles)
    if port is not None:
        port.check(triangles, surface)
    distances, most = surface.distances(positions), TOLERANCE * surface.size
    if distances.max() > most:
        found = f"found landmark {np.argmax(distances)} at {distances.max():.3g} m from the surface"
        raise LandmarkError.of_argument("points", f"{found}, expected it on it, within {most:.2g} m")
    normals = surface.normals(positions)
    table = landmark_table(positions, normals, triangles)
    hidden = np.flatnonzero(~table.any(axis=0))
    if len(hidden):
        found = f"found landmark {hidden[0]} inside of the body"
        raise LandmarkError.of_argument("points", f"{found}, expected ones that can be seen")
    symmetries = surface_symmetries(surface, positions)
    if port is not None:
        on_face = int(port.on_face(positions, normals, table).sum())
        if on_face < port.fewest:
            raise LandmarkError.of_argument("points", f"found {on_face} on the port's face, expected {port.fewest}")
    return with_symmetries(
        positions, normals, table, symmetries, None if port is None else (port.position, port.unit_axis)
    )


def _outer_corners(triangles: np.ndarray) -> tuple[Corners, np.ndarray]:
    """Corners that are seen from outside, and the share of all directions from which each is (n,)."""
    found = corners(triangles)
    # The sharpest ones, with all that are as sharp as the last of them, so that a symmetric body keeps its symmetry.
    least = np.sort(found.defects)[::-1][min(_MOST_CORNERS, len(found.defects)) - 1] if len(found.defects) else 0.0
    kept = _subset(found, found.defects >= least - 1e-6)
    directions, _ = octahedral_map.cell_directions(_COARSE_CELLS)
    exposure = free_rays(kept.positions, kept.normals, triangles, directions).mean(axis=1)
    return _subset(kept, exposure > 0.0), exposure[exposure > 0.0]


def _subset(found: Corners, kept: np.ndarray) -> Corners:
    return Corners(found.positions[kept], found.normals[kept], found.defects[kept])


def _orbits(
    positions: np.ndarray, exposure: np.ndarray, symmetries: Sequence[Symmetry], size: float
) -> list[np.ndarray]:
    """Numbers of the corners of each orbit: corners that symmetries map to each other, none near another one.

    Of corners that are near each other the one is left that is seen from most directions.
    """
    tree, taken = KDTree(positions), np.zeros(len(positions), dtype=bool)
    orbits = []
    for number in np.argsort(-np.round(exposure, 6), kind="stable"):
        if taken[number]:
            continue
        images = np.concatenate([each.moved(positions[number][None]) for each in symmetries])
        orbit = np.unique(tree.query(images)[1])
        near = tree.query_ball_point(positions[orbit], SPACING * size)
        are_apart = all(len(np.intersect1d(each, orbit)) == 1 for each in near)
        if are_apart and not taken[orbit].any():
            taken[np.concatenate(near)] = True
            orbits.append(orbit)
    return orbits


def _candidates(
    seen: Corners, orbits: Sequence[np.ndarray], triangles: np.ndarray, surface: SampledSurface
) -> _Candidates:
    members = np.concatenate(orbits)
    positions, normals = seen.positions[members], seen.normals[members]
    table = landmark_table(positions, normals, triangles)
    views = surface.middle + _VIEW_DISTANCE * surface.size * fibonacci_sphere(_VIEWS).T
    information = np.stack(
        [_information(positions, np.asarray(are_free(table, view - positions)), view, surface) for view in views]
    )
    numbers = np.repeat(np.arange(len(orbits)), [len(each) for each in orbits])
    return _Candidates(positions, normals, table, numbers, information)


def _information(positions: np.ndarray, seen: np.ndarray, camera: np.ndarray, surface: SampledSurface) -> np.ndarray:
    """Information (m, 6, 6) on attitude and position from the lines of sight to places (m, 3) that are `seen` (m,).

    Positions are in units of the body's size, and lines of sight are known to the angle of one size at their mean
    distance, so that numbers depend on neither.
    """
    offset, line = (positions - surface.middle) / surface.size, (camera - positions) / surface.size
    distance = np.linalg.norm(line, axis=1)
    along = line / distance[:, None]
    across = (np.eye(3) - along[:, :, None] * along[:, None, :]) * (distance.mean() / distance)[:, None, None]
    # A turn by a small vector `a` moves the place by `a x offset`.
    jacobian = np.concatenate([across @ -_cross_matrices(offset), across], axis=2)
    return seen[:, None, None] * (jacobian.transpose(0, 2, 1) @ jacobian)


def _cross_matrices(vectors: np.ndarray) -> np.ndarray:
    """Matrices (n, 3, 3) whose products with a vector are cross products."""
    return np.cross(vectors[:, None, :], np.eye(3)[None]).transpose(0, 2, 1)


def _chosen_at_port(candidates: _Candidates, port: PortView, surface: SampledSurface, count: int) -> list[int]:
    """Candidates on the face of the port, as many as it has to have: those that tell most in the last look at it.

    Raises:
        LandmarkError: there are fewer.
    """
    on_face = port.on_face(candidates.positions, candidates.normals, candidates.table)
    information = _information(candidates.positions, on_face, port.camera(), surface)[None]
    chosen = _extended(candidates.orbits, [], count, information, on_face, port.fewest)
    if on_face[chosen].sum() < port.fewest:
        found = f"{on_face.sum()} corners on its face, {on_face[chosen].sum()} of them in {count} landmarks"
        raise LandmarkError.of_argument("port_position, port_axis", f"found {found}, expected {port.fewest}")
    return chosen


def _extended(
    orbits: np.ndarray,
    chosen: list[int],
    count: int,
    information: np.ndarray,
    counted: np.ndarray | None = None,
    enough: int = MOST,
) -> list[int]:
    """Candidates after whole orbits were added, each time the one that tells most, while they fit into `count`.

    If some are `counted` (m,), only orbits with one of them are added, until there are `enough` of these. `information`
    (views, m, 6, 6) is that of each candidate in each view.
    """
    by_orbit = np.stack([information[:, orbits == each].sum(axis=1) for each in range(orbits.max() + 1)], axis=1)
    sizes = np.bincount(orbits)
    open_ = np.bincount(orbits, weights=counted) > 0.0 if counted is not None else np.ones(len(sizes), dtype=bool)
    open_[np.unique(orbits[chosen])] = False
    while counted is None or counted[chosen].sum() < enough:
        fits = np.flatnonzero(open_ & (sizes <= count - len(chosen)))
        if not len(fits):
            break
        present = information[:, chosen].sum(axis=1) + _PRIOR * np.eye(6)
        told = np.linalg.slogdet(present[:, None] + by_orbit[:, fits])[1]
        worst = np.sort(told, axis=0)[: max(1, round(_WORST_SHARE * len(told)))]
        best = int(fits[np.argmax(worst.mean(axis=0))])
        open_[best] = False
        chosen = [*chosen, *np.flatnonzero(orbits == best).tolist()]
    return chosen
