"""Tests of this folder share compiled programs and a rendered run."""

from pathlib import Path

import pytest
from empty_campaign_folders import empty_campaign
from rendered_run import RUN, SEED, RenderedRun, simulate_rendered_run

from rpojax.campaign.execution.teams import joined_history
from rpojax.campaign.storage.campaign_folder import Campaign
from rpojax.scenario.loading import scenario_loader


@pytest.fixture(scope="session", autouse=True)
def sharing(programs: None) -> None:
    """Engines for the same scenario use one pair of programs."""


@pytest.fixture(scope="session")
def rendered_run() -> RenderedRun:
    """A few ticks of a run with a rendered camera."""
    return simulate_rendered_run()


@pytest.fixture(scope="session")
def rendered_pair(rendered_run: RenderedRun) -> RenderedRun:
    """The rendered run as that of two servicers at the same place, with the images of the first one's loop."""
    tables = rendered_run.file.model_dump() | {"servicers": [{"name": "first"}, {"name": "second"}]}
    tables["formation"] |= {"desired_position_m": [0.0, -30.0, 0.0]}
    tables["servicers"][1] |= {"initial": {"relative_position_m": [0.0, 50.0, 0.0]}}
    history = joined_history([rendered_run.history, rendered_run.history])
    return RenderedRun(scenario_loader.validate(tables), history, rendered_run.images)


@pytest.fixture
def rendered_campaign(rendered_run: RenderedRun, tmp_path: Path) -> Campaign:
    """A campaign folder that holds the history of the rendered run, and nothing else."""
    campaign = empty_campaign(tmp_path / "runs", rendered_run.file, SEED, 4, 0, 1, [RUN])
    campaign.write_history(RUN, rendered_run.history)
    return campaign
