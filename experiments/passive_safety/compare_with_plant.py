"""Ranges of free drifts against direct propagation by the plant at its own step, for instants of missions."""

import argparse

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

import rpojax
from rpojax.core.orbits import keplerian_elements
from rpojax.core.orbits.sun_moon_ephemeris import sun_and_moon_at
from rpojax.core.pytree import replace
from rpojax.physics import equipment_faults, free_drift, plant
from rpojax.physics.free_drift import STEP_S, Drift, Environment
from rpojax.physics.plant_state import Truth
from rpojax.scenario.params import Params
from rpojax.scenario.static_settings import Scenario

DAY_S = 86400.0
MISSIONS: dict[str, tuple[str, ...]] = {
    "inspection": ("inspection",),
    "inspection_full": ("inspection_full",),
    "inspection_radial": ("inspection_radial",),
    "inspection_eclipse": ("inspection_eclipse", "duration_s=6000"),
    "full, e = 0.1": ("inspection_full", "orbit.semi_major_axis_m=7.8e6", "orbit.eccentricity=0.1"),
    "full, e = 0.7": ("inspection_full", "orbit.semi_major_axis_m=2.4e7", "orbit.eccentricity=0.7"),
}


def instants(scenario: Scenario, params: Params, state: rpojax.State, every: int) -> Truth:
    """True states of a run every so many ticks, along the last axis."""

    def advance(state: rpojax.State, _: None) -> tuple[rpojax.State, Truth]:
        return jax.lax.scan(lambda each, _: (rpojax.step(scenario, params, each)[0], None), state, None, every)[
            0
        ], state.truth

    _, truths = jax.jit(lambda state: jax.lax.scan(advance, state, None, scenario.ticks // every))(state)
    return jax.tree.map(lambda leaf: jnp.moveaxis(leaf, 0, -1), truths)


def ranges_by_plant(scenario: Scenario, params: Params, truths: Truth, starts_s: Array, ends_s: Array) -> Array:
    """Least ranges (horizons, drifts) at the steps of the plant within times (horizons,) after each start."""
    dt = scenario.step_s

    def advance(number: Array, carry: tuple[Truth, Array]) -> tuple[Truth, Array]:
        truths, least = carry

        def step(truth: Truth, start_s: Array) -> Truth:
            time = jnp.floor((start_s + number * dt) / scenario.tick_s + 1e-6) * scenario.tick_s
            sky, healthy = sun_and_moon_at(params.epoch, time), equipment_faults.healthy()
            return plant.step(scenario.effects, params.plant, truth, jnp.zeros(3), (), sky, healthy, dt)

        after = jax.vmap(step, in_axes=-1, out_axes=-1)(truths, starts_s)
        square = jnp.sum(after.r_ST_N**2, axis=0)
        within = ((number + 1) * dt <= ends_s)[:, None]
        return after, jnp.where(within, jnp.minimum(least, square[None]), least)

    first = jnp.sum(truths.r_ST_N**2, axis=0)[None] + jnp.zeros((len(ends_s), 1))
    count = round(float(jnp.max(ends_s)) / dt)
    _, least = jax.jit(lambda carry: jax.lax.fori_loop(0, count, advance, carry))((truths, first))
    return jnp.sqrt(least)


def ranges_by_free_drift(scenario: Scenario, params: Params, truths: Truth, starts_s: Array, ends_s: Array) -> Array:
    """The same from states as they are recorded, in single precision, by the program of campaigns."""
    environment = Environment(scenario.effects, params.plant, params.epoch)
    recorded = replace(truths, **{name: _recorded(getattr(truths, name)) for name in ("r_ST_N", "v_ST_N", "mass")})
    drifts = Drift(
        start=starts_s,
        r_ST_N=recorded.r_ST_N,
        v_ST_N=recorded.v_ST_N,
        mass=recorded.mass,
        thrust_s=jnp.zeros_like(starts_s),
        acceleration_N=jnp.zeros_like(recorded.r_ST_N),
        ends=starts_s[None] + ends_s[:, None],
    )
    last = jnp.int32(np.ceil(np.max(drifts.ends) / STEP_S))
    mission_steps = int(np.ceil(scenario.ticks * scenario.tick_s / STEP_S)) + 1

    def propagate(drifts: Drift) -> Array:
        orbit = free_drift.target_orbit(
            environment, *keplerian_elements.state_from_elements(params.orbit), mission_steps
        )
        found = free_drift.drift_ranges(environment, orbit, drifts, params.limits.keep_out, jnp.int32(0), last)
        return jnp.sqrt(found.least_square)

    return jax.jit(propagate)(drifts)


def _recorded(values: Array) -> Array:
    return values.astype(jnp.float32).astype(values.dtype)


def main() -> None:
    """Prints a table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--mission", nargs="*", default=list(MISSIONS), choices=list(MISSIONS))
    parser.add_argument("--runs", type=int, default=2)
    parser.add_argument("--every", type=int, default=600, help="ticks between two instants")
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    print("| mission | instants | 1 orbit [m] | 4 orbits [m] | 24 h [m] | verdicts that agree | unsafe within 24 h |")
    print("|---|---|---|---|---|---|---|")
    for mission in given.mission:
        name, *overrides = MISSIONS[mission]
        file = rpojax.load(name, overrides)
        errors, agree, unsafe = [], 0, 0
        for run in range(given.runs):
            scenario, params, state = rpojax.initialise_run(file, given.seed, run)
            truths = instants(scenario, params, state, given.every)
            starts_s = jnp.arange(truths.mass.shape[-1]) * given.every * scenario.tick_s
            period = 2.0 * jnp.pi / keplerian_elements.mean_motion(params.orbit.semi_major_axis)
            ends_s = jnp.minimum(jnp.stack([period, 4.0 * period, jnp.asarray(DAY_S)]), DAY_S)
            expected = ranges_by_plant(scenario, params, truths, starts_s, ends_s)
            found = ranges_by_free_drift(scenario, params, truths, starts_s, ends_s)
            errors.append(np.abs(found - expected))
            below = expected < params.limits.keep_out
            agree += int(np.sum(np.all((found < params.limits.keep_out) == below, axis=0)))
            unsafe += int(np.sum(below[-1]))
        joined = np.concatenate(errors, axis=1)
        worst = " | ".join(f"{value:.4f}" for value in joined.max(axis=1))
        count = joined.shape[1]
        print(f"| {mission} | {count} | {worst} | {agree} of {count} | {unsafe} |", flush=True)


if __name__ == "__main__":
    main()
