"""Default block sizes: whole vectors of the CPU for teams, few runs with a rendered camera."""

import pytest

from rpojax.campaign.execution.batch_engine import default_block_size, fitted_block_size
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


@pytest.mark.parametrize(
    ("scenario", "overrides", "runs", "devices", "expected"),
    [
        ("inspection", [], 500, 2, 128),  # two passes of 128 on each core, 12 runs of padding
        ("inspection", [], 128, 2, 64),  # not 128 on one core while the other is idle
        ("inspection", [], 64, 2, 32),
        ("inspection", [], 16, 2, 16),  # the rest of a vector costs as much as a whole one
        ("inspection", [], 1, 8, 16),
        ("inspection", [], 300, 2, 64),  # 192 places on each core in place of 256
        ("inspection", [], 100_000, 2, 128),
        ("cooperative_inspection", [], 32, 2, 16),
        ("inspection", ["camera.model=rendered"], 4, 2, 2),
        ("inspection", ["camera.model=rendered"], 100, 2, 10),
    ],
)
def test_blocks_are_fitted_to_a_campaign(
    scenario: str, overrides: list[str], runs: int, devices: int, expected: int
) -> None:
    assert fitted_block_size(scenario_loader.load(scenario, overrides), runs, devices) == expected
