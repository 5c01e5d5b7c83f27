"""Propagation of the truth: both orbits and attitudes, wheels and propellant in one Runge-Kutta step."""

from dataclasses import dataclass

import jax
from jaxtyping import Array, Float

from rpojax.core import quaternion
from rpojax.core.numerics import double_single, runge_kutta
from rpojax.core.numerics.gradient_safe import norm
from rpojax.core.orbits import encke_reference
from rpojax.core.orbits.encke_reference import EnckeReference
from rpojax.core.orbits.sun_moon_ephemeris import SunMoonPositions
from rpojax.core.pytree import replace
from rpojax.core.quaternion import conjugate, rotate
from rpojax.core.vectors import cross
from rpojax.physics import forces_and_torques, rigid_body
from rpojax.physics.equipment_faults import Health
from rpojax.physics.plant_options import Effects
from rpojax.physics.plant_state import PlantParams, Truth
from rpojax.physics.rcs_thrusters import RcsThrust
from rpojax.physics.thruster import StepThrust

Vector = Float[Array, "3"]
Matrix = Float[Array, "3 3"]
Scalar = Float[Array, ""]


@dataclass(frozen=True)
class _StepInputs:
    """Inputs of a step and what is constant during it.

    Attributes:
        effects: switches
        params: true parameters
        thrusts: of the thrusters
        sky: Sun and Moon at the start of the step
        health: of the equipment at the start of the step
        dt: duration [s]
        motor_torque: (3,) of the wheel drives [N m]
        inverse_hub: (3, 3) inverse of the servicer's inertia without wheels [1/(kg m^2)]
        inverse_target: (3, 3) inverse of the target's inertia [1/(kg m^2)]
        sunlit_fractions: of target and servicer [-]
        orbit: reference orbit of the target
    """

    effects: Effects
    params: PlantParams
    thrusts: tuple[StepThrust, ...]
    sky: SunMoonPositions
    health: Health
    dt: float | Scalar
    motor_torque: Vector
    inverse_hub: Matrix
    inverse_target: Matrix
    sunlit_fractions: tuple[Scalar, Scalar]
    orbit: EnckeReference


def step(
    effects: Effects,
    params: PlantParams,
    truth: Truth,
    wheel_command: Vector,
    thrusts: tuple[StepThrust, ...],
    sky: SunMoonPositions,
    health: Health,
    dt: float | Scalar,
    rcs: RcsThrust | None = None,
) -> Truth:
    """Truth after a step of `dt` [s] with constant wheel torque commands [N m] and the given thrusts.

    Sun, Moon and the health of the equipment are those at the start of the step.
    """
    # Constant over a step, in which a thousandth of a gram is used.
    inertia = forces_and_torques.servicer_inertia(effects, params, truth)
    params = replace(params, servicer=replace(params.servicer, inertia=inertia))
    inputs = _StepInputs(
        effects=effects,
        params=params,
        thrusts=thrusts,
        sky=sky,
        health=health,
        dt=dt,
        motor_torque=forces_and_torques.motor_torque(effects, params.wheels, truth, wheel_command, health, dt),
        inverse_hub=rigid_body.inverse_hub_inertia(params.servicer.inertia, params.wheels.axes, params.wheels.inertia),
        inverse_target=rigid_body.inverse_3x3(params.target.inertia),
        sunlit_fractions=forces_and_torques.sunlit_fractions(effects, params, truth, sky, dt),
        orbit=encke_reference.reference_orbit(
            params.gravity, effects.zonal_degree, truth.r_TN_N, truth.v_TN_N, truth.orbit_low
        ),
    )

    def derivative(integrated: Truth, node: tuple[tuple[Scalar, ...], Scalar | None, RcsThrust | None]) -> Truth:
        return _derivative(inputs, integrated, *node)

    factors = tuple(health.thrust_fraction * thrust.node_factors for thrust in thrusts)
    r_TN_N, v_TN_N = inputs.orbit.integration_start
    integrated = replace(_without_low_parts(truth), r_TN_N=r_TN_N, v_TN_N=v_TN_N)
    times = inputs.orbit.node_times(runge_kutta.NODES[effects.integrator], dt)
    change = runge_kutta.increment(effects.integrator, derivative, integrated, (factors, times, rcs), dt)
    return _apply_change(inputs.orbit, truth, change, dt)


