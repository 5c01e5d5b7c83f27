"""Speed of rendering and detection."""

from dataclasses import asdict

import jax
import pytest

from rpojax.benchmark import vision_speed


@pytest.mark.slow
def test_images_and_detections_are_counted_over_all_devices() -> None:
    found = vision_speed.measure(size=2)
    assert (found.batch, found.side_px) == (2 * len(jax.devices()), 128)
    assert found.frames_per_s == pytest.approx(found.batch / found.render_s)
    assert found.detections_per_s == pytest.approx(found.batch / found.detect_s)
    assert all(value > 0.0 for value in asdict(found).values())
