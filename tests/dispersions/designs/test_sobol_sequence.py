"""Sobol sequence: balance of a digital net, and extension by more runs."""

import numpy as np
from scenario_variants import with_design

from rpojax.campaign import experiment_design
from rpojax.dispersions.designs.run_range import RunRange
from rpojax.scenario.dispersed_numbers import dispersion_keys
from rpojax.scenario.schema import ScenarioFile


def test_points_have_the_balance_of_a_digital_net(mission: ScenarioFile) -> None:
    """Equal intervals of each coordinate, and 64 cells of the first two, contain equal numbers of 64 runs."""
    assigned = experiment_design.make_design(with_design(mission, kind="sobol"), 1, RunRange(0, 64)).assigned
    points = np.concatenate([assigned[entry.name] for entry in mission.dispersions], axis=1)
    assert points.shape[1] == sum(dispersion_keys.coordinate_count(mission, entry) for entry in mission.dispersions)
    for parts in (2, 4, 8, 16, 32, 64):
        counts = [np.bincount(np.floor(column * parts).astype(int), minlength=parts) for column in points.T]
        assert np.all(np.array(counts) == 64 // parts)
    cells = np.floor(points[:, :2] * 8).astype(int)
    assert len({tuple(cell) for cell in cells.tolist()}) == 64


def test_more_runs_leave_the_earlier_ones_unchanged(mission: ScenarioFile) -> None:
    file = with_design(mission, kind="sobol")
    whole = experiment_design.make_design(file, 1, RunRange(0, 50)).assigned
    for run_range in (RunRange(0, 20), RunRange(13, 7), RunRange(49, 1)):
        part = experiment_design.make_design(file, 1, run_range).assigned
        rows = slice(run_range.first_run, run_range.first_run + run_range.runs)
        for name, values in part.items():
            np.testing.assert_array_equal(values, whole[name][rows])
