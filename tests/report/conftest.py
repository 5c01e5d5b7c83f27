"""Fixtures with synthetic campaign results."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from matplotlib.figure import Figure
from synthetic_campaign_results import SyntheticCampaign, synthetic_campaign

from rpojax.report.figures import png_export

_PIXEL = png_export.png_bytes(Figure(figsize=(0.02, 0.02)))


@pytest.fixture
def campaign(tmp_path: Path) -> SyntheticCampaign:
    """Synthetic campaign of 40 runs with three full histories."""
    return synthetic_campaign(tmp_path)


@pytest.fixture
def build(tmp_path: Path) -> Callable[..., SyntheticCampaign]:
    """Factory of synthetic campaigns in the test's folder."""

    def make(**choices: Any) -> SyntheticCampaign:
        return synthetic_campaign(tmp_path, **choices)

    return make


@pytest.fixture(autouse=True)
def pixels_for_figures(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """A picture of a pixel in place of each figure of the paper, which take most of the time of a page."""
    if "figures" not in request.path.parts:
        monkeypatch.setattr(png_export, "png_bytes", lambda figure: _PIXEL)
