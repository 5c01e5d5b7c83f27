"""Change of the relative position over one orbit of free drift due to each effect; prints a Markdown table.

python experiments/environment/perturbation_effects.py
"""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np

import rpojax
from rpojax.core.frames import hill_frame
from rpojax.core.orbits import sun_moon_ephemeris
from rpojax.core.orbits.keplerian_elements import mean_motion
from rpojax.core.orbits.sun_moon_ephemeris import SunMoonPositions
from rpojax.core.vectors import apply
from rpojax.physics import equipment_faults, plant, plant_state
from rpojax.physics.plant_options import Effects
from rpojax.physics.thruster import BurnError, ValveCommand, thrust_over_step
from rpojax.scenario import params as parameters
from rpojax.scenario.params import Params
from rpojax.scenario.static_settings import static_settings

STEP_S = 2.0
IDENTITY = (1.0, 0.0, 0.0, 0.0)

FULL = Effects(integrator="rk8", zonal_degree=6, sun_gravity=True, moon_gravity=True, drag=True, solar_pressure=True)
WITHOUT = {
    "J2 to J6 (against a point mass)": replace(FULL, zonal_degree=0),
    "J3 to J6": replace(FULL, zonal_degree=2),
    "differential drag": replace(FULL, drag=False),
    "differential solar pressure": replace(FULL, solar_pressure=False),
    "Sun": replace(FULL, sun_gravity=False),
    "Moon": replace(FULL, moon_gravity=False),
}


def free_drift(params: Params, effects: Effects, steps: int) -> np.ndarray:
    """Relative position [m] in the Hill frame (steps, 3) of free drift from rest at the desired position."""
    zero = jnp.zeros(())
    burn = ValveCommand(ignition=zero, cutoff=zero, burn_error=BurnError(magnitude=zero, direction=jnp.zeros(3)))
    thrust = thrust_over_step(params.plant.thruster, burn, effects.integrator, False, STEP_S)
    start = plant_state.initial_truth(
        params.plant, params.orbit, params.flight.formation.desired_position, jnp.zeros(3), jnp.array(IDENTITY)
    )

    def step(truth: plant_state.Truth, time: jax.Array) -> tuple[plant_state.Truth, jax.Array]:
        sky = SunMoonPositions(
            sun_N=sun_moon_ephemeris.sun_position(time, params.epoch),
            moon_N=sun_moon_ephemeris.moon_position(time, params.epoch),
        )
        after = plant.step(
            effects, params.plant, truth, jnp.zeros(3), (thrust,), sky, equipment_faults.healthy(), STEP_S
        )
        R_HN, _ = hill_frame(after.r_TN_N, after.v_TN_N)
        return after, apply(R_HN, after.r_ST_N)

    times = STEP_S * jnp.arange(steps, dtype=jnp.float64)
    return np.asarray(jax.jit(lambda truth: jax.lax.scan(step, truth, times)[1])(start))


def main() -> None:
    """Compares free drift with and without each effect."""
    print("| effect | `inspection_full`: largest, at the end [m] | `inspection_eclipse`: largest, at the end [m] |")
    print("|---|---|---|")
    columns = {}
    for name in ("inspection_full", "inspection_eclipse"):
        file = rpojax.load(name)
        scenario = static_settings(file)
        params = parameters.build_params(file.model_dump(), scenario.width_px, scenario.height_px)
        period = 2.0 * np.pi / float(mean_motion(params.orbit.semi_major_axis))
        steps = round(period / STEP_S)
        reference = free_drift(params, FULL, steps)
        for effect, effects in WITHOUT.items():
            change = np.linalg.norm(free_drift(params, effects, steps) - reference, axis=1)
            columns.setdefault(effect, []).append(f"{change.max():.2g}, {change[-1]:.2g}")
    for effect, cells in columns.items():
        print(f"| {effect} | {' | '.join(cells)} |")


if __name__ == "__main__":
    main()
