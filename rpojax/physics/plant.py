"""The truth: both orbits, both attitudes, wheels and propellant, advanced together by one Runge-Kutta step."""

from dataclasses import dataclass

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from rpojax.core import quaternion
from rpojax.core.constants import MU_MOON, MU_SUN
from rpojax.core.frames import hill_frame, hill_to_inertial
from rpojax.core.numerics import double_single, runge_kutta
from rpojax.core.numerics.exact_difference import Difference
from rpojax.core.numerics.safe import norm
from rpojax.core.orbits import encke_reference, orbital_mechanics
from rpojax.core.orbits.encke_reference import EnckeReference
from rpojax.core.orbits.orbital_mechanics import GravityField
from rpojax.core.pytree import pytree, replace
from rpojax.core.quaternion import conjugate, cross, rotate
from rpojax.physics import actuators, environment, rigid_body
from rpojax.physics.actuators import ReactionWheels, StepThrust, Thruster
from rpojax.physics.environment import Atmosphere, Sunlight, SunMoonPositions, Surface
from rpojax.physics.equipment_faults import SEIZURE_TIME_CONSTANT, Fault, Health
from rpojax.physics.plant_options import Effects
from rpojax.physics.rigid_body import Body

Vector = Float[Array, "3"]
Matrix = Float[Array, "3 3"]
Scalar = Float[Array, ""]


@pytree
class Target:
    """The target as it is.

    Attributes:
        mass: () [kg]
        inertia: (3, 3) [kg m^2]
        hull: (n, 3) vertices that span its outline, from its centre of mass in T [m]
        tumble_rate: () initial rate [rad/s]
        tumble_axis: (3,) direction of the initial rate in T, any length
        attitude: (4,) initial q_TN
    """

    mass: Array
    inertia: Array
    hull: Array
    tumble_rate: Array
    tumble_axis: Array
    attitude: Array


@pytree
class PlantParams:
    """Everything true about the two vehicles and their surroundings."""

    servicer: Body
    servicer_surface: Surface
    target: Target
    target_surface: Surface
    thruster: Thruster
    wheels: ReactionWheels
    gravity: GravityField
    atmosphere: Atmosphere
    sunlight: Sunlight
    fault: Fault


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
        orbit_low: (2, 3) what the target's position [m] and velocity [m/s] lack in single precision; else None
        mass_low: () the same of the mass [kg]
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
    orbit_low: Array | None = None
    mass_low: Array | None = None


