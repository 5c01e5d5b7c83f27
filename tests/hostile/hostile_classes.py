"""All classes of hostile cases, with their shares of the whole."""

import logging
from collections.abc import Callable
from pathlib import Path

import hostile_assets
import hostile_command_lines
import hostile_folders
import hostile_reports
import hostile_scenarios
import numpy as np
from case_ledger import Case, Ledger, run_cases
from empty_campaign_folders import empty_campaign, synthetic_block, synthetic_timing
from hypothesis.strategies import SearchStrategy

from rpojax.scenario.loading import scenario_loader

SHARES: dict[str, tuple[float, Callable[[Path], SearchStrategy[Case]]]] = {
    "scenario": (0.276, hostile_scenarios.scenario_cases),
    "override": (0.15, lambda _: hostile_scenarios.override_cases()),
    "case table": (0.0935, hostile_scenarios.table_cases),
    "orbit message": (0.08, hostile_scenarios.orbit_cases),
    "campaign folder": (0.12, lambda folder: hostile_folders.folder_cases(small_campaign(folder))),
    "weights": (0.07, hostile_assets.weight_cases),
    "picture": (0.07, hostile_assets.picture_cases),
    "data set": (0.07, hostile_assets.data_set_cases),
    "mesh": (0.05, hostile_assets.mesh_cases),
    "command line": (0.02, hostile_command_lines.command_line_cases),
    "report": (0.0005, hostile_reports.report_cases),
}
"""Class -> its share, and its generator for a folder in which cases may write."""


def small_campaign(folder: Path) -> Path:
    """Folder of a finished campaign of synthetic runs with two histories and one change of requirements."""
    file = scenario_loader.load("inspection", ["duration_s=400"])
    made = empty_campaign(folder / "runs", file, 7, 5, 0, 2)
    for block in range(made.block_count):
        made.write_block(block, synthetic_block(block), synthetic_timing())
    for run in (0, 1):
        made.write_history(run, {"time_s": np.arange(4.0), "rho_H": np.full((4, 3), float(run))})
    return made.directory


def run_all(count: int, folder: Path, first_seed: int) -> Ledger:
    """Runs `count` cases of all classes, by their shares, in a folder."""
    # Libraries log what they cannot read; the commands keep it from the terminal too.
    logging.getLogger().addHandler(logging.NullHandler())
    ledger = Ledger()
    for name, (share, cases) in SHARES.items():
        place = folder / name.replace(" ", "_")
        place.mkdir()
        run_cases(ledger, cases(place), max(1, round(share * count)), first_seed)
    return ledger
