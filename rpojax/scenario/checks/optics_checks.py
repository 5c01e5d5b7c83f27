"""Checks of the optics of the camera: a lens that shows each direction once, and an exposure within a frame."""

import math

import jax.numpy as jnp

from rpojax.core import lens_distortion
from rpojax.errors import ScenarioError
from rpojax.scenario.schema import ScenarioFile


def check_optics(file: ScenarioFile) -> None:
    """Checks distortion and time of exposure.

    Raises:
        ScenarioError: the image of a lens folds within the frame, or an exposure lasts longer than a frame.
    """
    camera, wide = file.camera, file.wide_lens
    _check_lens(file, "camera.distortion", camera.distortion, camera.field_of_view_deg)
    if wide is not None:
        _check_lens(file, "wide_lens.distortion", wide.distortion, wide.field_of_view_deg)
    exposure_s, most = file.imaging.exposure_time_s, 1.0 / file.rates.camera_hz
    if exposure_s is not None and exposure_s > most:
        raise ScenarioError("imaging.exposure_time_s", exposure_s, f"at most the time of a frame, {most:g} s")


def _check_lens(file: ScenarioFile, key: str, coefficients: list[float] | None, field_of_view_deg: float) -> None:
    if coefficients is None:
        return
    across = math.tan(math.radians(0.5 * field_of_view_deg))
    corner = across * math.hypot(1.0, file.camera.height_px / file.camera.width_px)
    largest = float(lens_distortion.largest_shown_radius(jnp.asarray(coefficients)))
    if corner > largest:
        expected = f"a lens whose image does not fold before the corner, {math.degrees(math.atan(corner)):.3g} deg out"
        raise ScenarioError(key, coefficients, expected)
