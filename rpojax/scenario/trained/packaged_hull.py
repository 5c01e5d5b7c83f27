"""Hull of the packaged target, of which are the packaged radiance field, camera statistics and mesh."""

import functools
import tomllib
from importlib import resources
from typing import Any

import numpy as np

_LIKE_SHARE = 0.05
"""Largest difference of the hulls' ends along an axis over the longest side, with which pictures are still of use."""


@functools.cache
def packaged_hull() -> np.ndarray:
    """(points, 3) hull of the packaged target in T [m]."""
    text = (resources.files("rpojax.scenario") / "packaged" / "inspection.toml").read_text()
    return np.array(tomllib.loads(text)["target"]["hull_m"])


def is_packaged(hull_m: Any) -> bool:
    """Whether a hull (points, 3) is that of the packaged target, in any order of its points."""
    found = {tuple(map(float, point)) for point in hull_m}
    return found == {tuple(map(float, point)) for point in packaged_hull()}


def is_like_packaged(hull_m: Any) -> bool:
    """Whether a hull (points, 3) ends within a twentieth of the longest side from the packaged one, along each axis."""
    known, found = packaged_hull(), np.array(hull_m)
    room = _LIKE_SHARE * float(np.ptp(known, axis=0).max())
    low, high = found.min(axis=0) - known.min(axis=0), found.max(axis=0) - known.max(axis=0)
    return bool(max(np.abs(low).max(), np.abs(high).max()) <= room)
