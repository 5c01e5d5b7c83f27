"""Forces and torques on both vehicles, each effect as far as it is switched on."""

from dataclasses import dataclass

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from rpojax.core import quaternion
from rpojax.core.constants import MU_MOON, MU_SUN
from rpojax.core.numerics.exact_difference import Difference
from rpojax.core.numerics.gradient_safe import norm
from rpojax.core.orbits import third_body_gravity
from rpojax.core.orbits.sun_moon_ephemeris import SunMoonPositions
from rpojax.core.quaternion import rotate
from rpojax.core.vectors import cross, product
from rpojax.physics import plume_impingement, reaction_wheels, thruster
from rpojax.physics.environment.drag import drag
from rpojax.physics.environment.gravity_gradient_torque import gravity_gradient_torque
from rpojax.physics.environment.solar_radiation_pressure import solar_radiation_pressure, sunlit_fraction
from rpojax.physics.environment.spacecraft_surface import Surface
from rpojax.physics.equipment_faults import SEIZURE_TIME_CONSTANT, Health
from rpojax.physics.plant_options import Effects
from rpojax.physics.plant_state import PlantParams, Truth
from rpojax.physics.plume_impingement import Impingement
from rpojax.physics.rcs_thrusters import RcsState
from rpojax.physics.reaction_wheels import ReactionWheels
from rpojax.physics.thruster import StepThrust

Vector = Float[Array, "3"]
Scalar = Float[Array, ""]


def motor_torque(
    effects: Effects, wheels: ReactionWheels, truth: Truth, command: Vector, health: Health, dt: float | Scalar
) -> Vector:
    """Torque [N m] that the wheel drives deliver for a command [N m] over the next `dt` [s]."""
    delivered = reaction_wheels.quantise_torque(wheels, command) if effects.wheel_torque_steps else command
    torque = reaction_wheels.limit_torque(wheels, delivered, truth.wheel_speed, dt)
    return jnp.where(health.wheel_stuck, 0.0, torque) if effects.faults else torque


def bearing_torque(
    effects: Effects, wheels: ReactionWheels, speed: Vector, health: Health, dt: float | Scalar
) -> Vector:
    """Torque [N m] of bearing friction on the wheels, faults included."""
    torque = reaction_wheels.bearing_friction(wheels, speed) if effects.wheel_friction else jnp.zeros_like(speed)
    if not effects.faults:
        return torque
    rubbing = health.wheel_friction * wheels.torque_limit
    # Below the speed that the torque takes away in a step it must fade, else the wheel would chatter about zero.
    fading_speed = jnp.maximum(wheels.stiction_speed, rubbing / wheels.inertia * dt)
    seizing = wheels.inertia * speed / SEIZURE_TIME_CONSTANT
    return torque - rubbing * jnp.tanh(speed / fading_speed) - jnp.where(health.wheel_stuck, seizing, 0.0)


def propulsion(
    effects: Effects, params: PlantParams, y: Truth, thrusts: tuple[StepThrust, ...], factors: tuple[Scalar, ...]
) -> tuple[Vector, Vector, Scalar]:
    """Force [N] and torque about the centre of mass [N m] in B, and mass flow of propellant [kg/s].

    `factors` are the thrusters' fractions of full force.
    """
    force = torque = jnp.zeros_like(y.omega_BN_B)
    mass_flow = jnp.zeros_like(y.mass)
    shift = center_of_mass_shift(effects, params, y)
    for thrust, factor in zip(thrusts, factors, strict=True):
        own = factor * thrust.force_B
        force, torque = force + own, torque + cross(thrust.position_B - shift, own)
        mass_flow = mass_flow + factor * thrust.mass_flow
    return force, torque, mass_flow


def center_of_mass_shift(effects: Effects, params: PlantParams, y: Truth) -> Vector:
    """Displacement of the servicer's centre of mass since the start [m] in B, by which lever arms are shorter."""
    if not effects.center_of_mass_shift:
        return jnp.zeros_like(y.omega_BN_B)
    return thruster.center_of_mass_shift(params.thruster, params.servicer.mass - y.mass, y.mass)


def servicer_inertia(effects: Effects, params: PlantParams, truth: Truth) -> Float[Array, "3 3"]:
    """Inertia of the servicer about its present centre of mass, wheels locked, in B [kg m^2]."""
    if not effects.inertia_change:
        return params.servicer.inertia
    used = params.servicer.mass - truth.mass
    return thruster.inertia_after(params.thruster, params.servicer.inertia, used, truth.mass)


def third_body_accelerations(effects: Effects, y: Truth, sky: SunMoonPositions) -> Difference:
    """Acceleration [m/s^2] by Sun and Moon in N of the target, and of the servicer less that of the target."""
    r = Difference(value=y.r_TN_N, change=y.r_ST_N)
    acceleration = Difference(value=jnp.zeros_like(y.r_TN_N), change=jnp.zeros_like(y.r_ST_N))
    if effects.sun_gravity:
        acceleration = acceleration + third_body_gravity.third_body_acceleration(MU_SUN, sky.sun_N, r)
    if effects.moon_gravity:
        acceleration = acceleration + third_body_gravity.third_body_acceleration(MU_MOON, sky.moon_N, r)
    return acceleration


