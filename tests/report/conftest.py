"""Fixtures with synthetic campaign results."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from synthetic_campaign_results import SyntheticCampaign, synthetic_campaign


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
