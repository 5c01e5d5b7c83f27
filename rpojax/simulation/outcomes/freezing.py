"""Freezing of a run that becomes non-finite or enters the keep-out sphere."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from rpojax.core.numerics import gradient_safe
from rpojax.core.pytree import replace, select
from rpojax.scenario.params import Params
from rpojax.simulation.outcomes.outcome_kinds import Outcome
from rpojax.simulation.state import State

Scalar = Float[Array, ""]


def freeze_if_failed(params: Params, before: State, after: State, time: Scalar) -> State:
    """State after a tick; a run that fails in this tick or has failed before keeps the state `before` it.

    A run fails if its state becomes non-finite or the servicer enters the keep-out sphere.
    """
    finite = gradient_safe.is_finite(_finiteness_witnesses(after))
    inside = jnp.sum(after.truth.r_ST_N**2, axis=0) < params.limits.keep_out**2
    entered = jnp.where(inside, Outcome.KEEP_OUT.code, Outcome.COMPLETED.code)
    code = jnp.where(~finite, Outcome.NON_FINITE.code, entered).astype(jnp.int32)
    was_running = before.failure == 0
    running = was_running & (code == 0)
    kept = select(running, after, replace(before, keys=after.keys))
    return replace(
        kept,
        failure=jnp.where(was_running, code, before.failure),
        failed_at=jnp.where(was_running & (code != 0), time, before.failed_at),
        tick=before.tick,
        keys=before.keys,
    )


def _finiteness_witnesses(state: State) -> tuple[object, ...]:
    """Part of a state that becomes non-finite whenever any number of the state does.

    Covariances are represented by their traces, which any other element enters within one update and prediction.
    """
    flight = state.flight
    estimates = (flight.orbit.servicer, flight.orbit.relative, flight.attitude)
    traces = [sum(each.covariance[i, i] for i in range(each.covariance.shape[0])) for each in estimates]
    return (
        state.truth,
        flight.plan,
        *(replace(each, covariance=trace) for each, trace in zip(estimates, traces, strict=True)),
    )
