"""Default block sizes: whole vectors of the CPU for teams, few runs with a rendered camera."""

import pytest

from rpojax.campaign.execution.batch_engine import default_block_size
from rpojax.scenario.loading import scenario_loader


@pytest.mark.parametrize(
    ("scenario", "overrides", "expected"),
    [
        ("inspection", [], 128),
        ("inspection", ["precision=single"], 256),
        ("inspection", ["camera.model=rendered"], 10),
        ("cooperative_far", [], 64),
        ("cooperative_inspection", [], 48),  # 42.7 runs
        ("cooperative_inspection", ["camera.model=rendered"], 3),
    ],
)
def test_blocks_of_a_team_are_whole_vectors(scenario: str, overrides: list[str], expected: int) -> None:
    assert default_block_size(scenario_loader.load(scenario, overrides)) == expected
