"""Closed-loop run of 90 s with one burn, under a formation law of the user."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from rpojax.flight.control import formation_law
from rpojax.flight.stages import Stages
from rpojax.simulation import initial_state
from rpojax.simulation.rollout import rollout as rollout_ticks
from rpojax.simulation.state import State
from rpojax.simulation.telemetry import Telemetry

TICKS = 90
SAME = 1e-9
"""Relative rounding differences of two programs of the same loop after 90 s."""
OVERRIDES = (
    "duration_s=90.0",
    "rates.formation_period_s=40.0",
    "pointing.look_away_limit_s=40.0",
    "formation.lead_s=20.0",
)
"""One burn: planned at 40 s, executed at 60 s."""
Run = tuple[State, Telemetry]
LIMIT = 0.005
"""Largest velocity change of the law [m/s]."""


def limited_lqr(gain: jax.Array, deviation: jax.Array) -> jax.Array:
    """LQR feedback with a limited velocity change."""
    delta_v = formation_law.lqr_feedback(gain, deviation)
    return delta_v * jnp.minimum(LIMIT / jnp.sqrt(jnp.sum(delta_v**2)), 1.0)


STAGES = Stages(formation_law=limited_lqr)
init = jax.jit(initial_state.init, static_argnums=0)
rollout = jax.jit(rollout_ticks, static_argnums=(0, 3, 4))


def assert_close(found: Any, expected: Any) -> None:
    """Asserts that two pytrees are equal up to rounding, each leaf relative to its largest number."""

    def one(path: Any, a: jax.Array, b: jax.Array) -> None:
        scale = 1.0 + float(np.max(np.abs(np.where(np.isfinite(b), b, 0.0)), initial=0.0))
        np.testing.assert_allclose(a, b, rtol=0.0, atol=SAME * scale, err_msg=jax.tree_util.keystr(path))

    jax.tree_util.tree_map_with_path(one, found, expected)
