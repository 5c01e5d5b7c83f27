"""Image formation: the target over stars and Earth, blurred, exposed and encoded as sRGB."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from rpojax.core.pytree import pytree
from rpojax.vision.imaging.earth_shine import earth_shine
from rpojax.vision.imaging.exposure import Exposure, expose
from rpojax.vision.imaging.random_sky import Sky
from rpojax.vision.imaging.sky_background import background
from rpojax.vision.imaging.srgb import linear_to_srgb
from rpojax.vision.pinhole import Intrinsics
from rpojax.vision.radiance_field.ray_budget import RaySampling
from rpojax.vision.radiance_field.render_image import Light, alpha_composite, render_target
from rpojax.vision.radiance_field.target_field import RadianceField

Image = Float[Array, "h w 3"]


@pytree
class Scene:
    """Geometry of target, camera, Sun and Earth at the time of an exposure, float32.

    Attributes:
        r_KT_T: (3,) camera from the target, in target axes, for a target of the radiance field's size [m]
        R_KT: (3, 3) target axes to camera axes
        sun_T: (3,) unit vector to the Sun, in target axes
        sunlight: () fraction of the Sun's disc in view at the target
        R_KN: (3, 3) inertial axes to camera axes
        position_N: (3,) camera from the Earth's centre [Earth radii]
        sun_N: (3,) unit vector to the Sun
        earth_rotation: () angle of Greenwich from the x axis of N [rad]
        smear: (2,) way of the target right and down during the exposure, as tangents; None for a picture at rest
    """

    r_KT_T: Array
    R_KT: Array
    sun_T: Array
    sunlight: Array
    R_KN: Array
    position_N: Array
    sun_N: Array
    earth_rotation: Array
    smear: Array | None = None


@pytree
class ImageWindow:
    """Part of a frame that is read out, as a pinhole camera of its own.

    Attributes:
        intrinsics: of the window's pixels
        corner_px: (2,) of the window, in pixels of the frame
        binning: () pixels of the frame along a side of one of the window's
    """

    intrinsics: Intrinsics
    corner_px: Array
    binning: Array


def image_window(intrinsics: Intrinsics, corner_px: Float[Array, "2"], binning: Float[Array, ""]) -> ImageWindow:
    """Window whose corner is at a pixel of the frame and whose pixels are `binning` times as large."""
    window_intrinsics = Intrinsics(
        focal_px=intrinsics.focal_px / binning,
        center_px=(intrinsics.center_px - corner_px) / binning,
        distortion=intrinsics.distortion,
    )
    return ImageWindow(intrinsics=window_intrinsics, corner_px=corner_px, binning=binning)


def light_on_target(scene: Scene, fill_light: Float[Array, ""]) -> Light:
    """Light of the Sun, and of the Earth as fill light from its centre.

    To the light of the sunlit ground `fill_light` is added while the Sun is in view, by the Sun's irradiance.
    """
    nadir_N = -scene.position_N * jax.lax.rsqrt(jnp.sum(scene.position_N**2))
    nadir_K = jnp.sum(scene.R_KN * nadir_N[None, :], axis=1)
    return Light(
        sun_T=scene.sun_T,
        sunlight=scene.sunlight,
        fill_T=jnp.sum(scene.R_KT * nadir_K[:, None], axis=0),
        fill=earth_shine(scene.position_N, scene.sun_N) + fill_light * scene.sunlight,
    )


def form_image(
    field: RadianceField,
    sky: Sky,
    exposure: Exposure,
    sampling: RaySampling,
    window: ImageWindow,
    size_px: int,
    scene: Scene,
    noise: Image,
    fill_light: Float[Array, ""],
) -> Image:
    """sRGB codes (size_px, size_px, 3) in 0..1 of a window; `noise` are standard normal numbers.

    `fill_light` is that beside the sunlit ground's, by the Sun's (see `light_on_target`).
    """
    target = render_target(
        field,
        window.intrinsics,
        size_px,
        size_px,
        sampling,
        scene.r_KT_T,
        scene.R_KT,
        light_on_target(scene, fill_light),
    )
    binning = window.binning.astype(jnp.float32)
    sky_image = background(
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
    smear_px = None if scene.smear is None else window.intrinsics.focal_px.astype(jnp.float32) * scene.smear
    exposed = expose(alpha_composite(target, sky_image), exposure, noise, binning, smear_px)
    return linear_to_srgb(exposed)
