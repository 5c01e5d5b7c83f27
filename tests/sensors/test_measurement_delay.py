"""Late measurements: each is had once, the oldest first, once it has arrived; a busy processor leaves some out."""

import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from rpojax.sensors import measurement_delay
from rpojax.sensors.measurement_delay import MeasurementDelay

TICK_S = 0.2
TICKS = 60


def delay_of(delay: float, jitter: float = 0.0, processing: float = 0.0, tag: float = 0.0) -> MeasurementDelay:
    return MeasurementDelay(
        delay=jnp.asarray(delay),
        delay_jitter=jnp.asarray(jitter),
        processing=jnp.asarray(processing),
        time_tag_error=jnp.asarray(tag),
    )


def slots_for(longest: float) -> int:
    return math.ceil(longest / TICK_S - 1e-9) + 2


def delivered(delay: MeasurementDelay, uniforms: np.ndarray, slots: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Number of the exposure, age by its time tag [s], and presence, tick by tick."""

    def tick(waiting, inputs):
        number, uniform = inputs
        waiting, delivery = measurement_delay.pass_through(
            waiting, delay, {"number": number.astype(float)}, number, uniform, TICK_S
        )
        return waiting, (delivery.measurement["number"], delivery.age, delivery.present)

    empty = measurement_delay.none_in_transit(slots, {"number": jnp.zeros(())}, jnp.zeros(()))
    _, found = jax.jit(lambda u: jax.lax.scan(tick, empty, (jnp.arange(len(u)), u)))(jnp.asarray(uniforms))
    return tuple(np.asarray(each) for each in found)


def reference(delay: float, jitter: float, processing: float, uniforms: np.ndarray) -> list[int | None]:
    """The same by a list of (exposure, arrival), without slots."""
    waiting, found, free_at = [], [], 0.0
    for number, uniform in enumerate(uniforms):
        now = number * TICK_S
        if now >= free_at - 1e-9:
            free_at = now + processing
            waiting.append((number, now + processing + delay + jitter * uniform))
        arrived = sorted(exposure for exposure, arrival in waiting if arrival <= now + 1e-9)
        found.append(arrived[0] if arrived else None)
        if arrived:
            waiting = [each for each in waiting if each[0] != arrived[0]]
    return found


@pytest.mark.parametrize(
    ("delay", "jitter", "processing"),
    [(0.0, 0.0, 0.0), (0.5, 0.0, 0.0), (0.4, 0.0, 0.0), (0.1, 0.7, 0.0), (0.0, 0.15, 0.5), (0.3, 0.5, 0.2)],
)
def test_each_measurement_is_had_once_in_its_turn(delay: float, jitter: float, processing: float) -> None:
    uniforms = np.random.default_rng(1).random(TICKS)
    number, age, present = delivered(
        delay_of(delay, jitter, processing), uniforms, slots_for(delay + jitter + processing)
    )
    expected = reference(delay, jitter, processing, uniforms)
    assert [int(each) if there else None for each, there in zip(number, present, strict=True)] == expected
    ticks = np.arange(TICKS)
    np.testing.assert_allclose(age[present], (ticks[present] - number[present]) * TICK_S, atol=1e-9)


def test_jitter_lets_a_later_exposure_overtake() -> None:
    uniforms = np.random.default_rng(2).random(TICKS)
    number, _, present = delivered(delay_of(0.0, jitter=0.9), uniforms, slots_for(0.9))
    assert np.any(np.diff(number[present]) < 0)


def test_a_busy_processor_leaves_frames_out() -> None:
    number, _, present = delivered(delay_of(0.0, processing=0.5), np.zeros(TICKS), slots_for(0.5))
    assert set(np.diff(number[present])) == {3.0}


def test_the_interval_is_the_time_since_the_measurement_before() -> None:
    delay, empty = delay_of(0.3, processing=0.5), measurement_delay.none_in_transit(6, jnp.zeros(()), jnp.zeros(()))

    def tick(waiting, number):
        waiting, delivery = measurement_delay.pass_through(waiting, delay, jnp.zeros(()), number, jnp.zeros(()), TICK_S)
        return waiting, (delivery.interval, delivery.present)

    interval, present = jax.jit(lambda numbers: jax.lax.scan(tick, empty, numbers)[1])(jnp.arange(TICKS))
    at = np.flatnonzero(present)
    np.testing.assert_allclose(interval[at[1:]], np.diff(at) * TICK_S, atol=1e-9)
    np.testing.assert_allclose(np.diff(at) * TICK_S, 0.6, atol=1e-9)


def test_the_time_tag_shifts_the_age() -> None:
    _, age, present = delivered(delay_of(0.4, tag=0.03), np.zeros(TICKS), slots_for(0.4))
    np.testing.assert_allclose(age[present], 0.37, atol=1e-9)


def test_a_measurement_that_waits_longer_than_the_slots_last_is_lost() -> None:
    _, _, present = delivered(delay_of(1.0), np.zeros(TICKS), slots=3)
    assert not present.any()


def test_no_measurement_is_no_number() -> None:
    some = {"range": jnp.asarray(3.0), "seen": jnp.asarray(True)}
    found = measurement_delay.without_measurement(some, jnp.asarray(False))
    assert np.isnan(found["range"])
    assert not found["seen"]