def _derivative(
    inputs: _StepInputs,
    integrated: Truth,
    factors: tuple[Scalar, ...],
    time: Scalar | None,
    rcs: RcsThrust | None,
) -> Truth:
    """Time derivative of the truth at a node of the integrator, `time` [s] after the start of the step.

    `integrated` holds the target's deviation from the reference orbit, `factors` the thrusters' fractions of full
    force, `rcs` the thrust of the reaction control system.
    """
    effects, params, orbit = inputs.effects, inputs.params, inputs.orbit
    r_TN_N, v_TN_N = orbit.full_state(time, integrated.r_TN_N, integrated.v_TN_N)
    y = replace(integrated, r_TN_N=r_TN_N, v_TN_N=v_TN_N)
    force_B, torque_B, mass_flow = forces_and_torques.propulsion(effects, params, y, inputs.thrusts, factors)
    delta_v_rate = sum(factor * norm(thrust.force_B) for factor, thrust in zip(factors, inputs.thrusts, strict=True))
    if rcs is not None:
        shift = forces_and_torques.center_of_mass_shift(effects, params, y)
        force_B, torque_B = force_B + rcs.force_B, torque_B + rcs.moment_B - cross(shift, rcs.force_B)
        mass_flow, delta_v_rate = mass_flow + rcs.mass_flow, delta_v_rate + rcs.effort
    gravity = orbit.gravity(time, integrated.r_TN_N, y.r_ST_N) + forces_and_torques.third_body_accelerations(
        effects, y, inputs.sky
    )
    surface = forces_and_torques.surface_effects(effects, params, y, inputs.sky, inputs.sunlit_fractions)
    gradient_B, gradient_T = forces_and_torques.gravity_gradient_torques(effects, params, y)
    wheel_torque = _wheel_torque(inputs, y)
    external_B = torque_B + gradient_B + surface.servicer_torque_B
    omega_dot, wheel_acceleration = _servicer_accelerations(inputs, y, wheel_torque, external_B)
    torque_T = gradient_T + surface.target_torque_T
    target_acceleration_N, plume = surface.target_acceleration_N, None if rcs is None else rcs.plume
    if plume is not None:
        torque_T = torque_T + plume.torque_T
        target_acceleration_N = target_acceleration_N + plume.force_N / params.target.mass
    return Truth(
        r_TN_N=integrated.v_TN_N,
        v_TN_N=gravity.value + target_acceleration_N,
        r_ST_N=y.v_ST_N,
        v_ST_N=gravity.change
        + surface.servicer_acceleration_N
        - target_acceleration_N
        + rotate(conjugate(y.q_BN), force_B) / y.mass,
        q_BN=quaternion.derivative(y.q_BN, y.omega_BN_B),
        omega_BN_B=omega_dot,
        wheel_speed=wheel_acceleration,
        q_TN=quaternion.derivative(y.q_TN, y.omega_TN_T),
        omega_TN_T=rigid_body.angular_acceleration(
            params.target.inertia, inputs.inverse_target, y.omega_TN_T, torque_T
        ),
        mass=-mass_flow,
        delta_v=delta_v_rate / y.mass,
        plume_impulse=None if plume is None else plume.size,
    )


def _wheel_torque(inputs: _StepInputs, y: Truth) -> Vector:
    """Torque of motors and bearings on the wheels [N m]."""
    return inputs.motor_torque + forces_and_torques.bearing_torque(
        inputs.effects, inputs.params.wheels, y.wheel_speed, inputs.health, inputs.dt
    )


def _servicer_accelerations(
    inputs: _StepInputs, y: Truth, wheel_torque: Vector, torque_B: Vector
) -> tuple[Vector, Vector]:
    """Angular acceleration of the servicer in B and of its wheels [rad/s^2] under an external torque [N m]."""
    wheels = inputs.params.wheels
    return rigid_body.accelerations_with_wheels(
        inputs.params.servicer.inertia,
        inputs.inverse_hub,
        wheels.axes,
        wheels.inertia,
        y.omega_BN_B,
        y.wheel_speed,
        wheel_torque,
        torque_B,
    )


def _apply_change(orbit: EnckeReference, truth: Truth, change: Truth, dt: float | Scalar) -> Truth:
    """Truth with the change of a step of `dt` [s] added; attitudes are normalised."""
    changed = jax.tree.map(lambda y, more: y + more, _without_low_parts(truth), change)
    r_TN_N, v_TN_N, orbit_low = orbit.final_state(dt, change.r_TN_N, change.v_TN_N)
    mass, mass_low = changed.mass, None
    if truth.mass_low is not None:
        mass, mass_low = double_single.add(truth.mass, truth.mass_low, change.mass)
    return replace(
        changed,
        r_TN_N=r_TN_N,
        v_TN_N=v_TN_N,
        orbit_low=orbit_low,
        mass=mass,
        mass_low=mass_low,
        q_BN=quaternion.normalize(changed.q_BN),
        q_TN=quaternion.normalize(changed.q_TN),
    )


def _without_low_parts(truth: Truth) -> Truth:
    """The truth without its low-order parts, which are not integrated."""
    return replace(truth, orbit_low=None, mass_low=None)
