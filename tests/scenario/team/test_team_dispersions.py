"""Random numbers of the servicers of a team: their own, or common ones."""

from typing import Any

import numpy as np

from rpojax.campaign.execution.teams import draw_of_members
from rpojax.core import random_streams
from rpojax.scenario.dispersed_numbers import dispersed_values
from rpojax.scenario.dispersed_numbers.dispersed_values import Values
from rpojax.scenario.dispersed_numbers.dispersion_keys import common_keys, varied_keys
from rpojax.scenario.loading import scenario_loader
from rpojax.scenario.team.members import member_files, member_params


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


def test_the_parameters_hold_the_drawn_values_of_a_team(tables: dict[str, Any]) -> None:
    keys = [
        "link.loss", "link.burst_loss", "link.burst_interval_s", "link.burst_duration_s", "gps_differences.noise_m",
        "gps_differences.slow_error_m", "gps_differences.slow_error_time_constant_s", "navigation.difference_noise_m",
        "navigation.difference_error_sigma_m", "navigation.difference_error_time_constant_s", "gps.common_share",
        "link_range.noise_m", "link_range.bias_sigma_m", "navigation.difference_range_noise_m",
        "navigation.difference_range_bias_sigma_m",
    ]  # fmt: skip
    tables["dispersions"] += [{"key": key, "kind": "uniform", "low": 0.1, "high": 0.9} for key in keys]
    for params, values in zip(member_params(scenario_loader.validate(tables)), _values(tables), strict=True):
        used = dispersed_values.read_back(dispersed_values.apply_to_params(params, values), keys)
        nominal = dispersed_values.read_back(params, keys)
        for key in keys:
            np.testing.assert_allclose(used[key], values[key], rtol=1e-15, err_msg=key)
            assert used[key] != nominal[key], key


def test_a_campaign_draws_common_errors_for_all_servicers(tables: dict[str, Any]) -> None:
    entry = next(each for each in tables["dispersions"] if each.get("key") == "servicer.mass_kg")
    entry["common"] = True
    file = scenario_loader.validate(tables)
    drawn = draw_of_members(file, random_streams.fold_in(random_streams.master_key(0), 3), {})
    masses, forces = drawn["servicer.mass_kg"], drawn["thruster.force_scale"]
    np.testing.assert_allclose(masses - np.array([30.0, 30.0, 20.0]), float(masses[0]) - 30.0, rtol=1e-12)
    assert len(set(forces.tolist())) == 3
