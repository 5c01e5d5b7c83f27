"""Categorical inputs are excluded from rankings."""

import numpy as np

from rpojax.report.figures.scatter_explorer import scatter_explorer
from rpojax.report.sections import driver_section, sensitivity_section


def test_categorical_inputs_are_not_ranked(build):
    campaign = build(runs=60, seconds=60, kept=(), failed=tuple(range(20)))
    campaign.drawn |= {"faults.fault.kind": np.repeat([3.0, 1.0, 2.0], 20), "faults.fault.wheel": np.arange(60.0) % 3.0}
    # Those of a servicer of a team are codes, too.
    campaign.drawn |= {f"{key}/second": values for key, values in campaign.drawn.items() if key.startswith("faults.")}
    codes = {"faults.fault.kind", "faults.fault.wheel", "faults.fault.kind/second", "faults.fault.wheel/second"}
    assert all(
        codes.isdisjoint(one["name"] for one in entry["inputs"]) for entry in sensitivity_section.content(campaign)
    )
    found = driver_section.content(campaign)
    # Every run of the first kind of fault fails, which its values tell, without an order.
    assert any(one["inputs"] == ["faults.fault.kind"] and one["parts"] == [[1.0, 2.0, 3.0]] for one in found["drivers"])
    explorer = scatter_explorer(campaign, np.arange(len(campaign.run_ids)))
    assert explorer is not None
    assert all(codes.isdisjoint(one["rank"]) for one in explorer["metrics"].values())
    assert codes <= set(explorer["inputs"])
