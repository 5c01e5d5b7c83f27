"""The benchmark and its page agree."""

from dataclasses import fields
from pathlib import Path

import pytest

from rpojax.benchmark.closed_loop_speed import ClosedLoopSpeed
from rpojax.benchmark.filter_speed import FilterSpeed
from rpojax.benchmark.orbit_speed import OrbitSpeed
from rpojax.benchmark.vision_speed import VisionSpeed


@pytest.mark.parametrize("record", [ClosedLoopSpeed, OrbitSpeed, FilterSpeed, VisionSpeed])
def test_performance_page_explains_every_key(record: type) -> None:
    page = (Path(__file__).parents[2] / "docs" / "about" / "performance.md").read_text(encoding="utf-8")
    assert {field.name for field in fields(record) if f"`{field.name}`" not in page} == set()
