"""The thruster of a servicer without propellant gives nothing."""

import numpy as np
from short_run import STAGES, TICKS, Run, init, rollout

from rpojax.core.constants import STANDARD_GRAVITY
from rpojax.scenario import params as parameters
from rpojax.scenario.params import Params
from rpojax.scenario.static_settings import Scenario
from rpojax.simulation.noise import run_key

LIMIT_KG = 1e-4
"""Of the 0.2 g that the one burn of the short run takes."""


def test_a_burn_ends_when_the_propellant_does(loop: tuple[Scenario, Params], run: Run) -> None:
    scenario, params = loop
    scarce = parameters.replace_leaf(params, ("limits", "propellant"), np.float64(LIMIT_KG))
    state, telemetry = rollout(scenario, scarce, init(scenario, scarce, run_key(1, 0)), TICKS, STAGES)
    with_plenty, _ = run
    thruster, mass = params.plant.thruster, float(params.plant.servicer.mass)
    assert mass - float(with_plenty.truth.mass) > 1.5 * LIMIT_KG
    used = mass - float(state.truth.mass)
    flow = float(thruster.force / (thruster.specific_impulse * STANDARD_GRAVITY))
    # The step in which it runs out is completed; burns are strong to a few per cent.
    assert LIMIT_KG <= used <= LIMIT_KG + 1.1 * flow * scenario.step_s
    exhaust_speed = float(thruster.specific_impulse * STANDARD_GRAVITY)
    np.testing.assert_allclose(state.truth.delta_v, exhaust_speed * np.log(mass / (mass - used)), rtol=1e-6)
    empty = np.flatnonzero(mass - np.asarray(telemetry.truth.mass) >= LIMIT_KG)
    assert len(empty) > 10
    assert np.ptp(np.asarray(telemetry.truth.delta_v)[empty]) == 0.0
