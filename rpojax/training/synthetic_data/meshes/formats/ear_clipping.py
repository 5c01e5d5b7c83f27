"""Division of polygons into triangles: fans where they are convex, otherwise by cutting off ears.

Source: Meisters, Polygons have ears, American Mathematical Monthly 82, 1975. The normal and area of a polygon in space
are those of Newell's sums.
"""

import dataclasses

import numpy as np

_TOLERANCE = 1e-9
"""Of areas, relative to the square of a polygon's size."""
_FLAT = 0.01
"""Largest distance of a corner of a flat polygon from its plane, relative to the polygon's size."""
_MOST_CORNERS = 1000
"""Most corners of a polygon that is not convex."""
_MOST_WORK = 300_000
"""Most corners of all such polygons of a mesh."""


class PolygonError(ValueError):
    """A polygon cannot be divided into triangles; the text says what was found."""


@dataclasses.dataclass(frozen=True)
class Triangles:
    """Triangles of polygons.

    Attributes:
        corners: (t, 3) places in the list of all corners
        polygons: (t,) to which each belongs
        bent: number of polygons that are not flat
        too_small: number of polygons of fewer than three corners
    """

    corners: np.ndarray
    polygons: np.ndarray
    bent: int
    too_small: int


def triangulate(points: np.ndarray, sizes: np.ndarray) -> Triangles:
    """Triangles of polygons, turning as these do; those of no area are left out where polygons have more corners.

    Args:
        points: (c, 3) corners of all polygons, one after the other
        sizes: (p,) number of corners of each

    Raises:
        PolygonError: the outline of one crosses itself, or it has too many corners.
    """
    starts = np.cumsum(sizes) - sizes
    corners, polygons, bent, work = [np.zeros((0, 3), np.int64)], [np.zeros(0, np.int64)], 0, 0
    for size in np.unique(sizes[sizes >= 3]):
        which = np.flatnonzero(sizes == size)
        places = starts[which, None] + np.arange(size)
        fans = _fan_corners(int(size))
        if size == 3:
            corners.append(places)
            polygons.append(which)
            continue
        flat = _project(points[places])
        bent += int(flat.is_bent.sum())
        others = np.arange(len(which))
        # A quadrilateral that is not convex is filled by the fan of its reflex corner or of the opposite one.
        for turn in (0, 1) if size == 4 else (0,):
            fan = _fan_is_right(np.roll(flat.points[others], -turn, axis=1))
            corners.append(np.roll(places[others[fan]], -turn, axis=1)[:, fans].reshape(-1, 3))
            polygons.append(np.repeat(which[others[fan]], len(fans)))
            others = others[~fan]
        work += int(size) * len(others)
        if len(others) and size > _MOST_CORNERS:
            raise PolygonError(f"a face of {size} corners that is not convex")
        if work > _MOST_WORK:
            raise PolygonError(f"more than {_MOST_WORK} corners of faces that are not convex")
        for index in others:
            found = _clipped(flat.points[index], int(which[index]))
            corners.append(places[index][found])
            polygons.append(np.full(len(found), which[index]))
    owner = np.concatenate(polygons)
    order = np.argsort(owner, kind="stable")
    return Triangles(np.concatenate(corners)[order], owner[order], bent, int((sizes < 3).sum()))


def _fan_corners(size: int) -> np.ndarray:
    middle = np.arange(1, size - 1)
    return np.stack([np.zeros_like(middle), middle, middle + 1], axis=1)


@dataclasses.dataclass(frozen=True)
class _Projected:
    """Polygons (k, n, 2) of unit size in planes of their own, counter-clockwise, and whether each is bent."""

    points: np.ndarray
    is_bent: np.ndarray


