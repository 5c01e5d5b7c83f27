"""Which facets of the target are lit, and which the camera sees, at one instant of a run."""

from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from rpojax.core import quaternion
from rpojax.core.orbits import eclipse, sun_moon_ephemeris
from rpojax.core.pytree import pytree
from rpojax.scenario.params import Params
from rpojax.scenario.sections import CoverageSection
from rpojax.scenario.static_settings import Scenario
from rpojax.sensors import camera_pose
from rpojax.vision import pinhole
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


@dataclass(frozen=True)
class Inspection:
    """What counts as lit and as seen.

    Attributes:
        scenario: static settings
        limits: of incidence and resolution
    """

    scenario: Scenario
    limits: CoverageSection

    def lit_and_seen(
        self, params: Params, surface: Surface, instant: Instant
    ) -> tuple[Bool[Array, "facets"], Bool[Array, "facets"]]:  # noqa: F821
        """Whether each facet is lit, past the Earth and the body itself, and whether the camera sees it too."""
        q_TN = quaternion.normalize(instant.q_TN)
        lit = self._lit(surface, instant, q_TN)
        centers = surface.centers * params.plant.target.scale.astype(jnp.float32)
        ray_T = quaternion.rotate(q_TN, instant.r_ST_N)[None, :] - centers
        distance = jnp.sqrt(jnp.sum(ray_T * ray_T, axis=1))
        is_facing = jnp.sum(surface.normals * ray_T, axis=1) > _cosine(self.limits.incidence_limit_deg) * distance
        cell = octahedral_map.cell_of_direction(ray_T[:, 0], ray_T[:, 1], ray_T[:, 2], CELLS)
        is_free = surface.visible[cell, jnp.arange(cell.shape[0])]
        return lit, lit & instant.accepted & is_facing & is_free & self._is_imaged(params, instant, q_TN, ray_T)

    def _lit(self, surface: Surface, instant: Instant, q_TN: Float[Array, "4"]) -> Array:
        r_TN_N = instant.r_TN_N.astype(jnp.float64)
        r_sun_N = sun_moon_ephemeris.sun_position(instant.time, self.scenario.epoch_s)
        to_sun_N = r_sun_N - r_TN_N
        sun_N = (to_sun_N / jnp.sqrt(jnp.sum(to_sun_N * to_sun_N))).astype(jnp.float32)
        sun_T = quaternion.rotate(q_TN, sun_N)
        cell = octahedral_map.cell_of_direction(sun_T[0], sun_T[1], sun_T[2], CELLS)
        is_facing = jnp.sum(surface.normals * sun_T[None, :], axis=1) > _cosine(self.limits.sun_incidence_limit_deg)
        return is_facing & surface.visible[cell] & eclipse.is_lit(r_TN_N, r_sun_N) & instant.running

    def _is_imaged(self, params: Params, instant: Instant, q_TN: Float[Array, "4"], ray_T: Array) -> Array:
        """Whether facets are inside of the frame, and pixels small enough there; `ray_T` leads to the servicer."""
        R_KT, _ = camera_pose.target_pose_in_camera(
            params.camera, *(each.astype(jnp.float64) for each in (q_TN, instant.r_ST_N, instant.q_BN))
        )
        R_KT = R_KT.astype(jnp.float32)
        x, y, depth = (-jnp.sum(R_KT[axis][None, :] * ray_T, axis=1) for axis in range(3))
        lens = pinhole.pinhole_intrinsics(params.camera.field_of_view, self.scenario.width_px, self.scenario.height_px)
        focal, half_frame = lens.focal_px.astype(jnp.float32), (lens.center_px / lens.focal_px).astype(jnp.float32)
        in_frame = (jnp.abs(x) < half_frame[0] * depth) & (jnp.abs(y) < half_frame[1] * depth)
        return in_frame & (depth <= np.float32(self.limits.resolution_limit_m_px) * focal)


def _cosine(angle_deg: float) -> np.float32:
    return np.float32(np.cos(np.radians(angle_deg)))
