"""Random numbers of a run, for its initial state and for every tick, from the random keys of the run."""

import zlib
from collections.abc import Sequence
from dataclasses import field

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, UInt32

from rpojax.core import random_streams
from rpojax.core.numerics.fusion_barrier import fusion_barrier
from rpojax.core.pytree import pytree
from rpojax.core.random_streams import Stream
from rpojax.scenario.static_settings import Scenario
from rpojax.sensors import statistical_camera, statistical_landmarks
from rpojax.sensors.additional import landmark_camera

INITIAL_TICK = 0x7FFFFFFF
"""Tick number of the random numbers of the initial state: the greatest of 31 bits, which no run reaches."""


@pytree
class InitialNoise:
    """Standard normal numbers of an initial state.

    Attributes:
        biases: (6,) of the GPS error in N and the gyro bias in B
        box_edge_errors: (4,) of the statistical camera's correlated errors, None for other cameras
        handover: (12,) of the initial orbit estimate
        star_tracker: (3,)
        gyro: (3,)
        landmark_errors: (m,) of the statistical camera's landmarks, None without any
    """

    biases: Array
    box_edge_errors: Array | None
    handover: Array
    star_tracker: Array
    gyro: Array
    landmark_errors: Array | None = None


@pytree
class TickNoise:
    """Random numbers of one tick, standard normal except `uniforms` and `delays`.

    Attributes:
        gps: (3,)
        star_tracker: (3,)
        gyro: (substeps, 3)
        camera: (5,) of which the geometric camera uses four, one for each edge
        uniforms: (7,) of the camera, uniform in [0, 1)
        burn: (4,) execution error of a burn planned in this tick
        chamber_pressure: ()
        biases: (6,) driving noise of the GPS error in N and the gyro bias in B
        box_edge_errors: (4,) driving noise of the statistical camera's correlated errors, None for other cameras
        additional: (n,) of each additional sensor, by name
        thrusters: (2 n,) of the thrust and the chamber pressures of the reaction control system, None without one
        delays: () of the delay of each sensor with late measurements, uniform in [0, 1), by name
        pressures_at_rest: (substeps, n) of those pressures while no pulse is commanded, None where none is watched
        landmark_errors: (m,) driving noise of the errors of the statistical camera's landmarks, None without any
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
    additional: dict[str, Array] = field(default_factory=dict)
    thrusters: Array | None = None
    delays: dict[str, Array] = field(default_factory=dict)
    pressures_at_rest: Array | None = None
    landmark_errors: Array | None = None


_fold_in = jax.jit(random_streams.fold_in, inline=True)
_fold_in_each = jax.jit(jax.vmap(random_streams.fold_in, in_axes=(None, 0)))


def run_key(seed: int, run_id: int | Array) -> Array:
    """Random key of run `run_id` of a campaign."""
    return _fold_in(random_streams.master_key(seed), run_id)


def run_keys(seed: int, ids: np.ndarray) -> np.ndarray:
    """Random keys (runs, 2) of the runs of a campaign with a given seed."""
    return np.asarray(_fold_in_each(random_streams.master_key(seed), np.asarray(ids)))


def camera_key(keys: Array, tick: Array) -> Array:
    """Random key of the image noise of one tick, from the (streams, 2) keys of a run."""
    return random_streams.fold_in(keys[Stream.BOX_CAMERA], tick)


def draw_initial_noise(scenario: Scenario, keys: Array) -> InitialNoise:
    """Random numbers of the initial state, from the (streams, 2) keys of a run."""
    correlated = scenario.camera_model == "statistical"
    ticks = jnp.array([INITIAL_TICK, INITIAL_TICK, INITIAL_TICK - 1], dtype=jnp.uint32)
    streams = [Stream.STAR_TRACKER, Stream.SENSOR_BIAS, Stream.SENSOR_BIAS]
    stream_keys = random_streams.fold_in_per_key(random_streams.select_keys(keys, streams), ticks)
    counts = [6, 6, 4 if correlated else 0]
    sensor_normals, biases, box_edge_errors = _split_by_counts(
        random_streams.normal_per_key(stream_keys, counts), counts
    )
    return InitialNoise(
        biases=biases,
        box_edge_errors=box_edge_errors if correlated else None,
        handover=random_streams.normal(keys[Stream.HANDOVER], 12),
        star_tracker=sensor_normals[:3],
        gyro=sensor_normals[3:],
        landmark_errors=_landmark_normals(scenario, keys, jnp.asarray(INITIAL_TICK)),
    )


_FIRST, _SECOND = 0, 1
"""Key of a stream at a tick, and a key derived from it for streams with two kinds of numbers."""

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
"""Keys of a tick, all first ones before the second ones."""


def draw_tick_noise(scenario: Scenario, keys: Array, tick: Array) -> TickNoise:
    """Random numbers of one tick, from the (streams, 2) keys of a run.

    One call of the generator, which XLA unrolls, draws all streams; one call for each stream would be a seventh of all
    compiled instructions.
    """
    correlated = scenario.camera_model == "statistical"
    counts = {
        (Stream.GPS, _FIRST): 3,
        (Stream.GYRO, _FIRST): 3 * scenario.substeps,
        (Stream.BOX_CAMERA, _FIRST): statistical_camera.NORMALS_PER_FRAME,
        (Stream.THRUSTER, _FIRST): 4,
        (Stream.SENSOR_BIAS, _FIRST): 6,
        (Stream.CHAMBER_PRESSURE, _FIRST): 1,
        (Stream.STAR_TRACKER, _SECOND): 3,
        (Stream.SENSOR_BIAS, _SECOND): 4 if correlated else 0,
    }
    tick_keys, row_counts = _tick_keys(keys, tick), [counts.get(row, 0) for row in _KEY_ROWS]
    uniforms_key = tick_keys[_KEY_ROWS.index((Stream.BOX_CAMERA, _SECOND))]
    drawn_normals, uniforms = fusion_barrier(
        (
            random_streams.normal_per_key(tick_keys, row_counts),
            random_streams.uniform(uniforms_key, statistical_camera.UNIFORMS_PER_FRAME),
        ),
        tick,
    )
    normals = dict(zip(_KEY_ROWS, _split_by_counts(drawn_normals, row_counts), strict=True))
    return TickNoise(
        gps=normals[Stream.GPS, _FIRST],
        star_tracker=normals[Stream.STAR_TRACKER, _SECOND],
        gyro=normals[Stream.GYRO, _FIRST].reshape(scenario.substeps, 3),
        camera=normals[Stream.BOX_CAMERA, _FIRST],
        uniforms=uniforms,
        burn=normals[Stream.THRUSTER, _FIRST],
        chamber_pressure=normals[Stream.CHAMBER_PRESSURE, _FIRST][0],
        biases=normals[Stream.SENSOR_BIAS, _FIRST],
        box_edge_errors=normals[Stream.SENSOR_BIAS, _SECOND] if correlated else None,
        additional={
            name: _sensor_normals(name, sensor.normals, keys, tick) for name, sensor in scenario.additional_sensors
        },
        thrusters=_sensor_normals("thrusters", 2 * scenario.thrusters, keys, tick) if scenario.thrusters else None,
        delays={name: _delay_uniform(name, keys, tick) for name in scenario.delays.sensors} if scenario.delays else {},
        pressures_at_rest=_pressure_normals(scenario, keys, tick) if scenario.isolation else None,
        landmark_errors=_landmark_normals(scenario, keys, tick),
    )


def _landmark_normals(scenario: Scenario, keys: Array, tick: Array) -> Array | None:
    """Standard normal numbers of the lasting errors of landmarks at a tick, None unless they are of statistics."""
    if not (scenario.has_landmarks and scenario.camera_model == "statistical"):
        return None
    return _sensor_normals("landmark_errors", statistical_landmarks.normal_count(landmark_camera.MOST), keys, tick)


def _pressure_normals(scenario: Scenario, keys: Array, tick: Array) -> Array:
    """Standard normal numbers (substeps, n) of the chamber pressures of the reaction control system in a tick."""
    drawn = _sensor_normals("pressures_at_rest", scenario.substeps * scenario.thrusters, keys, tick)
    return drawn.reshape(scenario.substeps, scenario.thrusters)


def _sensor_normals(name: str, count: int, keys: Array, tick: Array) -> Array:
    """Standard normal numbers of an additional sensor at a tick, from a key that depends on its name."""
    return random_streams.normal(_key_by_name(name, keys, tick), count)


def _delay_uniform(name: str, keys: Array, tick: Array) -> Array:
    """Uniform number () of the delay of a sensor's measurement at a tick."""
    return random_streams.uniform(_key_by_name(f"delay of {name}", keys, tick), 1)[0]


