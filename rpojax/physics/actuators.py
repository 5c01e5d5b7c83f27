"""Reaction wheels with limits and friction, and an on-time commanded thruster whose impulse in a step is exact."""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from rpojax.core import quaternion
from rpojax.core.constants import STANDARD_GRAVITY
from rpojax.core.numerics.runge_kutta import NODES, Method
from rpojax.core.pytree import pytree

Vector = Float[Array, "3"]
Scalar = Float[Array, ""]


@pytree
class ReactionWheels:
    """Three reaction wheels.

    Attributes:
        axes: (3, 3) spin axes in B, one a row
        inertia: (3,) about the spin axis [kg m^2]
        torque_limit: (3,) [N m]
        speed_limit: (3,) relative to the body [rad/s]
        initial_speed: (3,) [rad/s]
        viscous_friction: (3,) torque per speed [N m s/rad]
        coulomb_friction: (3,) torque of a turning wheel [N m]
        stiction_speed: () below about this speed the Coulomb torque fades to zero [rad/s]
        torque_step: () smallest difference of two torques that the drive can give [N m]
    """

    axes: Array
    inertia: Array
    torque_limit: Array
    speed_limit: Array
    initial_speed: Array
    viscous_friction: Array
    coulomb_friction: Array
    stiction_speed: Array
    torque_step: Array


def quantise_torque(wheels: ReactionWheels, command: Vector) -> Vector:
    """Torque command [N m] rounded to the drive's steps; the derivative is that of the command itself."""
    rounded = wheels.torque_step * jnp.round(command / wheels.torque_step)
    return command + jax.lax.stop_gradient(rounded - command)


def bearing_friction(wheels: ReactionWheels, speed: Vector) -> Vector:
    """Torque of the bearings on each wheel [N m] at its speed relative to the body [rad/s].

    The Coulomb part follows the hyperbolic tangent of the speed, so that it has a derivative when the wheel reverses.
    """
    return -wheels.viscous_friction * speed - wheels.coulomb_friction * jnp.tanh(speed / wheels.stiction_speed)


