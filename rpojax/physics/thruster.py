"""Thruster commanded by on-time, with execution errors and an exact impulse in every integration step."""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from rpojax.core import quaternion
from rpojax.core.constants import STANDARD_GRAVITY
from rpojax.core.declared_numbers import number
from rpojax.core.numerics.runge_kutta import NODES, Method
from rpojax.core.pytree import pytree
from rpojax.value_types import Direction

Vector = Float[Array, "3"]
Matrix = Float[Array, "3 3"]
Scalar = Float[Array, ""]


@pytree
class Thruster:
    """Warm-gas thruster with its true values; flight software has a vehicle model of its own."""

    force: Array = number("nominal force, used by the flight software", unit="n", above=0.0)
    force_scale: Array = number("true over nominal force", above=0.0)
    specific_impulse: Array = number("specific impulse", unit="s", above=0.0)
    minimum_on_time: Array = number(
        "shorter commands give no thrust, and the flight software plans none", unit="s", at_least=0.0
    )
    rise_time: Array = number("from the opening of the valve to full force", unit="s", at_least=0.0)
    fall_time: Array = number("from its closing to none", unit="s", at_least=0.0)
    position: Array = number("point of application of the force from the centre of mass, B", unit="m", length=3)
    direction: Array = number(
        "direction of the force on the servicer, opposite the plume, B; any length", form=Direction
    )
    misalignment: Array = number("constant small rotation of the force, B", unit="deg", length=3)
    tank_position: Array = number("propellant from the centre of mass of the full servicer, B", unit="m", length=3)
    magnitude_noise: Array = number("burn-to-burn relative error of the force, 1 sigma", at_least=0.0)
    direction_noise: Array = number("burn-to-burn rotation of the force per axis, 1 sigma", unit="deg", at_least=0.0)
    tank_radius: Array = number(
        "radius of the spherical tank, which the propellant fills evenly", unit="m", at_least=0.0, default=0.0
    )


