"""Random numbers of a tick and of the initial state, each from its own stream."""

import dataclasses
import zlib

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from rpojax.core import random_streams
from rpojax.core.random_streams import Stream
from rpojax.scenario.static_settings import Scenario
from rpojax.sensors.additional.landmark_camera import MOST, LandmarkCamera
from rpojax.sensors.additional.range_finder import RangeFinder
from rpojax.simulation import noise

INITIAL_TICK = 0x7FFFFFFF
draw_tick_noise = jax.jit(noise.draw_tick_noise, static_argnums=0)
draw_initial_noise = jax.jit(noise.draw_initial_noise, static_argnums=0)
fold_in = jax.jit(random_streams.fold_in)
normal = jax.jit(random_streams.normal, static_argnums=1)
uniform = jax.jit(random_streams.uniform, static_argnums=1)


@pytest.fixture(scope="module")
def keys() -> jax.Array:
    """Keys of the streams of a run by stream number."""
    return jnp.stack([fold_in(random_streams.master_key(11), stream) for stream in range(len(Stream) + 1)])


@pytest.mark.parametrize("model", ["geometric", "statistical"])
@pytest.mark.parametrize("tick", [0, 7, 200])
def test_numbers_of_a_tick_come_from_their_streams(
    inspection: Scenario, keys: jax.Array, tick: int, model: str
) -> None:
    scenario = dataclasses.replace(inspection, camera_model=model, additional_sensors=(("range_finder", RangeFinder),))
    drawn = draw_tick_noise(scenario, keys, jnp.asarray(tick, dtype=jnp.int32))
    now = {stream: fold_in(keys[stream], tick) for stream in Stream}
    sensor = fold_in(keys[Stream.ADDITIONAL_SENSORS], zlib.crc32(b"range_finder") & 0x7FFFFFFF)
    later = fold_in(keys[Stream.SENSOR_BIAS], tick + 1)
    expected = {
        "gps": normal(now[Stream.GPS], 3),
        "star_tracker": normal(fold_in(now[Stream.STAR_TRACKER], 1), 3),
        "gyro": normal(now[Stream.GYRO], 3 * scenario.substeps).reshape(-1, 3),
        "camera": normal(now[Stream.BOX_CAMERA], 5),
        "uniforms": uniform(fold_in(now[Stream.BOX_CAMERA], 1), 7),
        "burn": normal(now[Stream.THRUSTER], 4),
        "chamber_pressure": normal(now[Stream.CHAMBER_PRESSURE], 1)[0],
        "biases": normal(later, 6),
        "box_edge_errors": normal(fold_in(later, 1), 4) if model == "statistical" else None,
        "landmark_errors": None,
    }
    assert {*expected, "additional", "thrusters", "pressures_at_rest", "delays"} == {
        field.name for field in dataclasses.fields(drawn)
    }
    assert drawn.thrusters is drawn.pressures_at_rest is None
    assert drawn.delays == {}
    assert set(drawn.additional) == {"range_finder"}
    np.testing.assert_array_equal(drawn.additional["range_finder"], normal(fold_in(sensor, tick), 1))
    for name, values in expected.items():
        np.testing.assert_array_equal(getattr(drawn, name), values, err_msg=name)


def test_statistical_landmarks_have_numbers_of_their_own_that_change_no_other(
    inspection: Scenario, keys: jax.Array
) -> None:
    seen = dataclasses.replace(inspection, additional_sensors=(("landmarks", LandmarkCamera),))
    by_model = {
        model: draw_tick_noise(dataclasses.replace(seen, camera_model=model), keys, jnp.asarray(5))
        for model in ("geometric", "statistical", "rendered")
    }
    drawn = by_model["statistical"].landmark_errors
    sensor = fold_in(keys[Stream.ADDITIONAL_SENSORS], zlib.crc32(b"landmark_errors") & 0x7FFFFFFF)
    np.testing.assert_array_equal(drawn, normal(fold_in(sensor, 5), 3 * MOST + 1))
    for model in ("geometric", "rendered"):
        assert by_model[model].landmark_errors is None
        np.testing.assert_array_equal(by_model[model].gps, by_model["statistical"].gps)
        np.testing.assert_array_equal(
            by_model[model].additional["landmarks"], by_model["statistical"].additional["landmarks"]
        )


def test_thrusters_have_numbers_of_thrust_and_pressure_that_change_no_other(
    inspection: Scenario, keys: jax.Array
) -> None:
    with_thrusters, without = (
        draw_tick_noise(dataclasses.replace(inspection, thrusters=count), keys, jnp.asarray(5)) for count in (3, 0)
    )
    assert with_thrusters.thrusters is not None
    assert with_thrusters.thrusters.shape == (6,)
    np.testing.assert_array_equal(with_thrusters.burn, without.burn)
    np.testing.assert_array_equal(with_thrusters.gyro, without.gyro)


def test_pressures_at_rest_have_numbers_of_their_own_that_change_no_other(
    inspection: Scenario, keys: jax.Array
) -> None:
    watched, without = (
        draw_tick_noise(dataclasses.replace(inspection, thrusters=3, isolation=each), keys, jnp.asarray(5))
        for each in (True, False)
    )
    assert without.pressures_at_rest is None
    assert watched.pressures_at_rest is not None
    assert watched.pressures_at_rest.shape == (inspection.substeps, 3)
    assert len(np.unique(np.concatenate([watched.pressures_at_rest.ravel(), watched.thrusters]))) == 15 + 6
    np.testing.assert_array_equal(watched.thrusters, without.thrusters)


def test_numbers_of_the_initial_state_come_from_their_streams(inspection: Scenario, keys: jax.Array) -> None:
    drawn = draw_initial_noise(dataclasses.replace(inspection, camera_model="statistical"), keys)
    samples = normal(fold_in(keys[Stream.STAR_TRACKER], INITIAL_TICK), 6)
    np.testing.assert_array_equal(drawn.star_tracker, samples[:3])
    np.testing.assert_array_equal(drawn.gyro, samples[3:])
    np.testing.assert_array_equal(drawn.biases, normal(fold_in(keys[Stream.SENSOR_BIAS], INITIAL_TICK), 6))
    np.testing.assert_array_equal(drawn.box_edge_errors, normal(fold_in(keys[Stream.SENSOR_BIAS], INITIAL_TICK - 1), 4))
    np.testing.assert_array_equal(drawn.handover, normal(keys[Stream.HANDOVER], 12))
    assert draw_initial_noise(inspection, keys).box_edge_errors is None
