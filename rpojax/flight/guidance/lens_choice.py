"""Choice between the two lenses of a camera by the estimated range: the wide one near the target."""

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from rpojax.core.declared_numbers import number
from rpojax.core.pytree import pytree, replace

Scalar = Float[Array, ""]


@pytree
class BelievedWideLens:
    """The wide lens as flight software knows it, and the ranges at which it changes lenses.

    Attributes:
        focal_px: () nominal focal length [px]
        distortion: (5,) nominal, None for a pinhole
    """

    focal_px: Array
    switch_range: Array = number(
        "estimated range below which the camera looks through the wide lens",
        key="wide_lens.switch_range_m",
        above=0.0,
    )
    return_range: Array = number(
        "estimated range from which on it looks through its own lens again, above the other",
        key="wide_lens.return_range_m",
        above=0.0,
    )
    edge_noise: Array | None = number(
        "what the filter believes of the error of an edge through it, by default `navigation.edge_noise_px`",
        key="wide_lens.believed_edge_noise_px",
        above=0.0,
        default=None,
    )
    misalignment_sigma: Array = number(
        "what the filter believes of its rotation from the other lens across the boresight, 1 sigma per axis",
        key="wide_lens.believed_misalignment_deg",
        at_least=0.0,
        default=0.0,
    )
    distortion: Array | None = None


@pytree
class LensInUse:
    """The lens through which the camera looks.

    Attributes:
        is_wide: () bool, the wide one
        was_wide: () bool, that of the latest frame that flight software has
    """

    is_wide: Array
    was_wide: Array


def first_lens(lens: BelievedWideLens, distance: Scalar) -> LensInUse:
    """Lens at the start, at an estimated range [m]."""
    is_wide = distance < lens.switch_range
    return LensInUse(is_wide=is_wide, was_wide=is_wide)


def next_lens(lens: BelievedWideLens, before: LensInUse, distance: Scalar) -> LensInUse:
    """Lens of the next exposure at an estimated range [m]: it changes at different ranges on the way in and out."""
    is_wide: Bool[Array, ""] = distance < jnp.where(before.is_wide, lens.return_range, lens.switch_range)
    return replace(before, is_wide=is_wide)


def of_frame(in_use: LensInUse | None, is_wide: Bool[Array, ""] | None) -> LensInUse | None:
    """Lens of the frame that flight software gets, which is not the one in use where frames are late."""
    return in_use if in_use is None or is_wide is None else replace(in_use, is_wide=is_wide)


def after_frame(in_use: LensInUse | None, frame: LensInUse | None) -> LensInUse | None:
    """Lens in use, with that of the latest frame."""
    return in_use if in_use is None or frame is None else replace(in_use, was_wide=frame.is_wide)


def misalignment_variance(lens: BelievedWideLens, frame: LensInUse) -> Scalar:
    """Variance [rad^2] of the camera's direction that a change of lenses adds in this frame."""
    return jnp.where(frame.is_wide != frame.was_wide, lens.misalignment_sigma**2, 0.0)
