"""Fixtures: a short mission and a small campaign of it, with compiled programs shared between tests."""

import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zarr
from shared_compilation import shared_programs

from rpojax.campaign.run_and_resume import run_campaign
from rpojax.campaign.storage import campaign_seal
from rpojax.campaign.storage.campaign_folder import Campaign
from rpojax.scenario.loading import scenario_loader
from rpojax.scenario.schema import ScenarioFile


@pytest.fixture(scope="session")
def programs() -> Iterator[None]:
    """Batch engines of the session share compiled programs."""
    with shared_programs():
        yield


@pytest.fixture(scope="session")
def mission(programs: None) -> ScenarioFile:
    """Two segments and two burn decisions of the nominal mission, with all its dispersions."""
    return scenario_loader.load("inspection", ["duration_s=400"])


@pytest.fixture(scope="session")
def three_runs(tmp_path_factory: pytest.TempPathFactory, mission: ScenarioFile) -> Campaign:
    """Three runs in three blocks, with the histories of two; tests must not change it."""
    return run_campaign(mission, 3, tmp_path_factory.mktemp("three") / "runs", block_size=1, histories=[0, 2])


@pytest.fixture(scope="session")
def arrays() -> Callable[[Path], dict[str, np.ndarray]]:
    """Function that reads all arrays of a campaign folder, by path."""

    def read(directory: Path) -> dict[str, np.ndarray]:
        root = zarr.open_group(str(directory / "results.zarr"), mode="r")
        nodes = root.members(max_depth=None)
        return {name: np.asarray(node[:]) for name, node in nodes if isinstance(node, zarr.Array)}

    return read


@pytest.fixture
def edit_info() -> Callable[..., None]:
    """Function that changes entries of a folder's campaign.json, and seals it anew."""

    def edit(directory: Path, **entries: Any) -> None:
        path = directory / "campaign.json"
        path.write_text(json.dumps(campaign_seal.sealed(json.loads(path.read_text()) | entries)))

    return edit
