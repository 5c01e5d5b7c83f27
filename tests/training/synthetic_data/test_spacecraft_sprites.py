"""Ray-traced sprites."""

from pathlib import Path

import numpy as np
import pytest

from rpojax.training.synthetic_data import (
    ray_traced_views,
    spacecraft_sprites,
)


def test_sprites_are_stored_and_inside_silhouettes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("mitsuba")
    pytest.importorskip("mitsuba")
    first = spacecraft_sprites.trace_sprites(tmp_path, 1, 2, 0, held_out=False)
    assert len(first) == 3
    assert sum(sprite.craft == "target" for sprite in first) == 1
    for sprite in first:
        assert sprite.alpha.max() == 1.0
        assert sprite.sunlit[sprite.alpha == 0.0].max(initial=0.0) == 0.0
        # Uniform light leaves only the inside of tubes dark.
        assert np.mean(sprite.earth_shine[sprite.alpha == 1.0].max(axis=-1) > 0.003) > 0.9
    monkeypatch.setattr(ray_traced_views, "RayTracer", None)
    second = spacecraft_sprites.trace_sprites(tmp_path, 1, 2, 0, held_out=False)
    for a, b in zip(first, second, strict=True):
        np.testing.assert_allclose(a.sunlit, b.sunlit, atol=2e-3)  # stored in half precision