@pytree
class BurnError:
    """Execution error of one burn.

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
    """Commanded opening of the thruster's valve, with the execution error of the burn.

    Attributes:
        ignition: () [s] from the start of the step
        cutoff: () [s] from the start of the step
        burn_error: execution error of this burn
    """

    ignition: Array
    cutoff: Array
    burn_error: BurnError


@pytree
class StepThrust:
    """Thrust over one integration step.

    Attributes:
        force_B: (3,) when fully open [N]
        position_B: (3,) where it acts, from the centre of mass [m]
        mass_flow: () of propellant when fully open [kg/s]
        node_factors: (nodes,) fraction of the full force at the integrator's nodes [-]
    """

    force_B: Array
    position_B: Array
    mass_flow: Array
    node_factors: Array


def thrust_over_step(
    thruster: Thruster, command: ValveCommand, method: Method, ramps: bool, dt: float | Scalar
) -> StepThrust:
    """Thrust over a step of `dt` [s]; with `ramps` the force rises and falls, else it is on or off.

    Commands shorter than the minimum on-time give nothing.
    """
    rotation = quaternion.exp(thruster.misalignment + command.burn_error.direction)
    magnitude = thruster.force * thruster.force_scale * (1.0 + command.burn_error.magnitude)
    valid = command.cutoff - command.ignition >= thruster.minimum_on_time - _ON_TIME_ROUNDING
    return StepThrust(
        force_B=magnitude * quaternion.rotate(rotation, quaternion.normalize(thruster.direction)),
        position_B=thruster.position,
        mass_flow=jnp.abs(magnitude) / (thruster.specific_impulse * STANDARD_GRAVITY),
        node_factors=jnp.where(valid, _node_factors(thruster, command, method, ramps, dt), 0.0),
    )


def center_of_mass_shift(thruster: Thruster, propellant_used: Scalar, mass: Scalar) -> Vector:
    """Displacement of the centre of mass [m] in B after `propellant_used` [kg] while `mass` [kg] remains."""
    return -propellant_used / mass * thruster.tank_position


def inertia_after(thruster: Thruster, inertia: Matrix, propellant_used: Scalar, mass: Scalar) -> Matrix:
    """Inertia [kg m^2] about the present centre of mass after `propellant_used` [kg] while `mass` [kg] remains.

    The propellant fills its sphere evenly at any time (UniformBurn of Basilisk's fuel tanks, Allard et al., 2016): what
    is used takes the inertia of a sphere of its mass at the tank's place with it, by the parallel-axis theorem.
    """
    shift = center_of_mass_shift(thruster, propellant_used, mass)
    of_sphere = 0.4 * propellant_used * thruster.tank_radius**2 * jnp.eye(3, dtype=inertia.dtype)
    used = of_sphere + propellant_used * _parallel_axis(thruster.tank_position)
    return inertia - used - mass * _parallel_axis(shift)


def _parallel_axis(place: Vector) -> Matrix:
    """Inertia of a unit mass at a place about the origin [m^2]."""
    return jnp.sum(place * place, axis=0) * jnp.eye(3, dtype=place.dtype) - place[:, None] * place[None, :]


def _node_factors(
    thruster: Thruster, command: ValveCommand, method: Method, ramps: bool, dt: float | Scalar
) -> Float[Array, " nodes"]:
    """Factors at the integrator's nodes with which its quadrature is exact for the true thrust profile.

    They reproduce the profile's impulse and its moments up to the degree that the nodes carry, so that velocity and
    position after the step are those of the true times, and both are smooth in the on-time.
    """
    table = _moments_to_factors(method)
    count = table.shape[0]
    ignition, cutoff = command.ignition / dt, jnp.maximum(command.cutoff, command.ignition) / dt
    if ramps:
        rise = jnp.maximum(thruster.rise_time / dt, _SHORTEST_RAMP)
        peak = jnp.minimum((cutoff - ignition) / rise, 1.0)
        # A short burn is cut before the force is up, and falls from the force reached.
        up = _ramp_moments(ignition, jnp.maximum(peak * rise, _SHORTEST_RAMP), count)
        down = _ramp_moments(cutoff, jnp.maximum(thruster.fall_time / dt, _SHORTEST_RAMP), count)
        moments = peak * (up - down)
    else:
        moments = _step_moments(ignition, count) - _step_moments(cutoff, count)
    return jnp.sum(table * moments[None, :], axis=1)


def pulse_factors(on_time: Scalar, method: Method, dt: float | Scalar) -> Float[Array, " nodes"]:
    """Factors as of `StepThrust` of a valve that is open from the begin of a step of `dt` [s] for an on-time [s]."""
    table = _moments_to_factors(method)
    count = table.shape[0]
    moments = _step_moments(jnp.zeros_like(on_time), count) - _step_moments(on_time / dt, count)
    return jnp.sum(table * moments[None, :], axis=1)


def _moments_to_factors(method: Method) -> Float[Array, "nodes moments"]:
    """Matrix from integrals of t^k times a profile over [0, 1] to its factors at the nodes of the integrator."""
    nodes = np.array(NODES[method])
    powers = np.arange(nodes.size)
    # Row i holds the coefficients of the i-th Lagrange polynomial, divided by its weight: its integral over the step.
    lagrange = np.linalg.inv(nodes[:, None] ** powers[None, :]).T
    weights = lagrange @ (1.0 / (powers + 1.0))
    return jnp.asarray(lagrange / weights[:, None])


_SHORTEST_RAMP = 1e-9
"""Shortest ramp, as a fraction of a step, as it is divided by."""
_ON_TIME_ROUNDING = 1e-9
"""Rounding of the on-time [s], whose ends are relative to a step that moves along: 1e-10 after ten days."""


def _step_moments(begin: Scalar, count: int) -> Float[Array, " moments"]:
    """Integrals over [0, 1] of t^k times a profile that jumps from 0 to 1 at `begin`."""
    start = jnp.clip(begin, 0.0, 1.0)
    return jnp.stack([(1.0 - start ** (k + 1)) / (k + 1.0) for k in range(count)])


def _ramp_moments(begin: Scalar, width: Scalar, count: int) -> Float[Array, " moments"]:
    """Integrals over [0, 1] of t^k times a profile that rises linearly from 0 at `begin` to 1 at `begin + width`."""
    low, high = jnp.clip(begin, 0.0, 1.0), jnp.clip(begin + width, 0.0, 1.0)
    at_end = jnp.clip((1.0 - begin) / width, 0.0, 1.0)
    climbed = at_end - jnp.clip(-begin / width, 0.0, 1.0)
    moments = []
    for k in range(count):
        mean_power = sum(high**i * low ** (k + 1 - i) for i in range(k + 2)) / (k + 2.0)
        moments.append((at_end - climbed * mean_power) / (k + 1.0))
    return jnp.stack(moments)
