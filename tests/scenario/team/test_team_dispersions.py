"""Random numbers of the servicers of a team: their own, or common ones."""

from typing import Any

import numpy as np

from rpojax.core import random_streams
from rpojax.scenario.dispersed_numbers import dispersed_values
from rpojax.scenario.dispersed_numbers.dispersed_values import Values
from rpojax.scenario.dispersed_numbers.dispersion_keys import common_keys, varied_keys
from rpojax.scenario.loading import scenario_loader
from rpojax.scenario.team.members import member_files


def _values(tables: dict[str, Any]) -> list[Values]:
    """Values of each servicer of one run."""
    run_key = random_streams.fold_in(random_streams.master_key(0), 3)
    keys = [run_key, *(random_streams.fold_in(run_key, number) for number in (101, 102))]
    members = member_files(scenario_loader.validate(tables))
    return [dispersed_values.draw(member, key, {}, team_key=run_key) for member, key in zip(members, keys, strict=True)]


def test_the_world_is_common_and_what_is_of_a_servicer_its_own(tables: dict[str, Any]) -> None:
    tables["dispersions"].append({"key": "link.loss", "kind": "uniform", "low": 0.0, "high": 0.5})
    file = scenario_loader.validate(tables)
    common = common_keys(file)
    assert common == {"target.tumble_rate_deg_s", "target.tumble_axis", "target.attitude", "link.loss"}
    first, *others = _values(tables)
    for other in others:
        for key in varied_keys(file):
            assert np.array_equal(first[key], other[key]) == (key in common), key


def test_the_first_servicer_has_the_values_of_a_servicer_alone(tables: dict[str, Any]) -> None:
    first = _values(tables)[0]
    alone = dispersed_values.draw(
        scenario_loader.load("safety_ellipse"), random_streams.fold_in(random_streams.master_key(0), 3), {}
    )
    assert {key: value.tolist() for key, value in first.items()} == {
        key: value.tolist() for key, value in alone.items()
    }


def test_a_common_dispersion_is_the_same_error_about_each_nominal_value(tables: dict[str, Any]) -> None:
    entry = next(each for each in tables["dispersions"] if each.get("key") == "servicer.mass_kg")
    entry["common"] = True
    masses = [float(values["servicer.mass_kg"]) for values in _values(tables)]
    assert masses[0] == masses[1] != 30.0
    np.testing.assert_allclose(masses[2] - 20.0, masses[0] - 30.0, rtol=1e-12)
    assert "servicer.mass_kg" not in common_keys(scenario_loader.validate(tables))
