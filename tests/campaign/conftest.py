"""Tests of this folder share compiled programs and a rendered run."""

from pathlib import Path

import pytest
from empty_campaign_folders import empty_campaign
from rendered_run import RUN, SEED, RenderedRun, simulate_rendered_run

from rpojax.campaign.storage.campaign_folder import Campaign


@pytest.fixture(scope="session", autouse=True)
def sharing(programs: None) -> None:
    """Engines for the same scenario use one pair of programs."""


@pytest.fixture(scope="session")
def rendered_run() -> RenderedRun:
    """A few ticks of a run with a rendered camera."""
    return simulate_rendered_run()


@pytest.fixture
def rendered_campaign(rendered_run: RenderedRun, tmp_path: Path) -> Campaign:
    """A campaign folder that holds the history of the rendered run, and nothing else."""
    campaign = empty_campaign(tmp_path / "runs", rendered_run.file, SEED, 4, 0, 1, [RUN])
    campaign.write_history(RUN, rendered_run.history)
    return campaign
