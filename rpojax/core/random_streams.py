"""Random number streams: the numbers of a run depend on master seed, run id and stream alone."""

import enum
from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, UInt32

Key = UInt32[Array, "2"]
Keys = UInt32[Array, "n 2"]


class Stream(enum.IntEnum):
    """Fixed numbers of the random streams; a new stream gets a new number, so that earlier results do not change."""

    DISPERSION = 1
    HANDOVER = 2
    GPS = 3
    STAR_TRACKER = 4
    GYRO = 5
    BOX_CAMERA = 6
    THRUSTER = 7
    SENSOR_BIAS = 8
    CHAMBER_PRESSURE = 9
    ADDITIONAL_SENSORS = 10
    SERVICER = 11
    LINK = 12
    GPS_DIFFERENCES = 13
    LINK_RANGE = 14


def master_key(seed: int) -> Key:
    """Key of a campaign. Always threefry: other generators give a run other numbers under `vmap` than alone."""
    return jax.random.key_data(jax.random.key(seed, impl="threefry2x32"))


def fold_in(key: Key, number: int | Array) -> Key:
    """Key derived from `key` by an integer, such as a run id, a stream or a tick."""
    zero = jnp.zeros((), dtype=jnp.uint32)
    return jnp.stack(_threefry(key, zero, jnp.asarray(number).astype(jnp.uint32)))


def select_keys(keys: Keys, indices: Sequence[int] | np.ndarray) -> UInt32[Array, "m 2"]:
    """The keys at some indices, which may repeat."""
    return keys.at[np.asarray(indices, dtype=np.int32)].get(mode="promise_in_bounds")


def fold_in_per_key(keys: Keys, numbers: UInt32[Array, " n"]) -> Keys:
    """`fold_in` of each key with its own number."""
    return jnp.stack(_threefry(keys.T, jnp.zeros_like(numbers), numbers), axis=1)


def normal(key: Key, count: int) -> Float[Array, " {count}"]:
    """Standard normal numbers, drawn in float32 (precise enough for noise, at half the cost), returned in float64."""
    return normal_per_key(key[None], [count])


def uniform(key: Key, count: int) -> Float[Array, " {count}"]:
    """Uniform numbers in [0, 1), drawn in float32, returned in float64."""
    return _uniform_per_key(key[None], [count]).astype(jnp.float64)


def normal_per_key(keys: Keys, counts: Sequence[int]) -> Float[Array, " total"]:
    """The numbers that `normal` draws from each of several keys, concatenated."""
    u = jnp.maximum(_SMALLEST_UNIFORM, _uniform_per_key(keys, counts) * (1.0 - _SMALLEST_UNIFORM) + _SMALLEST_UNIFORM)
    return (np.float32(np.sqrt(2.0)) * jax.lax.erf_inv(u)).astype(jnp.float64)


_SMALLEST_UNIFORM = np.nextafter(np.float32(-1.0), np.float32(0.0))
"""Smallest float32 number whose inverse error function is finite."""

_ROTATIONS = ((13, 15, 26, 6), (17, 29, 16, 24))
"""Rotation distances of the threefry rounds [bit]."""


def _uniform_per_key(keys: Keys, counts: Sequence[int]) -> Float[Array, " total"]:
    """Uniform numbers in [0, 1) from the leading 23 of 32 random bits."""
    if len(counts) != keys.shape[0]:
        raise ValueError(f"counts: found {len(counts)}, expected one for each of {keys.shape[0]} keys")
    counter = jnp.asarray(np.concatenate([np.arange(count, dtype=np.uint32) for count in counts]))
    # A single key broadcasts and need not be repeated.
    key_columns = keys.T if len(counts) == 1 else select_keys(keys, np.repeat(np.arange(len(counts)), counts)).T
    first, second = _threefry(key_columns, jnp.zeros_like(counter), counter)
    mantissa = ((first ^ second) >> np.uint32(9)) | np.uint32(0x3F800000)
    return jax.lax.bitcast_convert_type(mantissa, jnp.float32) - np.float32(1.0)


def _threefry(key: UInt32[Array, "2 ..."], x: Array, y: Array) -> tuple[Array, Array]:
    """Threefry-2x32 of a block (Salmon et al., Parallel random numbers: as easy as 1, 2, 3, 2011); equal to JAX's.

    `key` holds the halves of one key, or of one for each number. On a CPU JAX runs the twenty rounds as loops of small
    steps; unrolled they compile to one loop over all runs.
    """
    schedule = (key[0], key[1], key[0] ^ key[1] ^ np.uint32(0x1BD11BDA))
    x, y = x + schedule[0], y + schedule[1]
    for group in range(5):
        for turn in _ROTATIONS[group % 2]:
            x = x + y
            y = ((y << np.uint32(turn)) | (y >> np.uint32(32 - turn))) ^ x
        x, y = x + schedule[(group + 1) % 3], y + schedule[(group + 2) % 3] + np.uint32(group + 1)
    return x, y
