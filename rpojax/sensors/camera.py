"""Camera parameters, and the record of one exposure, common to all camera models."""

import jax.numpy as jnp
from jaxtyping import Array, Bool

from rpojax.core import lens_distortion
from rpojax.core.declared_numbers import number
from rpojax.core.pytree import pytree, replace
from rpojax.value_types import Quaternion
from rpojax.vision import pinhole
from rpojax.vision.bounding_box import BoundingBox
from rpojax.vision.pinhole import Intrinsics

NEAREST_DEPTH = 0.1
"""Depth of the nearest vertex of a target in front of the camera [m]: projections are divided by it."""


@pytree
class Camera:
    """True parameters of the camera and of its bounding-box detector."""

    field_of_view: Array = number("horizontal field of view; pixels are square", unit="deg", above=0.0, below=180.0)
    mounting: Array = number("nominal `q_KB`; any length", form=Quaternion)
    misalignment: Array = number("small rotation of the camera about its own axes", unit="deg", length=3)
    edge_noise: Array = number("error of each box edge, 1 sigma", unit="px", at_least=0.0)
    miss_probability: Array = number(
        "fraction of frames of an observable target without box", at_least=0.0, at_most=1.0
    )
    minimum_size: Array = number("targets with a smaller longer side have no box", unit="px", at_least=0.0)
    outlier_probability: Array = number("fraction of frames with a false box, target or not", at_least=0.0, at_most=1.0)
    outlier_size_min: Array = number("smallest side of a false box, at most the next", unit="px", above=0.0)
    outlier_size_max: Array = number("largest side of a false box; sides are log-uniform", unit="px", above=0.0)
    phase_limit: Array = number(
        "largest Sun-target-camera angle of a usable image", unit="deg", above=0.0, at_most=180.0
    )
    sun_exclusion: Array = number("least angle between line of sight and Sun", unit="deg", at_least=0.0, below=180.0)
    distortion: Array | None = number(
        "k1, k2, p1, p2, k3 of the lens after Brown and Conrady as OpenCV has them; flight software knows the nominal "
        "ones. By default a pinhole",
        length=5,
        default=None,
    )

    def lens(self, width_px: int, height_px: int) -> Intrinsics:
        """Intrinsics of the true lens."""
        return pinhole.pinhole_intrinsics(self.field_of_view, width_px, height_px, self.distortion)


@pytree
class WideLens:
    """True parameters of a second, wider lens of the camera, before the same detector."""

    field_of_view: Array = number(
        "horizontal field of view, wider than that of the camera", unit="deg", above=0.0, below=180.0
    )
    misalignment: Array = number(
        "small rotation of the camera about its own axes by the change to this lens",
        unit="deg",
        length=3,
        default=[0.0, 0.0, 0.0],
    )
    edge_noise: Array | None = number(
        "error of each box edge through it, 1 sigma, by default that of the camera",
        unit="px",
        at_least=0.0,
        default=None,
    )
    distortion: Array | None = number(
        "of this lens, as `camera.distortion`; by default a pinhole",
        length=5,
        default=None,
    )


def through_wide(camera: Camera, lens: WideLens, is_wide: Bool[Array, ""]) -> Camera:
    """The camera as it is through the wide lens where `is_wide`, else through its own."""
    edge_noise = camera.edge_noise if lens.edge_noise is None else lens.edge_noise
    return replace(
        camera,
        field_of_view=jnp.where(is_wide, lens.field_of_view, camera.field_of_view),
        misalignment=jnp.where(is_wide, camera.misalignment + lens.misalignment, camera.misalignment),
        edge_noise=jnp.where(is_wide, edge_noise, camera.edge_noise),
        distortion=lens_distortion.of_lens_in_use(camera.distortion, lens.distortion, is_wide),
    )


@pytree
class CameraFrame:
    """Result of one exposure.

    Attributes:
        box: the box that the flight software gets
        observable: () bool, the light allows to see the target, whether or not the camera works
        score: () 0..1 of the detector's best box, accepted or not; 1 or 0 without a detector
        window: (3,) left, top and side [px] of the square that the detector got
        outlier: () bool, the box is false (not known to flight software)
        outline: (4,) true left, top, right, bottom of the target, cut to the frame [px] (not known to flight software)
        weight: () of the box where its score is not held against a threshold, but weighs it, in 0..1; else None
    """

    box: BoundingBox
    observable: Array
    score: Array
    window: Array
    outlier: Array
    outline: Array
    weight: Array | None = None
