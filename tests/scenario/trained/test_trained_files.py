"""Trained files of a scenario."""

import pytest

from rpojax.errors import ScenarioError
from rpojax.scenario.loading import scenario_loader
from rpojax.scenario.trained import trained_files


@pytest.mark.parametrize("key", ["field", "detector"])
def test_a_missing_trained_file_is_named(key: str) -> None:
    file = scenario_loader.load("inspection", ["camera.model=rendered", f"imaging.{key}=/nowhere/x.safetensors"])
    with pytest.raises(ScenarioError, match=f"imaging.{key}"):
        trained_files.networks_for_model(file.model_dump())