def _key_by_name(name: str, keys: Array, tick: Array) -> Array:
    key = random_streams.fold_in(keys[Stream.ADDITIONAL_SENSORS], zlib.crc32(name.encode()) & 0x7FFFFFFF)
    return random_streams.fold_in(key, tick)


def _tick_keys(keys: Array, tick: Array) -> UInt32[Array, "n 2"]:
    """Keys of a tick in the order of `_KEY_ROWS`.

    The barriers store them, or XLA would recompute a key for each number drawn from it.
    """
    first = [stream for stream, which in _KEY_ROWS if which == _FIRST]
    second = [stream for stream, which in _KEY_ROWS if which == _SECOND]
    # Sensor biases are propagated to the end of the tick and use its number.
    ahead = np.array([stream == Stream.SENSOR_BIAS for stream in first], dtype=np.uint32)
    ticks = tick.astype(jnp.uint32) + ahead
    first_keys = fusion_barrier(random_streams.fold_in_per_key(random_streams.select_keys(keys, first), ticks), tick)
    parent_keys = random_streams.select_keys(first_keys, [first.index(stream) for stream in second])
    second_keys = random_streams.fold_in_per_key(parent_keys, jnp.ones(len(second), dtype=jnp.uint32))
    return fusion_barrier(jnp.concatenate([first_keys, second_keys]), tick)


def _split_by_counts(numbers: Array, counts: Sequence[int]) -> list[Array]:
    """Consecutive parts of `numbers` with the given lengths."""
    ends = np.cumsum(counts).tolist()
    return [numbers[end - count : end] for count, end in zip(counts, ends, strict=True)]
