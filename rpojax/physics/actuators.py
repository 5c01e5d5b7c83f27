"""Reaction wheels with limits, and an on-time commanded thruster that cuts off exactly inside a step."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from rpojax.core import quaternion
from rpojax.core.constants import STANDARD_GRAVITY
from rpojax.core.pytree import pytree
from rpojax.core.quaternion import cross

Vector = Float[Array, "3"]
Scalar = Float[Array, ""]


@pytree
class Wheels:
    """Three reaction wheels.

    Attributes:
        axes: (3, 3) spin axes in B, one a row
        inertia: (3,) about the spin axis [kg m^2]
        torque_limit: (3,) [N m]
        speed_limit: (3,) relative to the body [rad/s]
        initial_speed: (3,) [rad/s]
    """

    axes: Array
    inertia: Array
    torque_limit: Array
    speed_limit: Array
    initial_speed: Array


def limited_torque(wheels: Wheels, command: Vector, speed: Vector, dt: float) -> Vector:
    """Motor torque on each wheel [N m] over the next `dt` [s]: the command within the torque and speed limits."""
    torque = jnp.clip(command, -wheels.torque_limit, wheels.torque_limit)
    up = wheels.inertia * (wheels.speed_limit - speed) / dt
    down = wheels.inertia * (-wheels.speed_limit - speed) / dt
    return jnp.clip(torque, jnp.minimum(down, 0.0), jnp.maximum(up, 0.0))


@pytree
class Thruster:
    """One warm-gas thruster, as it is (flight software has its own idea of it).

    Attributes:
        force: () nominal force [N]
        force_scale: () true over nominal force [-]
        specific_impulse: () [s]
        minimum_on_time: () shorter commands give nothing [s]
        position: (3,) lever arm from the centre of mass in B [m]
        direction: (3,) force on the servicer in B, unit
        misalignment: (3,) small rotation of the direction [rad]
        magnitude_noise: () burn-to-burn error of the force, 1 sigma [-]
        direction_noise: () burn-to-burn error of the direction, 1 sigma per axis [rad]
    """

    force: Array
    force_scale: Array
    specific_impulse: Array
    minimum_on_time: Array
    position: Array
    direction: Array
    misalignment: Array
    magnitude_noise: Array
    direction_noise: Array


@pytree
class BurnError:
    """Execution error of the present burn.

    Attributes:
        magnitude: () factor on the force, less one [-]
        direction: (3,) small rotation of the force [rad]
    """

    magnitude: Array
    direction: Array


def draw_burn_error(thruster: Thruster, normals: Float[Array, "4"]) -> BurnError:
    """Execution error of one burn from four standard normal numbers."""
    return BurnError(magnitude=thruster.magnitude_noise * normals[0], direction=thruster.direction_noise * normals[1:])


def force_and_torque(thruster: Thruster, error: BurnError) -> tuple[Vector, Vector]:
    """Force [N] and torque about the centre of mass [N m] of the open thruster, both in B."""
    turn = quaternion.exp(thruster.misalignment + error.direction)
    magnitude = thruster.force * thruster.force_scale * (1.0 + error.magnitude)
    force = magnitude * quaternion.rotate(turn, quaternion.normalize(thruster.direction))
    return force, cross(thruster.position, force)


def mass_flow(thruster: Thruster, force_B: Vector) -> Scalar:
    """Propellant flow [kg/s] at the given force [N]."""
    return jnp.sqrt(jnp.sum(force_B * force_B, axis=0)) / (thruster.specific_impulse * STANDARD_GRAVITY)


def stage_fractions(ignition: Scalar, cutoff: Scalar, dt: float) -> tuple[Scalar, Scalar, Scalar]:
    """Factors on the thrust at the start, middle and end of a Runge-Kutta step, for thrust on part of the step.

    `ignition` and `cutoff` [s] count from the start of the step and may lie outside of it. The factors make Simpson's
    rule exact for the impulse and its first two moments, so that velocity and position after the step are those of
    the true on and off times, and both are smooth in the on-time.
    """
    start = jnp.clip(ignition / dt, 0.0, 1.0)
    end = jnp.maximum(jnp.clip(cutoff / dt, 0.0, 1.0), start)
    m0, m1, m2 = end - start, (end**2 - start**2) / 2.0, (end**3 - start**3) / 3.0
    return 6.0 * m0 - 18.0 * m1 + 12.0 * m2, 6.0 * (m1 - m2), 12.0 * m2 - 6.0 * m1
