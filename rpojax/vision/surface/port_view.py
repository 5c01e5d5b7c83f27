"""A docking port of a target, and the last view of it along its axis."""

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from rpojax.vision.surface.landmarks import LandmarkError, are_free, free_rays
from rpojax.vision.surface.surface_symmetries import SampledSurface

_TOLERANCE: Final = 0.02
"""Distance of a port from the surface, as a share of the body's size."""


@dataclass(frozen=True)
class PortView:
    """A docking port, and the last view of it: landmarks on its face are those that are seen there.

    Attributes:
        position: (3,) middle of the port, on the surface, in T [m]
        axis: (3,) direction out of it, of any length
        range_m: distance of the camera from T, on the port's axis
        field_of_view: of the lens [rad]; what is within half of it from the axis is seen, however the camera rolls
        fewest: landmarks that have to be on the face
    """

    position: np.ndarray
    axis: np.ndarray
    range_m: float = 1.5
    field_of_view: float = math.radians(45.0)
    fewest: int = 8

    @property
    def unit_axis(self) -> np.ndarray:
        """Unit vector (3,) out of the port."""
        return self.axis / np.linalg.norm(self.axis)

    def camera(self) -> np.ndarray:
        """Place (3,) of the camera on the port's axis [m].

        Raises:
            LandmarkError: the port is as far from the target's origin.
        """
        along = float(self.position @ self.unit_axis)
        reach = self.range_m**2 - float(self.position @ self.position) + along * along
        if reach <= 0.0 or math.sqrt(reach) <= along:
            distance = float(np.linalg.norm(self.position))
            raise LandmarkError.of_argument(
                "port_range", f"found {self.range_m:g} m, expected more than {distance:.3g}"
            )
        return self.position + (math.sqrt(reach) - along) * self.unit_axis

    def check(self, triangles: np.ndarray, surface: SampledSurface) -> None:
        """Raises `LandmarkError` if the port is not on the surface, or its axis meets the body."""
        if not (np.isfinite(self.axis).all() and np.isfinite(self.position).all() and np.any(self.axis)):
            raise LandmarkError.of_argument("port_position, port_axis", "found no numbers of a place and a direction")
        distance, most = float(surface.distances(self.position[None])[0]), _TOLERANCE * surface.size
        if distance > most:
            found = f"found a place {distance:.3g} m from the surface"
            raise LandmarkError.of_argument("port_position", f"{found}, expected one on it, within {most:.2g} m")
        # From the height of the tolerance, since the port may be as much below the surface.
        start = self.position + most * self.unit_axis
        if not free_rays(start[None], self.unit_axis[None], triangles, self.unit_axis[None])[0, 0]:
            raise LandmarkError.of_argument("port_axis", "found an axis that meets the body, expected one out of it")
        self.camera()

    def on_face(self, positions: np.ndarray, normals: np.ndarray, table: np.ndarray) -> np.ndarray:
        """Whether each place (n, 3) with a normal (n, 3) and a column of a visibility table is on the port's face (n,).

        The normal has to be towards the camera: corners that are only grazed are left out.
        """
        lines = self.camera() - positions
        near_axis = lines @ self.unit_axis > math.cos(0.5 * self.field_of_view) * np.linalg.norm(lines, axis=1)
        return near_axis & (np.sum(lines * normals, axis=1) > 0.0) & np.asarray(are_free(table, lines))
