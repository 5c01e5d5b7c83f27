"""What each effect does to the relative position over one orbit of free flight; prints one Markdown table.

python experiments/environment/perturbation_effects.py
"""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np

import rpojax
from rpojax.core.frames import apply, hill_frame
from rpojax.core.orbits import sun_moon_ephemeris
from rpojax.core.orbits.orbital_mechanics import mean_motion
from rpojax.physics import actuators, equipment_faults, plant
from rpojax.physics.actuators import BurnError, ValveCommand
from rpojax.physics.environment import SunMoonPositions
from rpojax.physics.plant_options import Effects
from rpojax.scenario import params as parameters
from rpojax.scenario import scenario_file as scenarios
from rpojax.scenario.params import Params

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


def free_drift(params: Params, effects: Effects, epoch_s: float, steps: int) -> np.ndarray:
    """Relative position [m] in the Hill frame at each step of free flight from the desired place, at rest there."""
    zero = jnp.zeros(())
    burn = ValveCommand(ignition=zero, cutoff=zero, burn_error=BurnError(magnitude=zero, direction=jnp.zeros(3)))
    thrust = actuators.thrust_over_step(params.plant.thruster, burn, effects.integrator, False, STEP_S)
    start = plant.initial_truth(
        params.plant, params.orbit, params.flight.formation.desired_position, jnp.zeros(3), jnp.array(IDENTITY)
    )

    def step(truth: plant.Truth, time: jax.Array) -> tuple[plant.Truth, jax.Array]:
        sky = SunMoonPositions(
            sun_N=sun_moon_ephemeris.sun_position(time, epoch_s), moon_N=sun_moon_ephemeris.moon_position(time, epoch_s)
        )
        after = plant.step(
            effects, params.plant, truth, jnp.zeros(3), (thrust,), sky, equipment_faults.healthy(), STEP_S
        )
        R_HN, _ = hill_frame(after.r_TN_N, after.v_TN_N)
        return after, apply(R_HN, after.r_ST_N)

    times = STEP_S * jnp.arange(steps, dtype=jnp.float64)
    return np.asarray(jax.jit(lambda truth: jax.lax.scan(step, truth, times)[1])(start))


def main() -> None:
    print("| effect | `inspection_full`: largest, at the end [m] | `inspection_eclipse`: largest, at the end [m] |")
    print("|---|---|---|")
    columns = {}
    for name in ("inspection_full", "inspection_eclipse"):
        file = rpojax.load(name)
        scenario = scenarios.static_settings(file)
        params = parameters.build_params(file.model_dump(), scenario.width_px, scenario.height_px)
        period = 2.0 * np.pi / float(mean_motion(params.orbit.semi_major_axis))
        steps = round(period / STEP_S)
        reference = free_drift(params, FULL, scenario.epoch_s, steps)
        for effect, effects in WITHOUT.items():
            change = np.linalg.norm(free_drift(params, effects, scenario.epoch_s, steps) - reference, axis=1)
            columns.setdefault(effect, []).append(f"{change.max():.2g}, {change[-1]:.2g}")
    for effect, cells in columns.items():
        print(f"| {effect} | {' | '.join(cells)} |")


if __name__ == "__main__":
    main()