def initial_truth(
    params: PlantParams, orbit: orbital_mechanics.KeplerianElements, rho_H: Vector, rho_dot_H: Vector, q_BN: Array
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


def step(
    effects: Effects,
    params: PlantParams,
    truth: Truth,
    wheel_command: Vector,
    thrusts: tuple[StepThrust, ...],
    sky: SunMoonPositions,
    health: Health,
    dt: float | Scalar,
) -> Truth:
    """Truth after `dt` [s] of constant wheel torque commands [N m] and of what the thrusters do in the step.

    The sky and the health of the equipment are taken as they are at the start of the step.
    """
    motor = motor_torque(effects, params.wheels, truth, wheel_command, health, dt)
    inverse_hub = rigid_body.inverse_hub_inertia(params.servicer.inertia, params.wheels.axes, params.wheels.inertia)
    inverse_target = rigid_body.inverse_3x3(params.target.inertia)
    sunlit_fractions = _sunlit_fractions(effects, params, truth, sky, dt)
    orbit = encke_reference.reference_orbit(
        params.gravity, effects.zonal_degree, truth.r_TN_N, truth.v_TN_N, truth.orbit_low
    )

    def derivative(counted: Truth, inputs: tuple[tuple[Scalar, ...], Scalar | None]) -> Truth:
        openings, time = inputs
        r_TN_N, v_TN_N = orbit.full_state(time, counted.r_TN_N, counted.v_TN_N)
        y = replace(counted, r_TN_N=r_TN_N, v_TN_N=v_TN_N)
        force_B, torque_B, flow = _propulsion(effects, params, y, thrusts, openings)
        pull = orbit.gravity(time, counted.r_TN_N, y.r_ST_N) + _third_body_accelerations(effects, y, sky)
        surface = _surface_forces(effects, params, y, sky, sunlit_fractions)
        pull_B, torque_T = _gravity_gradient_torques(effects, params, y)
        wheel_torque = motor + _bearing_torque(effects, params.wheels, y.wheel_speed, health, dt)
        omega_dot, wheel_acceleration = rigid_body.accelerations_with_wheels(
            params.servicer.inertia,
            inverse_hub,
            params.wheels.axes,
            params.wheels.inertia,
            y.omega_BN_B,
            y.wheel_speed,
            wheel_torque,
            torque_B + pull_B + surface.servicer_torque_B,
        )
        torque_T = torque_T + surface.target_torque_T
        return Truth(
            r_TN_N=counted.v_TN_N,
            v_TN_N=pull.value + surface.target_acceleration_N,
            r_ST_N=y.v_ST_N,
            v_ST_N=pull.change
            + surface.servicer_acceleration_N
            - surface.target_acceleration_N
            + rotate(conjugate(y.q_BN), force_B) / y.mass,
            q_BN=quaternion.derivative(y.q_BN, y.omega_BN_B),
            omega_BN_B=omega_dot,
            wheel_speed=wheel_acceleration,
            q_TN=quaternion.derivative(y.q_TN, y.omega_TN_T),
            omega_TN_T=rigid_body.angular_acceleration(params.target.inertia, inverse_target, y.omega_TN_T, torque_T),
            mass=-flow,
            delta_v=sum(opening * norm(each.force_B) for opening, each in zip(openings, thrusts, strict=True)) / y.mass,
        )

    openings = tuple(health.thrust_fraction * thrust.node_factors for thrust in thrusts)
    r_TN_N, v_TN_N = orbit.integration_start
    counted = replace(_without_low_parts(truth), r_TN_N=r_TN_N, v_TN_N=v_TN_N)
    times = orbit.node_times(runge_kutta.NODES[effects.integrator], dt)
    change = runge_kutta.increment(effects.integrator, derivative, counted, (openings, times), dt)
    return _apply_change(orbit, truth, change, dt)


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
    return replace(truth, orbit_low=None, mass_low=None)


def motor_torque(
    effects: Effects, wheels: ReactionWheels, truth: Truth, command: Vector, health: Health, dt: float | Scalar
) -> Vector:
    """Torque [N m] that the wheel drives really give for a command [N m] over the next `dt` [s]."""
    given = actuators.quantise_torque(wheels, command) if effects.wheel_torque_steps else command
    torque = actuators.limit_torque(wheels, given, truth.wheel_speed, dt)
    return jnp.where(health.wheel_stuck, 0.0, torque) if effects.faults else torque


def _bearing_torque(
    effects: Effects, wheels: ReactionWheels, speed: Vector, health: Health, dt: float | Scalar
) -> Vector:
    """Torque [N m] of friction on the wheels, faults included."""
    torque = actuators.bearing_friction(wheels, speed) if effects.wheel_friction else jnp.zeros_like(speed)
    if not effects.faults:
        return torque
    rubbing = health.wheel_friction * wheels.torque_limit
    # Below the speed that the torque takes away in a step it must fade, else the wheel would chatter about zero.
    fading_speed = jnp.maximum(wheels.stiction_speed, rubbing / wheels.inertia * dt)
    seizing = wheels.inertia * speed / SEIZURE_TIME_CONSTANT
    return torque - rubbing * jnp.tanh(speed / fading_speed) - jnp.where(health.wheel_stuck, seizing, 0.0)


def _propulsion(
    effects: Effects, params: PlantParams, y: Truth, thrusts: tuple[StepThrust, ...], openings: tuple[Scalar, ...]
) -> tuple[Vector, Vector, Scalar]:
    """Force [N] and torque about the centre of mass [N m] in B, and flow of propellant [kg/s]."""
    force = torque = jnp.zeros_like(y.omega_BN_B)
    flow = jnp.zeros_like(y.mass)
    shift = _center_of_mass_shift(effects, params, y)
    for each, opening in zip(thrusts, openings, strict=True):
        own = opening * each.force_B
        force, torque = force + own, torque + cross(each.position_B - shift, own)
        flow = flow + opening * each.mass_flow
    return force, torque, flow


def _center_of_mass_shift(effects: Effects, params: PlantParams, y: Truth) -> Vector:
    """Way of the servicer's centre of mass since the start [m] in B; every lever arm is shorter by it."""
    if not effects.center_of_mass_shift:
        return jnp.zeros_like(y.omega_BN_B)
    return actuators.center_of_mass_shift(params.thruster, params.servicer.mass - y.mass, y.mass)


def _third_body_accelerations(effects: Effects, y: Truth, sky: SunMoonPositions) -> Difference:
    """Pull [m/s^2] of the Sun and the Moon in N on the target, and on the servicer less that on the target."""
    r = Difference(value=y.r_TN_N, change=y.r_ST_N)
    acceleration = Difference(value=jnp.zeros_like(y.r_TN_N), change=jnp.zeros_like(y.r_ST_N))
    if effects.sun_gravity:
        acceleration = acceleration + orbital_mechanics.third_body_acceleration(MU_SUN, sky.sun_N, r)
    if effects.moon_gravity:
        acceleration = acceleration + orbital_mechanics.third_body_acceleration(MU_MOON, sky.moon_N, r)
    return acceleration


@dataclass(frozen=True)
class _SurfaceForces:
    """What air and light do to both craft: accelerations in N [m/s^2], torques in body axes [N m]."""

    target_acceleration_N: Array
    servicer_acceleration_N: Array
    target_torque_T: Array
    servicer_torque_B: Array


def _sunlit_fractions(
    effects: Effects, params: PlantParams, truth: Truth, sky: SunMoonPositions, dt: float | Scalar
) -> tuple[Scalar, Scalar]:
    """Shares of sunlight [-] on the target and on the servicer in the middle of a step, which hold for all of it.

    The shadow costs more than all other forces together, and within a step changes by a line.
    """
    if not effects.solar_pressure:
        none = jnp.zeros_like(truth.mass)
        return none, none
    r_N, way_N = truth.r_TN_N + 0.5 * dt * truth.v_TN_N, truth.r_ST_N + 0.5 * dt * truth.v_ST_N
    target, servicer = (environment.sunlit_fraction(params.sunlight, at_N, sky.sun_N) for at_N in (r_N, r_N + way_N))
    return target, servicer


def _surface_forces(
    effects: Effects, params: PlantParams, y: Truth, sky: SunMoonPositions, sunlit_fractions: tuple[Scalar, Scalar]
) -> _SurfaceForces:
    def force(surface: Surface, share: Scalar, r_N: Vector, v_N: Vector) -> Vector:
        total = jnp.zeros_like(r_N)
        if effects.drag:
            total = total + environment.drag(params.atmosphere, surface, params.gravity.radius, r_N, v_N)
        if effects.solar_pressure:
            total = total + environment.solar_radiation_pressure(params.sunlight, surface, r_N, sky.sun_N, share)
        return total

    none = jnp.zeros_like(y.r_TN_N)
    if not (effects.drag or effects.solar_pressure):
        return _SurfaceForces(none, none, none, none)
    on_target = force(params.target_surface, sunlit_fractions[0], y.r_TN_N, y.v_TN_N)
    on_servicer = force(params.servicer_surface, sunlit_fractions[1], y.r_TN_N + y.r_ST_N, y.v_TN_N + y.v_ST_N)
    lever_B = params.servicer_surface.center_of_pressure - _center_of_mass_shift(effects, params, y)
    return _SurfaceForces(
        target_acceleration_N=on_target / params.target.mass,
        servicer_acceleration_N=on_servicer / y.mass,
        target_torque_T=cross(params.target_surface.center_of_pressure, rotate(y.q_TN, on_target)),
        servicer_torque_B=cross(lever_B, rotate(y.q_BN, on_servicer)),
    )


def _gravity_gradient_torques(effects: Effects, params: PlantParams, y: Truth) -> tuple[Vector, Vector]:
    """Torque [N m] of the gravity gradient on the servicer in B and on the target in T."""
    if not effects.gravity_gradient:
        none = jnp.zeros_like(y.omega_BN_B)
        return none, none
    mu = params.gravity.mu
    return (
        environment.gravity_gradient_torque(rotate(y.q_BN, y.r_TN_N + y.r_ST_N), params.servicer.inertia, mu),
        environment.gravity_gradient_torque(rotate(y.q_TN, y.r_TN_N), params.target.inertia, mu),
    )
