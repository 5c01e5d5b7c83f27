"""Random streams: a run's draws depend on the master seed, the run's number and the stream's name alone."""

import enum
from typing import cast

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, UInt32

Key = UInt32[Array, "2"]


class Stream(enum.IntEnum):
    """Fixed numbers of the random streams; new streams get new numbers, so that old results stay as they are."""

    DISPERSION = 1
    HANDOVER = 2
    GPS = 3
    STAR_TRACKER = 4
    GYRO = 5
    BOX_CAMERA = 6
    THRUSTER = 7
    SENSOR_BIAS = 8
    CHAMBER_PRESSURE = 9


def master_key(seed: int) -> Key:
    """Key of a campaign. Threefry always: under `vmap` other generators give a run other numbers than alone."""
    return jax.random.key_data(jax.random.key(seed, impl="threefry2x32"))


def fold_in(key: Key, number: int | Array) -> Key:
    """Key derived from `key` by an integer: a run's number, a stream, a tick."""
    return jax.random.key_data(jax.random.fold_in(jax.random.wrap_key_data(key, impl="threefry2x32"), number))


def normal(key: Key, count: int) -> Float[Array, " {count}"]:
    """Standard normal numbers, drawn in float32 (plenty for noise, at half the cost) and returned in float64."""
    typed = jax.random.wrap_key_data(key, impl="threefry2x32")
    return jax.random.normal(typed, (count,), dtype=jnp.float32).astype(jnp.float64)


def uniform(key: Key, count: int) -> Float[Array, " {count}"]:
    """Numbers uniform in [0, 1), drawn in float32 and returned in float64."""
    typed = jax.random.wrap_key_data(key, impl="threefry2x32")
    return cast(Array, jax.random.uniform(typed, (count,), dtype=jnp.float32)).astype(jnp.float64)
