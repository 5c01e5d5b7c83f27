"""The picture that a camera takes: the target before stars and Earth, through the optics and the detector."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from rpojax.core.pytree import pytree
from rpojax.vision.imaging.exposure import Exposure, expose
from rpojax.vision.imaging.stars_and_earth import Sky, background
from rpojax.vision.pinhole import Intrinsics
from rpojax.vision.radiance_field.ray_budget import RaySampling
from rpojax.vision.radiance_field.render_image import alpha_composite, linear_to_srgb, render_target
from rpojax.vision.radiance_field.target_field import RadianceField

Image = Float[Array, "h w 3"]


@pytree
class Scene:
    """Where everything is at the time of an exposure, float32.

    Attributes:
        r_KT_T: (3,) camera from the target, in target axes [m]
        R_KT: (3, 3) target axes to camera axes
        sun_T: (3,) unit vector to the Sun, in target axes
        sunlight: () share of the Sun's disc that the Earth leaves free at the target
        R_KN: (3, 3) inertial axes to camera axes
        place_N: (3,) camera from the Earth's centre [Earth radii]
        sun_N: (3,) unit vector to the Sun
        earth_turn: () angle of Greenwich from the x axis of N [rad]
    """

    r_KT_T: Array
    R_KT: Array
    sun_T: Array
    sunlight: Array
    R_KN: Array
    position_N: Array
    sun_N: Array
    earth_rotation: Array


@pytree
class ImageWindow:
    """The part of a frame that is looked at, as a lens of its own.

    Attributes:
        lens: pinhole of the window's pixels
        corner_px: (2,) of the window, in pixels of the frame
        binning: () pixels of the frame along a side of one of the window's
    """

    intrinsics: Intrinsics
    corner_px: Array
    binning: Array


def image_window(intrinsics: Intrinsics, corner_px: Float[Array, "2"], binning: Float[Array, ""]) -> ImageWindow:
    """Window whose corner is at a pixel of the frame and whose pixels are `binning` times as large."""
    window_intrinsics = Intrinsics(
        focal_px=intrinsics.focal_px / binning, center_px=(intrinsics.center_px - corner_px) / binning
    )
    return ImageWindow(intrinsics=window_intrinsics, corner_px=corner_px, binning=binning)


def form_image(
    field: RadianceField,
    sky: Sky,
    exposure: Exposure,
    sampling: RaySampling,
    window: ImageWindow,
    size_px: int,
    scene: Scene,
    noise: Image,
) -> Image:
    """sRGB codes (size_px, size_px, 3) in 0..1 of a window; `noise` are standard normal numbers."""
    frame = render_target(
        field, window.intrinsics, size_px, size_px, sampling, scene.r_KT_T, scene.R_KT, scene.sun_T, scene.sunlight
    )
    binning = window.binning.astype(jnp.float32)
    behind = background(
        sky,
        window.intrinsics,
        size_px,
        size_px,
        scene.R_KN,
        scene.position_N,
        scene.sun_N,
        scene.earth_rotation,
        binning,
    )
    seen = expose(alpha_composite(frame, behind), exposure, noise, binning)
    return linear_to_srgb(seen)
