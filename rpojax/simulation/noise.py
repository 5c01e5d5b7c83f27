"""The random numbers of a run: those of the start and those of every tick, drawn from the run's keys in one place.

`init` and `tick` take such a record instead where somebody else chooses the numbers.
"""

from collections.abc import Sequence

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, UInt32

from rpojax.core import random
from rpojax.core.materialise import materialise
from rpojax.core.pytree import pytree
from rpojax.core.random import Stream
from rpojax.sensors import statistical_camera
from rpojax.simulation.scenario import Scenario

_START = 0x7FFFFFFF
"""Number of the draws before the first tick; ticks count from 0."""


@pytree
class StartNoise:
    """Standard normal numbers that a run starts from.

    Attributes:
        biases: (6,) GPS error in N and gyro bias in B
        box_edges: (4,) lasting errors of the statistical camera, None for other cameras
        handover: (12,) errors of the first orbit estimate
        star_tracker: (3,)
        gyro: (3,)
    """

    biases: Array
    box_edges: Array | None
    handover: Array
    star_tracker: Array
    gyro: Array


@pytree
class TickNoise:
    """Random numbers of one tick, standard normal but for the uniform ones.

    Attributes:
        gps: (3,)
        star_tracker: (3,)
        gyro: (substeps, 3)
        box: (5,) of the camera; the geometric one takes four, one for each edge
        chances: (7,) of the camera, uniform in [0, 1)
        burn: (4,) execution error, zero unless a burn is decided
        chamber_pressure: ()
        biases: (6,) by which GPS error and gyro bias go on
        box_edges: (4,) by which the statistical camera's lasting errors go on, None for other cameras
    """

    gps: Array
    star_tracker: Array
    gyro: Array
    box: Array
    chances: Array
    burn: Array
    chamber_pressure: Array
    biases: Array
    box_edges: Array | None


def camera_key(keys: Array, tick: Array) -> Array:
    """Random key of the exposure of one tick, from the (streams, 2) keys of a run."""
    return random.fold_in(keys[Stream.BOX_CAMERA], tick)


def burn_normals(keys: Array, tick: Array) -> Float[Array, "4"]:
    """Numbers of the execution error of a burn decided at one tick, from the (streams, 2) keys of a run."""
    return random.normal(random.fold_in(keys[Stream.THRUSTER], tick), 4)


def draw_start(scenario: Scenario, keys: Array) -> StartNoise:
    """Numbers of the start, from the (streams, 2) keys of a run."""
    lasting = scenario.camera_model == "statistical"
    numbers = jnp.array([_START, _START, _START - 1], dtype=jnp.uint32)
    owners = [Stream.STAR_TRACKER, Stream.SENSOR_BIAS, Stream.SENSOR_BIAS]
    own = random.fold_in_each(random.rows(keys, owners), numbers)
    counts = [6, 6, 4]
    samples, biases, box_edges = _shares(random.normal_each(own, counts), counts)
    return StartNoise(
        biases=biases,
        box_edges=box_edges if lasting else None,
        handover=random.normal(keys[Stream.HANDOVER], 12),
        star_tracker=samples[:3],
        gyro=samples[3:],
    )


def draw(scenario: Scenario, keys: Array, tick: Array) -> TickNoise:
    """Numbers of one tick, from the (streams, 2) keys of a run.

    All in one go: written out for every stream, the generator would be a seventh of the loop's program.
    """
    own = _tick_keys(keys, tick)
    lasting = scenario.camera_model == "statistical"
    of_first = [3, 0, 3 * scenario.substeps, statistical_camera.NORMALS, 4, 6, 1]
    of_second = [3, 0, 4 if lasting else 0]
    counts = of_first + of_second
    second_of_camera = own[len(_FIRST) + _SECOND.index(Stream.BOX_CAMERA)]
    normals, chances = materialise(
        (random.normal_each(own, counts), random.uniform(second_of_camera, statistical_camera.UNIFORMS)), tick
    )
    gps, _, gyro, box, burn, biases, chamber_pressure, star_tracker, _, box_edges = _shares(normals, counts)
    return TickNoise(
        gps=gps,
        star_tracker=star_tracker,
        gyro=gyro.reshape(scenario.substeps, 3),
        box=box,
        chances=chances,
        burn=jnp.where(tick % scenario.formation_ticks == 0, burn, 0.0),
        chamber_pressure=chamber_pressure[0],
        biases=biases,
        box_edges=box_edges if lasting else None,
    )


_FIRST = (
    *(Stream.GPS, Stream.STAR_TRACKER, Stream.GYRO, Stream.BOX_CAMERA, Stream.THRUSTER, Stream.SENSOR_BIAS),
    Stream.CHAMBER_PRESSURE,
)
"""Streams that a tick has a key of."""

_SECOND = (Stream.STAR_TRACKER, Stream.BOX_CAMERA, Stream.SENSOR_BIAS)
"""Those with two kinds of numbers: a second key is derived from the first."""


def _tick_keys(keys: Array, tick: Array) -> UInt32[Array, "n 2"]:
    """Keys of a tick: the first ones, and after them the second ones.

    Stored, since each of them feeds many numbers: the rounds that make it would be run again for every one.
    """
    ahead = np.array([stream == Stream.SENSOR_BIAS for stream in _FIRST], dtype=np.uint32)  # those of the tick's end
    ticks = tick.astype(jnp.uint32) + ahead
    first = materialise(random.fold_in_each(random.rows(keys, _FIRST), ticks), tick)
    again = random.rows(first, [_FIRST.index(stream) for stream in _SECOND])
    second = random.fold_in_each(again, jnp.ones(len(_SECOND), dtype=jnp.uint32))
    return materialise(jnp.concatenate([first, second]), tick)


def _shares(numbers: Array, counts: Sequence[int]) -> list[Array]:
    """The numbers of each key, of which there are so many."""
    ends = np.cumsum(counts).tolist()
    return [numbers[end - count : end] for count, end in zip(counts, ends, strict=True)]
