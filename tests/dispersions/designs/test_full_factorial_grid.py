"""Full factorial grid."""

import itertools

import numpy as np
import pytest
from scenario_variants import with_design

from rpojax.campaign import experiment_design
from rpojax.dispersions.designs.run_range import RunRange
from rpojax.errors import RpojaxError
from rpojax.scenario.schema import ScenarioFile


def test_every_combination_occurs_once_and_the_last_key_varies_fastest(mission: ScenarioFile) -> None:
    positions = [[0.0, -30.0, 0.0], [0.0, 40.0, 0.0], [20.0, 0.0, 0.0]]
    values = {
        "gps.noise_m": [1.0, 2.0],
        "formation.desired_position_m": positions,
        "faults.fault.kind": ["none", "gps_outage"],
    }
    file = with_design(mission, kind="grid", values=values)
    assigned = experiment_design.make_design(file, 0, RunRange(0, 12)).assigned
    found = [
        (noise, position, ("none", "gps_outage")[int(code > 0)])
        for noise, position, code in zip(*(assigned[key].tolist() for key in values), strict=True)
    ]
    assert found == list(itertools.product(*values.values()))
    part = experiment_design.make_design(file, 0, RunRange(5, 3)).assigned
    np.testing.assert_array_equal(part["gps.noise_m"], assigned["gps.noise_m"][5:8])
    with pytest.raises(RpojaxError, match=r"found run 12, expected runs up to 11: the grid"):
        experiment_design.make_design(file, 0, RunRange(0, 13))