def _project(points: np.ndarray) -> _Projected:
    """Polygons (k, n, 3) in the planes of their Newell normals."""
    center = points.mean(axis=1, keepdims=True)
    size = np.maximum(np.abs(points - center).max(axis=(1, 2), keepdims=True), np.finfo(float).tiny)
    unit = (points - center) / size
    normal = np.cross(unit, np.roll(unit, -1, axis=1)).sum(axis=1)
    length = np.linalg.norm(normal, axis=1, keepdims=True)
    none = length[:, 0] <= _TOLERANCE
    normal = normal / np.maximum(length, np.finfo(float).tiny)
    # A polygon without area is a line, or crosses itself, as its outline shows in the plane that fits it best.
    normal[none] = np.linalg.svd(unit[none])[2][:, 2]
    least = np.eye(3)[np.argmin(np.abs(normal), axis=1)]
    first = np.cross(least, normal)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    second = np.cross(normal, first)
    in_plane = np.stack([np.einsum("knj,kj->kn", unit, axis) for axis in (first, second)], axis=2)
    off_plane = np.abs(np.einsum("knj,kj->kn", unit, normal)).max(axis=1)
    return _Projected(in_plane, off_plane > _FLAT)


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]


def _fan_is_right(points: np.ndarray) -> np.ndarray:
    """Whether the fan from the first corner fills each polygon (k, n, 2)."""
    spokes = points[:, 1:] - points[:, :1]
    fan = _cross(spokes[:, :-1], spokes[:, 1:])
    side = np.roll(points, -1, axis=1) - points
    turn = _cross(np.roll(side, 1, axis=1), side)
    is_right = np.all(fan >= -_TOLERANCE, axis=1)
    return is_right if points.shape[1] == 4 else is_right & np.all(turn >= -_TOLERANCE, axis=1)


def _clipped(points: np.ndarray, number: int) -> np.ndarray:
    """Triangles (t, 3) of a polygon (n, 2), counter-clockwise.

    Raises:
        PolygonError: its outline crosses itself.
    """
    if _crosses_itself(points):
        raise PolygonError(f"face {number + 1} whose outline crosses itself")
    left, found, start = list(range(len(points))), [], 0
    while len(left) >= 3:
        place = _corner_to_cut(points[left], start)
        if place is None:
            raise PolygonError(f"face {number + 1} whose outline crosses itself")
        corner, has_area = place
        if has_area:
            found.append([left[corner - 1], left[corner], left[(corner + 1) % len(left)]])
        del left[corner]
        start = corner
    return np.array(found, np.int64).reshape(-1, 3)


def _corner_to_cut(points: np.ndarray, start: int) -> tuple[int, bool] | None:
    """Next corner of a polygon (n, 2) to cut off, and whether a triangle goes with it: one on a line, or an ear."""
    before, after = np.roll(points, 1, axis=0), np.roll(points, -1, axis=0)
    turn = _cross(points - before, after - points)
    on_line = np.flatnonzero(np.abs(turn) <= _TOLERANCE)
    if len(on_line):
        return int(on_line[0]), False
    for step in range(len(points)):
        corner = (start + step) % len(points)
        if turn[corner] > 0.0 and _is_ear(points, corner):
            return corner, True
    return None


def _is_ear(points: np.ndarray, corner: int) -> bool:
    """Whether the triangle at a convex corner holds no other part of the polygon."""
    a, b, c = points[corner - 1], points[corner], points[(corner + 1) % len(points)]
    if len(points) == 3:
        return True
    same = (points == a).all(axis=1) | (points == b).all(axis=1) | (points == c).all(axis=1)
    inside = np.ones(len(points), bool)
    for begin, end in ((a, b), (b, c), (c, a)):
        inside &= _cross(end - begin, points - begin) >= -_TOLERANCE
    if (inside & ~same).any():
        return False
    return not _properly_cross(a, c, points, np.roll(points, -1, axis=0)).any()


def _crosses_itself(points: np.ndarray) -> bool:
    """Whether two sides of a polygon (n, 2) cross; outlines that touch themselves, as around a hole, do not."""
    ends = np.roll(points, -1, axis=0)
    return any(_properly_cross(points[i], ends[i], points, ends).any() for i in range(len(points)))


def _properly_cross(a: np.ndarray, b: np.ndarray, begins: np.ndarray, ends: np.ndarray) -> np.ndarray:
    """Whether a line from a to b crosses each of others in the inside of both."""
    one, two = _cross(b - a, begins - a), _cross(b - a, ends - a)
    three, four = _cross(ends - begins, a - begins), _cross(ends - begins, b - begins)
    apart = (np.minimum(one, two) < -_TOLERANCE) & (np.maximum(one, two) > _TOLERANCE)
    return apart & (np.minimum(three, four) < -_TOLERANCE) & (np.maximum(three, four) > _TOLERANCE)
