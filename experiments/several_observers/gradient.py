"""Derivative of a team's range error with respect to the angle between two stations, against central differences.

python experiments/several_observers/gradient.py [--ticks 150]

Without misses, false boxes and gate, so that nothing is decided within the difference; random numbers are the same.
"""

import argparse
import json

import numpy as np

import rpojax

rpojax.prepare_process()

import jax  # noqa: E402
import jax.numpy as jnp  # noqa: E402
from measure import STATIONS  # noqa: E402

from rpojax.scenario.loading import scenario_loader  # noqa: E402
from rpojax.scenario.static_settings import static_settings  # noqa: E402
from rpojax.scenario.team.members import member_params  # noqa: E402
from rpojax.simulation.noise import run_key  # noqa: E402
from rpojax.simulation.team import initial_team, member_axes, team_step  # noqa: E402

OVERRIDES = ["camera.miss_probability=0", "camera.outlier_probability=0", "navigation.gating=none"]
KEY = "initial.relative_position_m"
STEPS_RAD = (3e-5, 1e-5, 3e-6)
"""Steps of the differences; steps of 1e-4 rad lead over kinks, where the peers' gate takes or leaves a box."""


def main() -> None:
    """Prints one line of JSON."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--ticks", type=int, default=150)
    ticks = parser.parse_args().ticks
    file = scenario_loader.load(STATIONS, OVERRIDES)
    scenario = static_settings(file, allow_team=True)
    nominal = member_axes.stack_members(member_params(file))

    def range_error(angle: jax.Array) -> jax.Array:
        """RMS range error of both servicers over the second half [m], for an angle between the stations [rad]."""
        zero = jnp.zeros_like(angle)
        starts = jnp.stack(
            [jnp.array([0.0, -32.0, 0.0]), 32.0 * jnp.stack([zero, -jnp.cos(angle), jnp.sin(angle)])], -1
        )
        team = member_axes.with_values(nominal, {KEY: starts}, ())

        def tick(state: object, _: None) -> tuple[object, jax.Array]:
            after, seen = team_step.step(scenario, team, state)  # pyright: ignore[reportArgumentType]
            r_ST_N, estimate_N = seen.truth.r_ST_N, seen.flight.orbit.relative.r_TS_N
            error = jnp.sum((estimate_N + r_ST_N) * r_ST_N, axis=0) / jnp.sqrt(jnp.sum(r_ST_N**2, axis=0))
            return after, error

        errors = jax.lax.scan(tick, initial_team.init(scenario, team, run_key(1, 0)), None, length=ticks)[1]
        return jnp.sqrt(jnp.mean(errors[ticks // 2 :] ** 2))

    value = jax.jit(range_error)
    angle = np.radians(90.0)
    # Forward mode, and no batch of tangents: the transposed program or `jacfwd` compile for much longer.
    slope = float(jax.jit(lambda at: jax.jvp(range_error, (at,), (jnp.ones_like(at),))[1])(angle))
    differences = [float(value(angle + step) - value(angle - step)) / (2.0 * step) for step in STEPS_RAD]
    print(
        json.dumps(
            {
                "range error [m]": float(value(angle)),
                "derivative [m/rad]": slope,
                "central differences [m/rad]": dict(zip(STEPS_RAD, differences, strict=True)),
                "greatest relative difference": max(abs(slope / each - 1.0) for each in differences),
            }
        )
    )


if __name__ == "__main__":
    main()
