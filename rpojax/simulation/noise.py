"""The random numbers of a run: those of the start and those of every tick, drawn from the run's keys in one place.

`init` and `tick` take such a record instead where somebody else chooses the numbers.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

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
    samples = random.normal(random.fold_in(keys[Stream.STAR_TRACKER], _START), 6)
    lasting = scenario.camera_model == "statistical"
    return StartNoise(
        biases=random.normal(random.fold_in(keys[Stream.SENSOR_BIAS], _START), 6),
        box_edges=random.normal(random.fold_in(keys[Stream.SENSOR_BIAS], _START - 1), 4) if lasting else None,
        handover=random.normal(keys[Stream.HANDOVER], 12),
        star_tracker=samples[:3],
        gyro=samples[3:],
    )


def draw(scenario: Scenario, keys: Array, tick: Array) -> TickNoise:
    """Numbers of one tick, from the (streams, 2) keys of a run."""
    first, second = _tick_keys(keys, tick)
    lasting = scenario.camera_model == "statistical"
    drawn = TickNoise(
        gps=random.normal(first[Stream.GPS], 3),
        star_tracker=random.normal(second[Stream.STAR_TRACKER], 3),
        gyro=random.normal(first[Stream.GYRO], 3 * scenario.substeps).reshape(scenario.substeps, 3),
        box=random.normal(first[Stream.BOX_CAMERA], statistical_camera.NORMALS),
        chances=random.uniform(second[Stream.BOX_CAMERA], statistical_camera.UNIFORMS),
        # The tick is the same for all runs of a batch, so this is a true branch.
        burn=jax.lax.cond(
            tick % scenario.formation_ticks == 0,
            lambda: burn_normals(keys, tick),
            lambda: jnp.zeros(4, dtype=jnp.float64),
        ),
        chamber_pressure=random.normal(first[Stream.CHAMBER_PRESSURE], 1)[0],
        biases=random.normal(first[Stream.SENSOR_BIAS], 6),
        box_edges=random.normal(second[Stream.SENSOR_BIAS], 4) if lasting else None,
    )
    return materialise(drawn, tick)


def _tick_keys(keys: Array, tick: Array) -> tuple[dict[Stream, Array], dict[Stream, Array]]:
    """Keys of the streams at a tick, and those derived from them where a stream has two kinds of numbers.

    Stored, since each of them feeds many numbers: the rounds that make it would be run again for every one.
    """
    now = {
        Stream.GPS: tick,
        Stream.STAR_TRACKER: tick,
        Stream.GYRO: tick,
        Stream.BOX_CAMERA: tick,
        Stream.CHAMBER_PRESSURE: tick,
        Stream.SENSOR_BIAS: tick + 1,
    }
    first = materialise({stream: random.fold_in(keys[stream], number) for stream, number in now.items()}, tick)
    twice = (Stream.STAR_TRACKER, Stream.BOX_CAMERA, Stream.SENSOR_BIAS)
    return first, materialise({stream: random.fold_in(first[stream], 1) for stream in twice}, tick)
