"""Which facets of the target are lit, and which the camera sees, at one instant of a run."""

from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool

from rpojax.core import quaternion
from rpojax.core.numerics import gradient_safe
from rpojax.core.orbits import eclipse, sun_moon_ephemeris
from rpojax.core.pytree import pytree
from rpojax.scenario.params import Params
from rpojax.scenario.sections import CoverageSection
from rpojax.scenario.static_settings import Scenario
from rpojax.sensors import camera_pose
from rpojax.vision.surface import octahedral_map
from rpojax.vision.surface.visibility_table import CELLS


@pytree
class Surface:
    """Facets of the nominal target in T, in single precision.

    Attributes:
        centers: (facets, 3) from the centre of mass [m]
        normals: (facets, 3) unit vectors outwards
        visible: (cells, facets) bool, past the surface from the directions of each cell of the octahedral map
    """

    centers: Array
    normals: Array
    visible: Array


@pytree
class Instant:
    """Recorded channels of a run at one instant; of several runs and instants with these as leading axes.

    Attributes:
        time: () since the start [s]
        r_TN_N: (3,) target [m]
        r_ST_N: (3,) servicer from target [m]
        q_TN: (4,) attitude of the target
        q_BN: (4,) attitude of the servicer
        accepted: () bool, whether the orbit filter accepted a box of the frame
        running: () bool, whether the run has not failed
    """

    time: Array
    r_TN_N: Array
    r_ST_N: Array
    q_TN: Array
    q_BN: Array
    accepted: Array
    running: Array


@pytree
class View:
    """Geometry of an instant, in single precision.

    Attributes:
        in_sunlight: () bool, whether the target is outside of the Earth's shadow and the run has not failed
        accepted: () bool, whether the orbit filter accepted a box of the frame
        sun_T: (3,) unit vector to the Sun
        r_ST_T: (3,) servicer from target [m]
        R_KT: (3, 3) rotation from T to the camera
    """

    in_sunlight: Array
    accepted: Array
    sun_T: Array
    r_ST_T: Array
    R_KT: Array


@dataclass(frozen=True)
class Inspection:
    """What counts as lit and as seen.

    Attributes:
        scenario: static settings
        limits: of incidence and resolution
    """

    scenario: Scenario
    limits: CoverageSection

    def view(self, params: Params, instant: Instant) -> View:
        """Geometry of an instant."""
        r_TN_N = instant.r_TN_N.astype(jnp.float64)
        r_sun_N = sun_moon_ephemeris.sun_position(instant.time, params.epoch)
        q_TN, r_ST_N, q_BN = (each.astype(jnp.float64) for each in (instant.q_TN, instant.r_ST_N, instant.q_BN))
        q_TN = quaternion.normalize(q_TN)
        R_KT, _ = camera_pose.target_pose_in_camera(params.camera, q_TN, r_ST_N, q_BN)
        return View(
            in_sunlight=eclipse.is_lit(r_TN_N, r_sun_N) & instant.running,
            accepted=instant.accepted,
            sun_T=quaternion.rotate(q_TN, gradient_safe.normalize(r_sun_N - r_TN_N)).astype(jnp.float32),
            r_ST_T=quaternion.rotate(q_TN, r_ST_N).astype(jnp.float32),
            R_KT=R_KT.astype(jnp.float32),
        )

    def lit_and_seen(
        self, params: Params, surface: Surface, view: View
    ) -> tuple[Bool[Array, " facets"], Bool[Array, " facets"]]:
        """Whether each facet is lit, past the Earth and the body itself, and whether the camera sees it too."""
        sun_T, (normal_x, normal_y, normal_z) = view.sun_T, surface.normals.T
        cell = octahedral_map.cell_of_direction(sun_T[0], sun_T[1], sun_T[2], CELLS)
        cos_sun = normal_x * sun_T[0] + normal_y * sun_T[1] + normal_z * sun_T[2]
        lit = view.in_sunlight & surface.visible[cell] & (cos_sun > _cosine(self.limits.sun_incidence_limit_deg))
        scale = params.plant.target.scale.astype(jnp.float32)
        x, y, z = (view.r_ST_T[axis] - scale * surface.centers[:, axis] for axis in range(3))
        distance = jnp.sqrt(x * x + y * y + z * z)
        is_facing = normal_x * x + normal_y * y + normal_z * z > _cosine(self.limits.incidence_limit_deg) * distance
        cells = octahedral_map.cell_of_direction(x, y, z, CELLS)
        is_free = surface.visible[cells, jnp.arange(cells.shape[0])]
        return lit, lit & view.accepted & is_facing & is_free & self._is_imaged(params, view, (x, y, z))

    def _is_imaged(self, params: Params, view: View, ray_T: tuple[Array, Array, Array]) -> Bool[Array, " facets"]:
        """Whether facets are inside of the frame, and pixels small enough there; `ray_T` leads to the servicer."""
        right, down, depth = (-(row[0] * ray_T[0] + row[1] * ray_T[1] + row[2] * ray_T[2]) for row in view.R_KT)
        lens = params.camera.lens(self.scenario.width_px, self.scenario.height_px)
        focal, half_frame = lens.focal_px.astype(jnp.float32), (lens.center_px / lens.focal_px).astype(jnp.float32)
        in_frame = (jnp.abs(right) < half_frame[0] * depth) & (jnp.abs(down) < half_frame[1] * depth)
        return in_frame & (depth <= np.float32(self.limits.resolution_limit_m_px) * focal)


def _cosine(angle_deg: float) -> np.float32:
    return np.float32(np.cos(np.radians(angle_deg)))