def limit_torque(wheels: ReactionWheels, command: Vector, speed: Vector, dt: float | Scalar) -> Vector:
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
        rise_time: () from the opening of the valve to full force [s]
        fall_time: () from its closing to none [s]
        position: (3,) lever arm from the centre of mass in B [m]
        direction: (3,) force on the servicer in B, unit
        misalignment: (3,) small rotation of the direction [rad]
        tank_position: (3,) of the propellant, from the centre of mass of the full servicer in B [m]
        magnitude_noise: () burn-to-burn error of the force, 1 sigma [-]
        direction_noise: () burn-to-burn error of the direction, 1 sigma per axis [rad]
    """

    force: Array
    force_scale: Array
    specific_impulse: Array
    minimum_on_time: Array
    rise_time: Array
    fall_time: Array
    position: Array
    direction: Array
    misalignment: Array
    tank_position: Array
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


@pytree
class ValveCommand:
    """When the valve is open.

    Attributes:
        ignition: () [s] from the start of the step
        cutoff: () [s] from the start of the step
        error: execution error of this burn
    """

    ignition: Array
    cutoff: Array
    burn_error: BurnError


@pytree
class StepThrust:
    """A thruster over one step.

    Attributes:
        force_B: (3,) when fully open [N]
        position_B: (3,) where it acts, from the centre of mass [m]
        flow: () of propellant when fully open [kg/s]
        opening: (nodes,) share of the full force at the integrator's nodes [-]
    """

    force_B: Array
    position_B: Array
    mass_flow: Array
    node_factors: Array


def thrust_over_step(
    thruster: Thruster, command: ValveCommand, method: Method, ramps: bool, dt: float | Scalar
) -> StepThrust:
    """What the thruster does in a step of `dt` [s]; with `ramps` the force rises and falls, else it is on or off.

    Commands shorter than the minimum on-time give nothing.
    """
    turn = quaternion.exp(thruster.misalignment + command.burn_error.direction)
    magnitude = thruster.force * thruster.force_scale * (1.0 + command.burn_error.magnitude)
    # A hair of tolerance: the two times are differences from a step that moves along, and round differently in each.
    valid = command.cutoff - command.ignition >= thruster.minimum_on_time - 1e-9
    return StepThrust(
        force_B=magnitude * quaternion.rotate(turn, quaternion.normalize(thruster.direction)),
        position_B=thruster.position,
        mass_flow=jnp.abs(magnitude) / (thruster.specific_impulse * STANDARD_GRAVITY),
        node_factors=jnp.where(valid, _node_factors(thruster, command, method, ramps, dt), 0.0),
    )


def center_of_mass_shift(thruster: Thruster, propellant_used: Scalar, mass: Scalar) -> Vector:
    """Way of the centre of mass [m] in B once `mass_used` [kg] of propellant has left and `mass` [kg] remains."""
    return -propellant_used / mass * thruster.tank_position


def _node_factors(
    thruster: Thruster, command: ValveCommand, method: Method, ramps: bool, dt: float | Scalar
) -> Float[Array, " nodes"]:
    """Factors at the integrator's nodes that make its quadrature exact for the true profile.

    They reproduce the profile's impulse and its moments up to the degree that the nodes carry, so that velocity and
    position after the step are those of the true times, and both are smooth in the on-time.
    """
    nodes = np.array(NODES[method])
    powers = np.arange(nodes.size)
    # Row i holds the coefficients of the i-th Lagrange polynomial, divided by its weight: its integral over the step.
    lagrange = np.linalg.inv(nodes[:, None] ** powers[None, :]).T
    weights = lagrange @ (1.0 / (powers + 1.0))
    table = jnp.asarray(lagrange / weights[:, None])
    ignition, cutoff = command.ignition / dt, jnp.maximum(command.cutoff, command.ignition) / dt
    if ramps:
        rise = jnp.maximum(thruster.rise_time / dt, _SHORTEST_RAMP)
        peak = jnp.minimum((cutoff - ignition) / rise, 1.0)
        # A short burn is cut before the force is up, and falls from where it got to.
        up = _ramp_moments(ignition, jnp.maximum(peak * rise, _SHORTEST_RAMP), nodes.size)
        down = _ramp_moments(cutoff, jnp.maximum(thruster.fall_time / dt, _SHORTEST_RAMP), nodes.size)
        moments = peak * (up - down)
    else:
        moments = _step_moments(ignition, nodes.size) - _step_moments(cutoff, nodes.size)
    return jnp.sum(table * moments[None, :], axis=1)


_SHORTEST_RAMP = 1e-9
"""Shortest ramp, as a share of a step."""


def _step_moments(begin: Scalar, count: int) -> Float[Array, " moments"]:
    """Integrals over [0, 1] of t^k times a profile that jumps from 0 to 1 at `begin`."""
    start = jnp.clip(begin, 0.0, 1.0)
    return jnp.stack([(1.0 - start ** (k + 1)) / (k + 1.0) for k in range(count)])


def _ramp_moments(begin: Scalar, width: Scalar, count: int) -> Float[Array, " moments"]:
    """Integrals over [0, 1] of t^k times a profile that climbs evenly from 0 at `begin` to 1 at `begin + width`."""
    low, high = jnp.clip(begin, 0.0, 1.0), jnp.clip(begin + width, 0.0, 1.0)
    at_end = jnp.clip((1.0 - begin) / width, 0.0, 1.0)
    climbed = at_end - jnp.clip(-begin / width, 0.0, 1.0)
    moments = []
    for k in range(count):
        mean_power = sum(high**i * low ** (k + 1 - i) for i in range(k + 2)) / (k + 2.0)
        moments.append((at_end - climbed * mean_power) / (k + 1.0))
    return jnp.stack(moments)
