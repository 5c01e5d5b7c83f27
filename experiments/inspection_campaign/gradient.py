"""Gradient of a formation-error loss through a 600 s closed loop, compared with central differences.

    python experiments/inspection_campaign/gradient.py [--run-id 3]

Fixed keys, no outliers, no dead band. A gain is changed by 1e-4 of its value; the script checks that no box crosses the
gate and that the pointing schedule stays the same, since such events would corrupt the difference. With `--events`
outliers and dead band are on, and only finiteness is checked.
"""

import argparse

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

import rpojax
from rpojax.campaign import single_run
from rpojax.scenario import params
from rpojax.scenario.params import Params
from rpojax.simulation import initial_state
from rpojax.simulation.noise import run_key
from rpojax.simulation.state import State, true_relative_state
from rpojax.simulation.step import step

GAINS = {
    "formation.position_weight": ("flight", "formation", "position_weight"),
    "attitude_control.bandwidth_rad_s": ("flight", "attitude_control", "bandwidth"),
    "navigation.edge_noise_px": ("flight", "navigation", "edge_noise"),
}
STEP = 1e-4


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--run-id", type=int, default=3)
    parser.add_argument("--events", action="store_true")
    options = parser.parse_args()
    overrides = [] if options.events else ["camera.outlier_probability=0.0", "formation.dead_band_mm_s=0.0"]
    file = rpojax.load("inspection", ["duration_s=600.0", *overrides])
    scenario, dispersed, _ = single_run.initialise_run(file, seed=0, run_id=options.run_id)
    key = run_key(0, options.run_id)
    stages = rpojax.Stages()

    def scaled(factors: Array) -> Params:
        changed = dispersed
        for factor, path in zip(factors, GAINS.values(), strict=True):
            changed = params.replace_leaf(changed, path, params.get_leaf(dispersed, path) * factor)
        return changed

    def loss(factors: Array) -> tuple[Array, tuple[Array, Array]]:
        gains = scaled(factors)
        desired = gains.flight.formation.desired_position

        @jax.checkpoint
        def tick(state: State) -> tuple[State, tuple[Array, Array, Array]]:
            after, seen = step(scenario, gains, state, stages)
            rho_H, _ = true_relative_state(seen.truth)
            return after, (jnp.sum((rho_H - desired) ** 2), seen.innovation.sensors["box"].accepted, seen.mode)

        start = initial_state.init(scenario, gains, key)
        _, (square, accepted, mode) = jax.lax.scan(lambda state, _: tick(state), start, None, length=scenario.ticks)
        return jnp.sqrt(jnp.mean(square[-200:])), (accepted, mode)

    value_and_grad = jax.jit(jax.value_and_grad(loss, has_aux=True))
    nominal = jnp.ones(len(GAINS))
    (value, events), gradient = value_and_grad(nominal)
    print(f"loss {value:.6f} m; gradient finite: {bool(jnp.all(jnp.isfinite(gradient)))}")
    if options.events:
        return
    plain = jax.jit(loss)
    print("| gain | reverse mode | central difference | relative difference | events unchanged |")
    print("|---|---|---|---|---|")
    for index, name in enumerate(GAINS):
        up, events_up = plain(nominal.at[index].add(STEP))
        down, events_down = plain(nominal.at[index].add(-STEP))
        difference = float((up - down) / (2.0 * STEP))
        same = all(
            np.array_equal(a, b) for other in (events_up, events_down) for a, b in zip(events, other, strict=True)
        )
        relative = abs(float(gradient[index]) - difference) / abs(difference)
        print(f"| `{name}` | {gradient[index]:.9f} | {difference:.9f} | {relative:.1e} | {same} |")


if __name__ == "__main__":
    main()
