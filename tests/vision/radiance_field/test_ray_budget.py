"""Number of rays by range."""

from rpojax.vision.radiance_field.ray_budget import REGION_SIDES, region_side


def test_region_side_follows_minimum_range() -> None:
    assert region_side(732.0, 0.9, 30.0, 1.5) == 96
    assert region_side(732.0, 0.9, 100.0, 1.5) == 32
    assert region_side(732.0, 0.9, 0.5, 1.5) == REGION_SIDES[-1]
