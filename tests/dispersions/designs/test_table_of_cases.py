"""Table of cases."""

import numpy as np
import pytest
from scenario_variants import with_design

from rpojax.campaign import experiment_design
from rpojax.dispersions.designs.run_range import RunRange
from rpojax.errors import RpojaxError
from rpojax.scenario.schema import ScenarioFile


def test_each_run_has_its_row(mission: ScenarioFile) -> None:
    columns = {"gps.noise_m": [1.0, 2.0, 3.0], "faults.fault.kind": ["none", "gps_outage", "none"]}
    file = with_design(mission, kind="table", values=columns)
    design = experiment_design.make_design(file, 0, RunRange(0, 3))
    assert design.for_runs(np.array([2, 0])) == {
        "gps.noise_m": pytest.approx([3.0, 1.0]),
        "faults.fault.kind": pytest.approx([0, 0]),
    }
    assert design.assigned["faults.fault.kind"][1] == 5.0  # the fifth kind after none
    later = experiment_design.make_design(file, 0, RunRange(1, 2))
    np.testing.assert_array_equal(later.for_runs(np.array([2]))["gps.noise_m"], [3.0])
    np.testing.assert_array_equal(later.for_runs(np.array([5]))["gps.noise_m"], [3.0])  # padding
    with pytest.raises(RpojaxError, match=r"^runs: found run 3, expected runs up to 2: the table"):
        experiment_design.make_design(file, 0, RunRange(0, 4))
    with pytest.raises(RpojaxError, match="table"):
        experiment_design.make_design(file, 0, RunRange(3, 1))
