"""Free drifts of pairs of servicers: by the mass and surface of each, alike in either order."""

from typing import Any

import jax
import numpy as np
import pytest

from rpojax.campaign.execution import team_passive_safety
from rpojax.campaign.execution.passive_safety import PassiveSafety
from rpojax.campaign.single_run import nominal_parameters
from rpojax.core.pytree import replace
from rpojax.metrics import team
from rpojax.scenario.loading import scenario_loader
from rpojax.scenario.params import Params
from rpojax.simulation import initial_state
from rpojax.simulation.noise import run_key

TICKS = 300
RUNS = 2
MASSES = np.array([[30.0, 30.0], [30.0, 60.0]])
"""Drawn mass [kg] of two servicers, one after the other, in two runs."""


@pytest.fixture(scope="module")
def pair() -> tuple[PassiveSafety, Params, dict[str, np.ndarray]]:
    """Two servicers at rest, 50 m and 20 m behind the target, under drag; in the first run they are alike."""
    file = scenario_loader.load(
        "inspection",
        [
            f"duration_s={TICKS}",
            "safety.horizons=['3_h']",
            "requirements=[]",
            "safety.spacing_s=400",
            "effects.drag=true",
        ],
    )
    scenario, nominal = nominal_parameters(file)
    truth = jax.jit(initial_state.init, static_argnums=0)(scenario, nominal, run_key(0, 0)).truth
    place = np.ones((TICKS, 1, 2, RUNS)) * np.array([1.0, 0.4])[:, None]
    records = {
        "r_ST_N": place * np.asarray(truth.r_ST_N)[:, None, None],
        "v_ST_N": place * np.asarray(truth.v_ST_N)[:, None, None],
        "mass_kg": np.broadcast_to(MASSES, (TICKS, 2, RUNS)),
        "delta_v_m_s": np.zeros((TICKS, 2, RUNS)),
        "running": np.ones((TICKS, 2, RUNS), bool),
    }
    records["running"][1:] = False
    nominal = jax.tree.map(np.asarray, nominal)
    return PassiveSafety(file, scenario, nominal, RUNS, jax.devices()[:1]), nominal, records


def separation(pair: Any, masses: np.ndarray, members: list[Params], order: tuple[int, int]) -> np.ndarray:
    """Least separation (runs,) [m] of the pair in an order of its servicers, both with their parameters and masses."""
    evaluator, _, records = pair
    drawn = [{"servicer.mass_kg": masses[number]} for number in order]
    in_order = {name: values[..., list(order), :] for name, values in records.items()}
    in_order["mass_kg"] = np.broadcast_to(masses[list(order)], (TICKS, 2, RUNS))
    found = team_passive_safety.least_separation(evaluator, [members[number] for number in order], drawn, in_order)
    return found[team.PASSIVE_SEPARATION]


def test_masses_and_surfaces_of_both_servicers_act_and_in_either_order(pair: Any) -> None:
    nominal = pair[1]
    alike = separation(pair, MASSES, [nominal, nominal], (0, 1))
    # The other one is on the target's orbit in both orders, which it is not in truth.
    np.testing.assert_allclose(separation(pair, MASSES, [nominal, nominal], (1, 0)), alike, rtol=2e-3)
    np.testing.assert_allclose(alike[0], 30.0, rtol=1e-3)
    assert alike[1] < 12.0
    surface = nominal.plant.servicer_surface
    plant = replace(nominal.plant, servicer_surface=replace(surface, area=2.0 * surface.area))
    larger = replace(nominal, plant=plant)
    # Twice the area of twice the mass: nothing differs.
    balanced = separation(pair, MASSES, [nominal, larger], (0, 1))
    np.testing.assert_allclose(balanced[1], alike[0], rtol=1e-3)
    # The one with more drag overtakes the other one, or leaves it behind below.
    assert separation(pair, MASSES, [larger, nominal], (0, 1))[0] < 12.0 < 29.9 < balanced[0]
    other_way = separation(pair, MASSES[::-1], [larger, nominal], (0, 1))
    np.testing.assert_allclose(other_way[1], alike[0], rtol=1e-3)


def test_what_both_have_burned_by_a_drift_is_part_of_the_difference(pair: Any) -> None:
    evaluator, nominal, records = pair
    drawn = [{"servicer.mass_kg": np.full(RUNS, 30.0)}] * 2
    burned = {**records, "mass_kg": np.full((TICKS, 2, RUNS), 15.0)}
    whole = {**records, "mass_kg": np.full((TICKS, 2, RUNS), 30.0)}
    found = [
        team_passive_safety.least_separation(evaluator, [nominal, nominal], drawn, each)[team.PASSIVE_SEPARATION]
        for each in (burned, whole)
    ]
    np.testing.assert_allclose(*found, rtol=1e-2)
