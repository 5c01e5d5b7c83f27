"""Landmarks of the target before the camera: where they are in the picture, which are in sight, and which are lit."""

from dataclasses import dataclass

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from rpojax.core import lens_distortion
from rpojax.core.pytree import pytree
from rpojax.vision.surface.landmarks import Landmarks, are_free

Vector = Float[Array, "3"]
Scalar = Float[Array, ""]

_NEAREST = 0.05
"""Depth from which on a landmark can be seen [m]."""


@dataclass(frozen=True)
class SeenLandmarks:
    """What there is to be seen of landmarks, without the errors of who finds them.

    Attributes:
        tangents: (n, 2) right and down of the boresight
        visible: (n,) bool, before the camera and not behind the target
        lit: (n,) bool
        middle: (2,) tangents of the target's origin
        half_size: () tangent of the distance of the furthest landmark from it
    """

    tangents: Array
    visible: Array
    lit: Array
    middle: Array
    half_size: Array


@pytree
class FoundInPicture:
    """Landmarks that a network found.

    Attributes:
        tangents: (n, 2) right and down of the boresight
        sigma: (n,) of a tangent, by the network
        present: (n,) bool
    """

    tangents: Array
    sigma: Array
    present: Array


@dataclass(frozen=True)
class LandmarkScene:
    """True pose of the target in the camera, its light, and its landmarks.

    Attributes:
        landmarks: of the target
        scale: () true size over that of the landmarks
        R_KT: (3, 3) attitude of the target in camera axes
        r_TK_K: (3,) its centre of mass from the camera [m]
        sun_T: (3,) unit vector to the Sun
        focal_px: () true focal length
        nominal_focal_px: () that of flight software, by which it gets tangents from places in the picture
        half_frame_tangent: (2,) half of the frame by the nominal focal length
        distortion: (5,) of the true lens, None for a pinhole
        nominal_distortion: (5,) by which flight software corrects places in the picture, None for a pinhole
        observable: () bool, there is light to see the target by
        by_lamp_alone: () bool, that of the lamp
        working: () bool, the camera works
        found: what a network finds in the rendered picture, None without one
    """

    landmarks: Landmarks
    scale: Array
    R_KT: Array
    r_TK_K: Array
    sun_T: Array
    focal_px: Array
    nominal_focal_px: Array
    half_frame_tangent: Array
    observable: Array
    by_lamp_alone: Array
    working: Array
    distortion: Array | None = None
    nominal_distortion: Array | None = None
    found: FoundInPicture | None = None

    def seen(self, body_offset: Vector) -> SeenLandmarks:
        """Landmarks that are `body_offset` [m] from where the file has them about the centre of mass."""
        places_T = self.scale * self.landmarks.positions + body_offset[None, :]
        camera_T = -jnp.sum(self.R_KT * self.r_TK_K[:, None], axis=0)
        places_K = self._in_camera(places_T)
        ratio = self.focal_px / self.nominal_focal_px
        middle_depth = jnp.maximum(self.r_TK_K[2], _NEAREST)
        to_sun = jnp.broadcast_to(self.sun_T, places_T.shape)
        sunlit = are_free(self.landmarks.visible, to_sun) & (jnp.sum(self.landmarks.normals * to_sun, axis=1) > 0.0)
        visible = are_free(self.landmarks.visible, camera_T[None, :] - places_T) & (places_K[:, 2] > _NEAREST)
        size = jnp.sqrt(jnp.max(jnp.sum(places_T * places_T, axis=1), axis=0))
        return SeenLandmarks(
            tangents=self._projected(places_K),
            visible=visible,
            lit=jnp.where(self.by_lamp_alone, visible, sunlit),
            middle=ratio * self.r_TK_K[:2] / middle_depth,
            half_size=ratio * size / middle_depth,
        )

    def tangents(self, places_T: Float[Array, "n 3"]) -> Float[Array, "n 2"]:
        """Tangents right and down of the boresight of places of the target, from its centre of mass in T [m]."""
        return self._projected(self._in_camera(places_T))

    def _in_camera(self, places_T: Float[Array, "n 3"]) -> Float[Array, "n 3"]:
        return jnp.sum(self.R_KT[None] * places_T[:, None, :], axis=2) + self.r_TK_K[None, :]

    def _projected(self, places_K: Float[Array, "n 3"]) -> Float[Array, "n 2"]:
        ratio = self.focal_px / self.nominal_focal_px
        if self.distortion is None:
            return ratio * places_K[:, :2] / jnp.maximum(places_K[:, 2], _NEAREST)[:, None]
        depth = jnp.maximum(places_K[:, 2], _NEAREST)
        x, y = lens_distortion.distort(self.distortion, places_K[:, 0] / depth, places_K[:, 1] / depth)
        return jnp.stack(lens_distortion.undistort(self.nominal_distortion, ratio * x, ratio * y), axis=1)

    def order(self, swapped: Bool[Array, ""], which: Scalar) -> Array:
        """Landmark that each is taken for (n,): itself, or if `swapped` one by the symmetry `which`, from 0 to 1."""
        permutations = self.landmarks.permutations
        others = permutations.shape[0] - 1
        number = jnp.clip(1 + (which * others).astype(jnp.int32), 0, others)
        return permutations[jnp.where(swapped, number, 0)]
