"""The picture that a camera takes: the target before stars and Earth, through the optics and the detector."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from rpojax.core.pytree import pytree
from rpojax.vision.imaging.exposure import Exposure, expose
from rpojax.vision.imaging.stars_and_earth import Sky, background
from rpojax.vision.pinhole import Lens
from rpojax.vision.radiance_field.ray_budget import Sampling
from rpojax.vision.radiance_field.render_image import compose, encode, render_frame
from rpojax.vision.radiance_field.target_field import Field

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
    place_N: Array
    sun_N: Array
    earth_turn: Array


@pytree
class Window:
    """The part of a frame that is looked at, as a lens of its own.

    Attributes:
        lens: pinhole of the window's pixels
        corner_px: (2,) of the window, in pixels of the frame
        binning: () pixels of the frame along a side of one of the window's
    """

    lens: Lens
    corner_px: Array
    binning: Array


def window(lens: Lens, corner_px: Float[Array, "2"], binning: Float[Array, ""]) -> Window:
    """Window whose corner is at a pixel of the frame and whose pixels are `binning` times as large."""
    own = Lens(focal_px=lens.focal_px / binning, center_px=(lens.center_px - corner_px) / binning)
    return Window(lens=own, corner_px=corner_px, binning=binning)


def take_picture(
    field: Field, sky: Sky, exposure: Exposure, rays: Sampling, view: Window, size_px: int, scene: Scene, noise: Image
) -> Image:
    """sRGB codes (size_px, size_px, 3) in 0..1 of a window; `noise` are standard normal numbers."""
    frame = render_frame(
        field, view.lens, size_px, size_px, rays, scene.r_KT_T, scene.R_KT, scene.sun_T, scene.sunlight
    )
    binning = view.binning.astype(jnp.float32)
    behind = background(
        sky, view.lens, size_px, size_px, scene.R_KN, scene.place_N, scene.sun_N, scene.earth_turn, binning
    )
    seen = expose(compose(frame, behind), exposure, noise, binning)
    return encode(seen)
