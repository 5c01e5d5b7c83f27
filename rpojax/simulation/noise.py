"""The random numbers of a run: those of the start and those of every tick, drawn from the run's keys in one place.

`init` and `tick` take such a record instead where somebody else chooses the numbers.
"""

from collections.abc import Sequence

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, UInt32

from rpojax.core import random_streams
from rpojax.core.numerics.fusion_barrier import fusion_barrier
from rpojax.core.pytree import pytree
from rpojax.core.random_streams import Stream
from rpojax.scenario.scenario_file import Scenario
from rpojax.sensors import statistical_camera

_INITIAL_TICK = 0x7FFFFFFF
"""Number of the draws before the first tick; ticks count from 0."""


@pytree
class InitialNoise:
    """Standard normal numbers that a run starts from.

    Attributes:
        biases: (6,) GPS error in N and gyro bias in B
        box_edges: (4,) lasting errors of the statistical camera, None for other cameras
        handover: (12,) errors of the first orbit estimate
        star_tracker: (3,)
        gyro: (3,)
    """

    biases: Array
    box_edge_errors: Array | None
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
        burn: (4,) execution error of a burn that is decided now
        chamber_pressure: ()
        biases: (6,) by which GPS error and gyro bias go on
        box_edges: (4,) by which the statistical camera's lasting errors go on, None for other cameras
    """

    gps: Array
    star_tracker: Array
    gyro: Array
    camera: Array
    uniforms: Array
    burn: Array
    chamber_pressure: Array
    biases: Array
    box_edge_errors: Array | None


def camera_key(keys: Array, tick: Array) -> Array:
    """Random key of the exposure of one tick, from the (streams, 2) keys of a run."""
    return random_streams.fold_in(keys[Stream.BOX_CAMERA], tick)


def draw_initial_noise(scenario: Scenario, keys: Array) -> InitialNoise:
    """Numbers of the start, from the (streams, 2) keys of a run."""
    lasting = scenario.camera_model == "statistical"
    numbers = jnp.array([_INITIAL_TICK, _INITIAL_TICK, _INITIAL_TICK - 1], dtype=jnp.uint32)
    owners = [Stream.STAR_TRACKER, Stream.SENSOR_BIAS, Stream.SENSOR_BIAS]
    own = random_streams.fold_in_per_key(random_streams.select_keys(keys, owners), numbers)
    counts = [6, 6, 4 if lasting else 0]
    samples, biases, box_edges = _split_by_counts(random_streams.normal_per_key(own, counts), counts)
    return InitialNoise(
        biases=biases,
        box_edge_errors=box_edges if lasting else None,
        handover=random_streams.normal(keys[Stream.HANDOVER], 12),
        star_tracker=samples[:3],
        gyro=samples[3:],
    )


_FIRST, _SECOND = 0, 1
"""Which key of a stream at a tick: one, and another derived from it where the stream has two kinds of numbers."""

_KEY_ROWS = (
    (Stream.GPS, _FIRST),
    (Stream.STAR_TRACKER, _FIRST),
    (Stream.GYRO, _FIRST),
    (Stream.BOX_CAMERA, _FIRST),
    (Stream.THRUSTER, _FIRST),
    (Stream.SENSOR_BIAS, _FIRST),
    (Stream.CHAMBER_PRESSURE, _FIRST),
    (Stream.STAR_TRACKER, _SECOND),
    (Stream.BOX_CAMERA, _SECOND),
    (Stream.SENSOR_BIAS, _SECOND),
)
"""The keys of a tick, all first ones before the second ones."""


def draw_tick_noise(scenario: Scenario, keys: Array, tick: Array) -> TickNoise:
    """Numbers of one tick, from the (streams, 2) keys of a run.

    Those of all streams together: the generator is written out, and written out for each of them it would be a seventh
    of the instructions that the compiler is given.
    """
    lasting = scenario.camera_model == "statistical"
    counts = {
        (Stream.GPS, _FIRST): 3,
        (Stream.GYRO, _FIRST): 3 * scenario.substeps,
        (Stream.BOX_CAMERA, _FIRST): statistical_camera.NORMALS_PER_FRAME,
        (Stream.THRUSTER, _FIRST): 4,
        (Stream.SENSOR_BIAS, _FIRST): 6,
        (Stream.CHAMBER_PRESSURE, _FIRST): 1,
        (Stream.STAR_TRACKER, _SECOND): 3,
        (Stream.SENSOR_BIAS, _SECOND): 4 if lasting else 0,
    }
    own, in_order = _tick_keys(keys, tick), [counts.get(row, 0) for row in _KEY_ROWS]
    chances_key = own[_KEY_ROWS.index((Stream.BOX_CAMERA, _SECOND))]
    numbers, chances = fusion_barrier(
        (
            random_streams.normal_per_key(own, in_order),
            random_streams.uniform(chances_key, statistical_camera.UNIFORMS_PER_FRAME),
        ),
        tick,
    )
    normals = dict(zip(_KEY_ROWS, _split_by_counts(numbers, in_order), strict=True))
    return TickNoise(
        gps=normals[Stream.GPS, _FIRST],
        star_tracker=normals[Stream.STAR_TRACKER, _SECOND],
        gyro=normals[Stream.GYRO, _FIRST].reshape(scenario.substeps, 3),
        camera=normals[Stream.BOX_CAMERA, _FIRST],
        uniforms=chances,
        burn=normals[Stream.THRUSTER, _FIRST],
        chamber_pressure=normals[Stream.CHAMBER_PRESSURE, _FIRST][0],
        biases=normals[Stream.SENSOR_BIAS, _FIRST],
        box_edge_errors=normals[Stream.SENSOR_BIAS, _SECOND] if lasting else None,
    )


def _tick_keys(keys: Array, tick: Array) -> UInt32[Array, "n 2"]:
    """Keys of a tick in the order of the rows.

    Stored, since each of them feeds many numbers: the rounds that make it would be run again for every one.
    """
    first = [stream for stream, which in _KEY_ROWS if which == _FIRST]
    second = [stream for stream, which in _KEY_ROWS if which == _SECOND]
    ahead = np.array([stream == Stream.SENSOR_BIAS for stream in first], dtype=np.uint32)  # those of the tick's end
    ticks = tick.astype(jnp.uint32) + ahead
    own = fusion_barrier(random_streams.fold_in_per_key(random_streams.select_keys(keys, first), ticks), tick)
    again = random_streams.select_keys(own, [first.index(stream) for stream in second])
    derived = random_streams.fold_in_per_key(again, jnp.ones(len(second), dtype=jnp.uint32))
    return fusion_barrier(jnp.concatenate([own, derived]), tick)


def _split_by_counts(numbers: Array, counts: Sequence[int]) -> list[Array]:
    """The numbers of each key, of which there are so many."""
    ends = np.cumsum(counts).tolist()
    return [numbers[end - count : end] for count, end in zip(counts, ends, strict=True)]
