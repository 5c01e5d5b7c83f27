"""Ends of what numbers reach: nearly all draws lie between them, and they are near the farthest."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from rpojax.scenario.dispersed_numbers import dispersed_values
from rpojax.scenario.loading import scenario_loader
from rpojax.scenario.warnings.dispersed_reach import DispersedReach, bound_warnings
from rpojax.simulation.noise import run_key

RUNS = 4000
ENTRIES = [
    "dispersions.gps.noise_m={kind='log_normal', sigma=0.2}",
    "dispersions.gps.bias_sigma_m={kind='truncated_normal', sigma=0.1, limit_sigmas=2.0}",
    "dispersions.camera.edge_noise_px={kind='choice', values=[0.5, 1.0, 1.5]}",
    "dispersions.imaging.read_noise={kind='derived', offset=1.0, terms=[{key='gps.noise_m', factor=-0.5}]}",
    "dispersions.formation.desired_position_m[1]={kind='uniform', low=-40.0, high=-20.0}",
    "dispersions.thruster.specific_impulse_s+thruster.minimum_on_time_s={kind='correlated_normal', "
    "covariance=[[4.0, 0.1], [0.1, 0.01]]}",
]


def test_draws_lie_between_the_ends() -> None:
    file = scenario_loader.load("inspection", ENTRIES)
    reach = DispersedReach(file)
    keys = jax.vmap(lambda run: run_key(0, run))(jnp.arange(RUNS))
    drawn = jax.jit(jax.vmap(lambda key: dispersed_values.draw(file, key, {})))(keys)
    for key, values in {key: np.asarray(value) for key, value in drawn.items()}.items():
        if key == "target.attitude" or key == "target.tumble_axis":
            continue
        low, high = reach.ends(key)
        width = np.maximum(high - low, 1e-12)
        outside = np.mean((values < low - 1e-9) | (values > high + 1e-9), axis=0)
        # Three sigma on both sides leave 0.3 %; a derived number may reach beyond by its terms.
        assert np.all(outside < 0.006), key
        span = (values.max(axis=0) - values.min(axis=0)) / width
        assert np.all(span[np.broadcast_to(high > low, span.shape)] > 0.9), key


def test_a_constant_is_its_own_end_and_a_component_has_its_own() -> None:
    reach = DispersedReach(scenario_loader.load("inspection", ENTRIES))
    assert reach.low("gyro.angle_random_walk_deg_sqrt_s") == reach.high("gyro.angle_random_walk_deg_sqrt_s") == 0.0025
    np.testing.assert_array_equal(reach.ends("formation.desired_position_m"), [[0.0, -40.0, 0.0], [0.0, -20.0, 0.0]])
    assert reach.norms("formation.desired_position_m") == (20.0, 40.0)
    assert reach.axis_extremes("formation.desired_position_m").shape == (7, 3)


def warnings_of(*entries: str) -> list[str]:
    file = scenario_loader.load("inspection", [f"dispersions.{each}" for each in entries])
    return bound_warnings(file, DispersedReach(file))


@pytest.mark.parametrize(
    ("entry", "told"),
    [
        ("servicer.mass_kg={kind='normal', sigma=15.0}", "found -15.0, expected what servicer.mass_kg can be: greater"),
        ("servicer.mass_kg={kind='normal', sigma=15.0}", "; some runs are simulated with such a value"),
        (
            "servicer.mass_kg={kind='derived', offset=-55.0, terms=[{key='gps.noise_m', factor=0.1}]}",
            "; nearly every run is simulated with such a value",
        ),
        ("camera.miss_probability={kind='normal', sigma=0.4}", "what camera.miss_probability can be"),
        ("thruster.force_n={kind='derived', offset=-1.0, terms=[{key='gps.noise_m', factor=0.1}]}", "thruster.force_n"),
    ],
)
def test_a_number_that_three_sigma_lead_out_of_its_bounds_is_told(entry: str, told: str) -> None:
    assert any(told in each for each in warnings_of(entry)), warnings_of(entry)


def test_numbers_within_their_bounds_are_not_told() -> None:
    assert not warnings_of(
        "servicer.mass_kg={kind='normal', sigma=1.0}",
        "thruster.force_n={kind='truncated_normal', sigma=0.01, limit_sigmas=2.0}",
    )
