"""Estimation errors of the orbit filter."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from rpojax.core.numerics import double_single
from rpojax.simulation.telemetry import Telemetry


def orbit_errors(telemetry: Telemetry) -> tuple[Float[Array, "6"], Float[Array, "6"]]:
    """Estimate minus truth in N [m, m/s]: state of the servicer, and of the target relative to it."""
    truth, servicer, relative = telemetry.truth, telemetry.flight.orbit.servicer, telemetry.flight.orbit.relative
    low, true_low = (each.orbit_low if each.orbit_low is not None else (None, None) for each in (servicer, truth))
    return (
        jnp.concatenate(
            [
                double_single.subtract(servicer.r_SN_N, low[0], truth.r_TN_N, true_low[0]) - truth.r_ST_N,
                double_single.subtract(servicer.v_SN_N, low[1], truth.v_TN_N, true_low[1]) - truth.v_ST_N,
            ]
        ),
        jnp.concatenate([relative.r_TS_N + truth.r_ST_N, relative.v_TS_N + truth.v_ST_N]),
    )