@dataclass(frozen=True)
class SurfaceEffects:
    """Accelerations in N [m/s^2] and torques in body axes [N m] by air and sunlight on both vehicles."""

    target_acceleration_N: Array
    servicer_acceleration_N: Array
    target_torque_T: Array
    servicer_torque_B: Array


def sunlit_fractions(
    effects: Effects, params: PlantParams, truth: Truth, sky: SunMoonPositions, dt: float | Scalar
) -> tuple[Scalar, Scalar]:
    """Sunlit fractions [-] of target and servicer in the middle of a step, used for all of it.

    The shadow costs more than all other forces together, and within a step changes linearly.
    """
    if not effects.solar_pressure:
        none = jnp.zeros_like(truth.mass)
        return none, none
    r_TN_N, r_ST_N = truth.r_TN_N + 0.5 * dt * truth.v_TN_N, truth.r_ST_N + 0.5 * dt * truth.v_ST_N
    target, servicer = (sunlit_fraction(params.sunlight, r_N, sky.sun_N) for r_N in (r_TN_N, r_TN_N + r_ST_N))
    return target, servicer


def surface_effects(
    effects: Effects, params: PlantParams, y: Truth, sky: SunMoonPositions, sunlit_fractions: tuple[Scalar, Scalar]
) -> SurfaceEffects:
    """Drag and solar radiation pressure on both vehicles."""

    def force(surface: Surface, fraction: Scalar, r_N: Vector, v_N: Vector) -> Vector:
        total = jnp.zeros_like(r_N)
        if effects.drag:
            total = total + drag(params.atmosphere, surface, params.gravity.radius, r_N, v_N)
        if effects.solar_pressure:
            total = total + solar_radiation_pressure(params.sunlight, surface, r_N, sky.sun_N, fraction)
        return total

    none = jnp.zeros_like(y.r_TN_N)
    if not (effects.drag or effects.solar_pressure):
        return SurfaceEffects(none, none, none, none)
    on_target = force(params.target_surface, sunlit_fractions[0], y.r_TN_N, y.v_TN_N)
    on_servicer = force(params.servicer_surface, sunlit_fractions[1], y.r_TN_N + y.r_ST_N, y.v_TN_N + y.v_ST_N)
    lever_B = params.servicer_surface.center_of_pressure - center_of_mass_shift(effects, params, y)
    return SurfaceEffects(
        target_acceleration_N=on_target / params.target.mass,
        servicer_acceleration_N=on_servicer / y.mass,
        target_torque_T=cross(params.target_surface.center_of_pressure, rotate(y.q_TN, on_target)),
        servicer_torque_B=cross(lever_B, rotate(y.q_BN, on_servicer)),
    )


def gravity_gradient_torques(effects: Effects, params: PlantParams, y: Truth) -> tuple[Vector, Vector]:
    """Gravity-gradient torque [N m] on the servicer in B and on the target in T."""
    if not effects.gravity_gradient:
        none = jnp.zeros_like(y.omega_BN_B)
        return none, none
    mu = params.gravity.mu
    return (
        gravity_gradient_torque(rotate(y.q_BN, y.r_TN_N + y.r_ST_N), params.servicer.inertia, mu),
        gravity_gradient_torque(rotate(y.q_TN, y.r_TN_N), params.target.inertia, mu),
    )


def plumes_on_target(
    effects: Effects, params: PlantParams, truth: Truth, thrusters: RcsState, ahead: float
) -> Impingement:
    """Load on the target of each small thruster when it is open, in the geometry of `ahead` [s] after the truth.

    The vehicles move on at their rates until then: to the middle of the time for which the load is used.
    """
    assert params.facets is not None
    q_BN = quaternion.propagate(truth.q_BN, truth.omega_BN_B, ahead)
    q_TN = quaternion.propagate(truth.q_TN, truth.omega_TN_T, ahead)
    r_ST_N = truth.r_ST_N + ahead * truth.v_ST_N
    shift = center_of_mass_shift(effects, params, truth)
    R_TB = product(quaternion.to_matrix(q_TN), quaternion.to_matrix(q_BN).T)
    size = params.target.scale
    sources_T = rotate(q_TN, r_ST_N)[None, :] + product(thrusters.position_B - shift[None, :], R_TB.T)
    # In units of the nominal target; the load depends on angles alone, and a torque grows with the lever arm.
    force_T, torque_T = plume_impingement.loads(
        params.plume, params.facets, sources_T / size, product(thrusters.force_B, R_TB.T)
    )
    return Impingement(
        force_N=product(force_T, quaternion.to_matrix(q_TN)),
        torque_T=size * torque_T,
        size=jax.vmap(norm)(force_T),
    )
