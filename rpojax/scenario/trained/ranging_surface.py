"""Surface of the target that range finders and LiDARs meet: its mesh, simplified where it is large, or its hull."""

import functools
from collections.abc import Mapping
from typing import Any

import jax.numpy as jnp
import numpy as np

from rpojax.scenario.trained import coverage_surface
from rpojax.sensors.additional.surface_ranging import MATT_REFLECTIVITY, MOST_TRIANGLES, TargetSurface
from rpojax.vision.surface.surface_simplification import SimplifiedSurface, simplify


def surface_for_sensors(tables: Mapping[str, Any]) -> TargetSurface | None:
    """Nominal surface of the target, None if no sensor meets it.

    Raises:
        RpojaxError: the mesh file cannot be used.
    """
    if not coverage_surface.meets_surface(tables):
        return None
    triangles, reflectivity = coverage_surface.reflecting_triangles(tables)
    found = simplified(triangles)
    known = MATT_REFLECTIVITY if reflectivity is None else reflectivity[found.numbers]
    return TargetSurface(
        triangles=jnp.asarray(found.triangles),
        reflectivity=jnp.asarray(np.broadcast_to(known, len(found.triangles))),
        scale=jnp.ones(()),
    )


def simplified(triangles: np.ndarray) -> SimplifiedSurface:
    """The surface of triangles (n, 3, 3) [m] that is met in the loop, and its mean error."""
    return _simplified(np.ascontiguousarray(triangles, dtype=np.float64).tobytes())


@functools.lru_cache(maxsize=4)
def _simplified(content: bytes) -> SimplifiedSurface:
    return simplify(np.frombuffer(content).reshape(-1, 3, 3), MOST_TRIANGLES)
