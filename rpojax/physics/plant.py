"""The truth: both orbits, both attitudes, wheels and propellant, advanced together by one Runge-Kutta step."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from rpojax.core import orbital_mechanics, quaternion
from rpojax.core.frames import hill_frame, hill_to_inertial
from rpojax.core.integrate import rk4
from rpojax.core.pytree import pytree, replace
from rpojax.core.quaternion import rotate
from rpojax.physics import actuators, rigid_body
from rpojax.physics.actuators import BurnError, Thruster, Wheels
from rpojax.physics.environment import Sun, gravity_gradient_torque
from rpojax.physics.rigid_body import Body

Vector = Float[Array, "3"]
Matrix = Float[Array, "3 3"]
Scalar = Float[Array, ""]


@pytree
class Target:
    """The target as it is.

    Attributes:
        inertia: (3, 3) [kg m^2]
        hull: (n, 3) vertices that span its outline, from its centre of mass in T [m]
        tumble_rate: () initial rate [rad/s]
        tumble_axis: (3,) direction of the initial rate in T, any length
        attitude: (4,) initial q_TN
    """

    inertia: Array
    hull: Array
    tumble_rate: Array
    tumble_axis: Array
    attitude: Array


@pytree
class PlantParams:
    """Everything true about the two vehicles and their surroundings."""

    servicer: Body
    target: Target
    thruster: Thruster
    wheels: Wheels
    sun: Sun


@pytree
class Truth:
    """State of the plant.

    Attributes:
        r_TN_N: (3,) target position [m]
        v_TN_N: (3,) target velocity [m/s]
        r_ST_N: (3,) servicer from target [m]
        v_ST_N: (3,) its inertial derivative [m/s]
        q_BN: (4,) servicer attitude
        omega_BN_B: (3,) servicer rate [rad/s]
        wheel_speed: (3,) relative to the body [rad/s]
        q_TN: (4,) target attitude
        omega_TN_T: (3,) target rate [rad/s]
        mass: () servicer mass [kg]
        delta_v: () velocity change that the thruster has applied so far, summed in magnitude [m/s]
    """

    r_TN_N: Array
    v_TN_N: Array
    r_ST_N: Array
    v_ST_N: Array
    q_BN: Array
    omega_BN_B: Array
    wheel_speed: Array
    q_TN: Array
    omega_TN_T: Array
    mass: Array
    delta_v: Array


@pytree
class Burn:
    """When the thruster is open.

    Attributes:
        ignition: () [s] from the start of the step
        cutoff: () [s] from the start of the step
        error: execution error of this burn
    """

    ignition: Array
    cutoff: Array
    error: BurnError


def initial_truth(
    params: PlantParams, orbit: orbital_mechanics.Elements, rho_H: Vector, rho_dot_H: Vector, q_BN: Array
) -> Truth:
    """Truth at the start: target on its orbit, servicer at `rho_H` [m], `rho_dot_H` [m/s], not turning in H."""
    r_TN_N, v_TN_N = orbital_mechanics.state_from_elements(orbit)
    R_HN, omega_HN_N = hill_frame(r_TN_N, v_TN_N)
    r_ST_N, v_ST_N = hill_to_inertial(rho_H, rho_dot_H, R_HN, omega_HN_N)
    zero = jnp.zeros_like(params.servicer.mass)
    return Truth(
        r_TN_N=r_TN_N,
        v_TN_N=v_TN_N,
        r_ST_N=r_ST_N,
        v_ST_N=v_ST_N,
        q_BN=q_BN,
        omega_BN_B=rotate(q_BN, omega_HN_N),
        wheel_speed=params.wheels.initial_speed,
        q_TN=quaternion.normalize(params.target.attitude),
        omega_TN_T=params.target.tumble_rate * quaternion.normalize(params.target.tumble_axis),
        mass=params.servicer.mass,
        delta_v=zero,
    )


def step(params: PlantParams, truth: Truth, wheel_command: Vector, burn: Burn, dt: float) -> Truth:
    """Truth after `dt` [s] of constant wheel torque commands [N m] and of the burn's part that falls in the step."""
    torque = actuators.limited_torque(params.wheels, wheel_command, truth.wheel_speed, dt)
    force_B, lever_torque_B = actuators.force_and_torque(params.thruster, burn.error)
    flow = actuators.mass_flow(params.thruster, force_B)
    wheels = params.wheels
    inverse_hub = rigid_body.inverse_without_wheels(params.servicer.inertia, wheels.axes, wheels.inertia)
    inverse_target = rigid_body.inverse(params.target.inertia)

    def derivative(y: Truth, thrust: Scalar) -> Truth:
        acceleration_B = thrust / y.mass * force_B
        r_SN_B = rotate(y.q_BN, y.r_TN_N + y.r_ST_N)
        torque_B = thrust * lever_torque_B + gravity_gradient_torque(r_SN_B, params.servicer.inertia)
        omega_dot, wheel_acceleration = rigid_body.accelerations_with_wheels(
            params.servicer.inertia,
            inverse_hub,
            wheels.axes,
            wheels.inertia,
            y.omega_BN_B,
            y.wheel_speed,
            torque,
            torque_B,
        )
        torque_T = gravity_gradient_torque(rotate(y.q_TN, y.r_TN_N), params.target.inertia)
        return Truth(
            r_TN_N=y.v_TN_N,
            v_TN_N=orbital_mechanics.gravity(y.r_TN_N),
            r_ST_N=y.v_ST_N,
            v_ST_N=orbital_mechanics.differential_gravity(y.r_TN_N, y.r_ST_N)
            + rotate(quaternion.conjugate(y.q_BN), acceleration_B),
            q_BN=quaternion.derivative(y.q_BN, y.omega_BN_B),
            omega_BN_B=omega_dot,
            wheel_speed=wheel_acceleration,
            q_TN=quaternion.derivative(y.q_TN, y.omega_TN_T),
            omega_TN_T=rigid_body.angular_acceleration(params.target.inertia, inverse_target, y.omega_TN_T, torque_T),
            mass=-thrust * flow,
            delta_v=thrust / y.mass * jnp.sqrt(jnp.sum(force_B * force_B, axis=0)),
        )

    after = rk4(derivative, truth, actuators.stage_fractions(burn.ignition, burn.cutoff, dt), dt)
    return replace(after, q_BN=quaternion.normalize(after.q_BN), q_TN=quaternion.normalize(after.q_TN))
