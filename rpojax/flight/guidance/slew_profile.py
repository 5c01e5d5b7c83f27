"""Cycloidal slew profile: commanded attitude as a moving end attitude and the remainder of a slew to it."""

import math

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from rpojax.core import quaternion
from rpojax.core.numerics import gradient_safe
from rpojax.core.numerics.trigonometric_series import cos_sinc
from rpojax.core.pytree import pytree
from rpojax.core.quaternion import rotate
from rpojax.flight.control.attitude_control import AttitudeCommand
from rpojax.flight.guidance.pointing_tuning import GuidanceSoftware, PointingTuning

Vector = Float[Array, "3"]
Scalar = Float[Array, ""]
Flag = Bool[Array, ""]


@pytree
class SlewReference:
    """Commanded attitude as a function of time: a moving end attitude and the decaying remainder of a slew.

    Attributes:
        q_EN: (4,) end attitude at the epoch of the reference
        omega_EN_E: (3,) its rate [rad/s]
        remainder: (3,) rotation vector of the whole slew, command from end [rad]
        slew_age: () since the slew began, at the epoch [s]
        slew_time: () its duration [s]
    """

    q_EN: Array
    omega_EN_E: Array
    remainder: Array
    slew_age: Array
    slew_time: Array


def slew_duration(pointing: PointingTuning, angle: Scalar) -> Scalar:
    """Time [s] of a rest-to-rest slew over `angle` [rad] with the cycloidal profile of `evaluate`."""
    time = gradient_safe.sqrt(2.0 * math.pi * angle / pointing.slew_acceleration)
    return jnp.maximum(time, pointing.slew_minimum_time)


def evaluate(reference: SlewReference, age: Scalar) -> AttitudeCommand:
    """Attitude command `age` [s] after the epoch of the reference."""
    q_EN = quaternion.propagate(reference.q_EN, reference.omega_EN_E, age)
    fraction = jnp.clip((reference.slew_age + age) / reference.slew_time, 0.0, 1.0)
    # The cycloid sin(2 pi f) with its argument shifted by pi, into the range of the series.
    phase = 2.0 * math.pi * (fraction - 0.5)
    cosine, sinc = cos_sinc(phase * phase)
    sine = phase * sinc
    completed = fraction + sine / (2.0 * math.pi)
    moving = fraction < 1.0
    rate = jnp.where(moving, (1.0 + cosine) / reference.slew_time, 0.0)
    acceleration = jnp.where(moving, -2.0 * math.pi * sine / reference.slew_time**2, 0.0)
    q_CE = quaternion.exp((1.0 - completed) * reference.remainder)
    return AttitudeCommand(
        q_CN=quaternion.multiply(q_CE, q_EN),
        omega_CN_C=rate * reference.remainder + rotate(q_CE, reference.omega_EN_E),
        acceleration_C=acceleration * reference.remainder,
    )


def retarget(
    guidance: GuidanceSoftware, before: SlewReference, q_end: Array, omega_end: Vector, changed: Flag
) -> SlewReference:
    """Reference a tick later with a new end attitude.

    If the end attitude has `changed` its purpose or jumps, a new slew starts from the present command.
    """
    dt = guidance.tick_s
    step = jnp.asarray(dt, dtype=before.slew_age.dtype)
    q_end_expected = quaternion.propagate(before.q_EN, before.omega_EN_E, dt)
    jump = gradient_safe.norm(quaternion.log(quaternion.multiply(q_end, quaternion.conjugate(q_end_expected))))
    restart = changed | (jump > _RESTART_ANGLE)
    command = evaluate(before, step)
    remainder = quaternion.log(quaternion.multiply(command.q_CN, quaternion.conjugate(q_end)))
    return SlewReference(
        q_EN=q_end,
        omega_EN_E=omega_end,
        remainder=jnp.where(restart, remainder, before.remainder),
        slew_age=jnp.where(restart, 0.0, before.slew_age + dt),
        slew_time=jnp.where(restart, slew_duration(guidance.pointing, gradient_safe.norm(remainder)), before.slew_time),
    )


_RESTART_ANGLE = math.radians(5.0)
"""Step of the end attitude within one tick above which a new slew starts [rad]. A choice: attitude control settles less
than that in 7 s (3 / (damping bandwidth)), and a new slew lasts as long."""
