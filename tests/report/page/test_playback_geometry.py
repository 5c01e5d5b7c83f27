"""Geometry of playback: the focal length of the lens that a frame was taken through, and zones of phases."""

import math

import numpy as np

from rpojax.report.page import playback_geometry
from rpojax.scenario.loading import scenario_loader


def test_frames_of_two_lenses_have_the_focal_length_of_theirs() -> None:
    tables = {"camera": {"width_px": 768, "field_of_view_deg": 20.0}, "wide_lens": {"field_of_view_deg": 45.0}}
    found = playback_geometry.focal_lengths(tables, np.array([0, 1, 1, 0]))
    far, near = (384.0 / math.tan(math.radians(half)) for half in (10.0, 22.5))
    np.testing.assert_allclose(found, [far, near, near, far], rtol=1e-14)


def test_corridors_turn_in_phases_of_the_target_frame_and_built_in_phases_have_none() -> None:
    tables = scenario_loader.load("capture").model_dump()
    found = playback_geometry.zones(tables)
    assert len(found) == len(tables["phases"]) + 1
    turning = [each["corridor"]["turns"] if each["corridor"] else None for each in found]
    assert turning == [None, None, None, True, True, None]
    assert found[-1] == {"keep_out": [1.3, 1.3, 1.3], "corridor": None}
    straight = playback_geometry.zones(scenario_loader.load("vbar_approach").model_dump())
    assert {each["corridor"]["turns"] for each in straight if each["corridor"]} == {False}
