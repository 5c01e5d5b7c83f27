"""Delay of a measurement from its exposure until flight software has it: processing, transport and time tag.

Measurements wait in slots, one for each tick of their exposure. Flight software takes at most one of a sensor in a
tick, that which was exposed first of those that have arrived, so that one that was overtaken comes after.
"""

from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from rpojax.core.declared_numbers import number
from rpojax.core.pytree import pytree

Scalar = Float[Array, ""]

ROUNDING = 1e-6
"""Rounding of a sum of ticks [s], as 0.1 s ten times is less than 1 s."""


@pytree
class MeasurementDelay:
    """Delay of the measurements of a sensor; those of additional sensors have the same keys in their own sections."""

    delay: Array = number(
        "time from an exposure until flight software has the measurement, beside `processing_s`",
        unit="s",
        at_least=0.0,
        default=0.0,
        key="camera.delay_s",
    )
    delay_jitter: Array = number(
        "longest further delay, uniform and new in each measurement",
        unit="s",
        at_least=0.0,
        default=0.0,
        key="camera.delay_jitter_s",
    )
    processing: Array = number(
        "time that a measurement takes in a processor, which leaves out what is exposed meanwhile",
        unit="s",
        at_least=0.0,
        default=0.0,
        key="camera.processing_s",
    )
    time_tag_error: Array = number(
        "time tag of a measurement less the time of its exposure",
        unit="s",
        default=0.0,
        key="camera.time_tag_error_s",
    )


@pytree
class InTransit:
    """Measurements of a sensor that flight software has not got yet, in slots.

    Attributes:
        measurements: pytree of arrays (slots, ...)
        age: (slots,) time since the exposure [s]
        left: (slots,) time until flight software has them [s], infinite in empty slots
        busy: () time for which the processor is busy still [s]
        since: () time since flight software had one [s]
    """

    measurements: Any
    age: Array
    left: Array
    busy: Array
    since: Array


@pytree
class Delivery:
    """What flight software gets of a sensor in a tick.

    Attributes:
        measurement: pytree of arrays; what it holds where there is none does not count
        age: () time since the exposure by its time tag [s]
        present: () bool, there is one
        interval: () time since flight software had the one before [s]
    """

    measurement: Any
    age: Array
    present: Array
    interval: Array


def none_in_transit(slots: int, example: Any, zero: Scalar) -> InTransit:
    """Empty slots for measurements of the shapes of an `example`; `zero` has the type of times."""
    return InTransit(
        measurements=jax.tree.map(lambda leaf: jnp.zeros((slots, *leaf.shape), dtype=leaf.dtype), example),
        age=jnp.zeros((slots,), dtype=zero.dtype) + zero,
        left=jnp.full((slots,), jnp.inf, dtype=zero.dtype) + zero,
        busy=zero,
        since=zero,
    )


def pass_through(
    waiting: InTransit, delay: MeasurementDelay, measurement: Any, tick: Int[Array, ""], uniform: Scalar, tick_s: float
) -> tuple[InTransit, Delivery]:
    """Slots after an exposure, and what has arrived by its time.

    Args:
        waiting: slots of the tick before
        delay: of the sensor
        measurement: of the exposure
        tick: () number of the tick, the same for all runs of a batch
        uniform: () random number in [0, 1) of the jitter
        tick_s: time between two ticks [s]
    """
    slot = tick % waiting.age.shape[0]
    busy = waiting.busy - tick_s
    idle = busy <= ROUNDING
    arrival = delay.processing + delay.delay + delay.delay_jitter * uniform
    measurements = jax.tree.map(lambda slots, new: slots.at[slot].set(new), waiting.measurements, measurement)
    age = (waiting.age + tick_s).at[slot].set(0.0)
    left = (waiting.left - tick_s).at[slot].set(jnp.where(idle, arrival, jnp.inf))
    first = jnp.argmax(jnp.where(left <= ROUNDING, age, -1.0), axis=0)
    present = left[first] <= ROUNDING
    delivery = Delivery(
        measurement=jax.tree.map(lambda slots: slots[first], measurements),
        age=age[first] - delay.time_tag_error,
        present=present,
        interval=waiting.since + tick_s,
    )
    taken = (jnp.arange(left.shape[0]) == first) & present
    after = InTransit(
        measurements=measurements,
        age=age,
        left=jnp.where(taken, jnp.inf, left),
        busy=jnp.where(idle, delay.processing, busy),
        since=jnp.where(present, 0.0, waiting.since + tick_s),
    )
    return after, delivery


def without_measurement(measurement: Any, present: Bool[Array, ""]) -> Any:
    """Arrays of a measurement, or what stands for none: NaN, zero or false."""

    def kept(leaf: Array) -> Array:
        none = jnp.nan if jnp.issubdtype(leaf.dtype, jnp.floating) else jnp.zeros((), dtype=leaf.dtype)
        return jnp.where(present, leaf, none)

    return jax.tree.map(kept, measurement)
