"""Geometry of playback: the focal length of the lens that a frame was taken through."""

import math

import numpy as np

from rpojax.report.page import playback_geometry


def test_frames_of_two_lenses_have_the_focal_length_of_theirs() -> None:
    tables = {"camera": {"width_px": 768, "field_of_view_deg": 20.0}, "wide_lens": {"field_of_view_deg": 45.0}}
    found = playback_geometry.focal_lengths(tables, np.array([0, 1, 1, 0]))
    far, near = (384.0 / math.tan(math.radians(half)) for half in (10.0, 22.5))
    np.testing.assert_allclose(found, [far, near, near, far], rtol=1e-14)
