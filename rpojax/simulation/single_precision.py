"""Simulation in single precision, with orbits as double-single numbers; the initial state is computed in double."""

import contextlib
import warnings
from collections.abc import Iterator
from typing import Any, TypeVar

import jax
import jax.numpy as jnp
from jaxtyping import Array

from rpojax.core.pytree import replace
from rpojax.simulation.state import State

T = TypeVar("T")


@contextlib.contextmanager
def tracing_in_single() -> Iterator[None]:
    """Context in which functions are traced in single precision, also where they ask for double."""
    with jax.enable_x64(False), warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="Explicitly requested dtype", category=UserWarning)
        yield


def round_to_single(tree: T) -> T:
    """The pytree with its floating-point numbers rounded to single precision."""

    def leaf(value: Any) -> Any:
        return value.astype(jnp.float32) if jnp.issubdtype(value.dtype, jnp.floating) else value

    return jax.tree.map(leaf, tree)


def round_state_to_single(state: State) -> State:
    """The state in single precision, with the low-order parts of the orbits of truth and filter."""
    truth, orbit = state.truth, state.flight.orbit
    servicer = orbit.servicer
    after = round_to_single(state)
    return replace(
        after,
        truth=replace(
            after.truth,
            orbit_low=_low_part(truth.r_TN_N, truth.v_TN_N),
            # Zero, because the plant counts the propellant from the rounded mass in `Params`.
            mass_low=jnp.zeros_like(after.truth.mass),
        ),
        flight=replace(
            after.flight,
            orbit=replace(
                after.flight.orbit,
                servicer=replace(after.flight.orbit.servicer, orbit_low=_low_part(servicer.r_SN_N, servicer.v_SN_N)),
            ),
        ),
    )


def _low_part(r_N: Array, v_N: Array) -> Array:
    orbit = jnp.stack([r_N, v_N])
    # XLA may remove a conversion to single precision and back.
    kept = jax.lax.reduce_precision(orbit, exponent_bits=8, mantissa_bits=23)
    return (orbit - kept).astype(jnp.float32)
