"""Effects, parameters, surroundings and initial state of the plant as a reference file describes them."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from experiments.validation.gravity_gradient_switch import has_gravity_gradient
from experiments.validation.reference_file import FormatError, Numbers, Reference
from rpojax.core import quaternion
from rpojax.core.constants import ASTRONOMICAL_UNIT, RADIUS_EARTH, SPEED_OF_LIGHT
from rpojax.core.numerics.runge_kutta import Method
from rpojax.core.orbits.exponential_atmosphere import Atmosphere
from rpojax.core.orbits.sun_moon_ephemeris import SunMoonPositions
from rpojax.core.orbits.zonal_gravity import GravityField
from rpojax.core.pytree import pytree
from rpojax.physics.environment.solar_radiation_pressure import Sunlight
from rpojax.physics.environment.spacecraft_surface import Surface
from rpojax.physics.plant_options import Effects
from rpojax.physics.plant_state import PlantParams, Target, Truth
from rpojax.physics.plume_impingement import Plume
from rpojax.physics.rcs_thrusters import IsolationValves
from rpojax.physics.reaction_wheels import ReactionWheels
from rpojax.physics.rigid_body import Body
from rpojax.physics.thruster import Thruster


@pytree
class AttitudeFeedback:
    """Attitude feedback of a reference: wheel torque `K sigma_BN + P omega_BN_B`, towards q_BN = 1.

    Attributes:
        stiffness: () K [N m]
        damping: () P [N m s]
    """

    stiffness: Array
    damping: Array


def _array(value: Any) -> Array:
    """An array; `jnp.asarray` would compile a program for each shape."""
    return jax.device_put(np.asarray(value))


def plant_effects(reference: Reference, integrator: Method, gravity_gradient: str) -> Effects:
    """Effects of the plant; `gravity_gradient` is "on", "off", or "auto" as in the file."""
    zonals = reference["J"].size if "J" in reference else 0
    return Effects(
        integrator=integrator,
        zonal_degree=zonals + 1 if zonals else 0,
        gravity_gradient=has_gravity_gradient(reference, gravity_gradient),
        drag="Cd" in reference,
        solar_pressure="Cr" in reference,
    )


def active_effects(reference: Reference, effects: Effects, feedback: bool) -> list[str]:
    """Names of the effects that act in a replay."""
    acting = {
        "gravity": "r" in reference or "r_target" in reference,
        "zonals": effects.zonal_degree > 0,
        "attitude": "q" in reference,
        "gravity_gradient": effects.gravity_gradient,
        "wheels": "gs" in reference,
        "wheel_commands": "u_cmd" in reference and not feedback,
        "feedback": feedback,
        "burns": "burns" in reference,
        "drag": effects.drag,
        "sunlight": effects.solar_pressure,
        "shadow": effects.solar_pressure and "R_sun" in reference,
    }
    return [name for name, acts in acting.items() if acts]


def plant_params(reference: Reference) -> PlantParams:
    """Parameters of the plant; a single craft is the servicer."""
    mass, inertia = _array(reference.number("m", 1.0)), _array(_inertia(reference))
    zero, no_vector = jnp.zeros(()), _array(np.zeros(3))
    surface = _surface(reference)
    return PlantParams(
        servicer=Body(mass=mass, inertia=inertia, radius=zero),
        servicer_surface=surface,
        target=Target(
            mass=mass,
            inertia=inertia,
            hull=_array(np.zeros((1, 3))),
            scale=jnp.ones(()),
            tumble_rate=zero,
            tumble_axis=no_vector,
            attitude=_array([1.0, 0.0, 0.0, 0.0]),
        ),
        target_surface=surface,
        thruster=_thruster(zero, no_vector, _array([1.0, 0.0, 0.0])),
        wheels=_wheels(reference),
        gravity=_gravity(reference),
        atmosphere=_atmosphere(reference),
        sunlight=sunlight(reference),
        plume=Plume(
            specific_heat_ratio=jnp.array(1.4),
            exit_mach=jnp.array(5.0),
            nozzle_half_angle=zero,
            boundary_layer=jnp.array(0.1),
            accommodation=zero,
            wall_temperature=zero,
        ),
        isolation=IsolationValves(valve=zero),
    )


def _inertia(reference: Reference) -> Numbers:
    return reference["I"] if "q" in reference else np.eye(3)


def _gravity(reference: Reference) -> GravityField:
    moving = "r" in reference or "r_target" in reference
    zonals = reference["J"] if "J" in reference and reference["J"].size else np.zeros(1)
    return GravityField(
        mu=_array(reference.number("mu") if moving else 0.0),
        radius=_array(reference.number("Re", RADIUS_EARTH)),
        zonals=_array(zonals),
    )


def _wheels(reference: Reference) -> ReactionWheels:
    """Wheels of the file, or three with zero axes, which have no effect."""
    present = any(key in reference for key in ("gs", "u_cmd", "K"))
    axes = reference["gs"] if present else np.zeros((3, 3))
    count = axes.shape[0]
    none, unlimited = _array(np.zeros(count)), _array(np.full(count, np.inf))
    return ReactionWheels(
        axes=_array(axes),
        inertia=_array(per_item(reference, "Js", count)) if present else _array(np.ones(count)),
        torque_limit=_array(per_item(reference, "u_max", count)) if "u_max" in reference else unlimited,
        speed_limit=unlimited,
        initial_speed=_array(reference["Omega0"]) if present else none,
        viscous_friction=none,
        coulomb_friction=none,
        stiction_speed=jnp.ones(()),
        torque_step=jnp.ones(()),
    )


def per_item(reference: Reference, key: str, count: int) -> Numbers:
    """Values (count,) of a key that holds one number for all items or one for each."""
    value = reference[key]
    if value.size not in (1, count):
        raise FormatError(f"{reference.case}: key {key!r} has {value.size} numbers, expected 1 or {count}")
    return np.broadcast_to(value.ravel(), (count,))


def _thruster(force: Array, position: Array, direction: Array) -> Thruster:
    """Thruster with an instant valve and without mass flow."""
    zero, no_vector = jnp.zeros(()), _array(np.zeros(3))
    return Thruster(
        force=force,
        force_scale=jnp.ones(()),
        specific_impulse=zero + jnp.inf,
        minimum_on_time=zero,
        rise_time=zero,
        fall_time=zero,
        position=position,
        direction=direction,
        misalignment=no_vector,
        tank_position=no_vector,
        tank_radius=zero,
        magnitude_noise=zero,
        direction_noise=zero,
    )


_thrusters = jax.jit(jax.vmap(_thruster))


def thrusters(reference: Reference) -> Thruster:
    """Thrusters of the file, along the first axis."""
    if "burns" not in reference:
        return _thrusters(np.zeros(1), np.zeros((1, 3)), np.ones((1, 3)))
    reference.number("m")
    directions = reference["thr_dir"]
    force = per_item(reference, "F_max", directions.shape[0]) * np.linalg.norm(directions, axis=1)
    return _thrusters(force, reference["thr_loc"], directions)


def _surface(reference: Reference) -> Surface:
    exposed = "Cd" in reference or "Cr" in reference
    if exposed:
        reference.number("m")
    return Surface(
        area=_array(reference.number("A") if exposed else 0.0),
        drag_coefficient=_array(reference.number("Cd", 0.0)),
        pressure_coefficient=_array(reference.number("Cr", 0.0)),
        center_of_pressure=_array(np.zeros(3)),
    )


def _atmosphere(reference: Reference) -> Atmosphere:
    """Atmosphere that does not rotate; its density is that at the equatorial radius."""
    present = "Cd" in reference
    return Atmosphere(
        density=_array(reference.number("rho0") if present else 0.0),
        altitude=jnp.zeros(()),
        scale_height=_array(reference.number("H") if present else 1.0),
        rotation=jnp.zeros(()),
    )


def sunlight(reference: Reference) -> Sunlight:
    """Sunlight of the file; without a shadow the Earth is too small to cast one."""
    present = "Cr" in reference
    own_speed = reference.number("c", SPEED_OF_LIGHT)
    return Sunlight(
        # The plant divides by its own speed of light.
        flux=_array(reference.number("flux") * SPEED_OF_LIGHT / own_speed if present else 0.0),
        shadow_radius=_array(reference.number("Re_eclipse") if "Re_eclipse" in reference else 1e-3),
        sun_radius=_array(reference.number("R_sun") if "R_sun" in reference else 6.957e8),
        astronomical_unit=_array(reference.number("AU", ASTRONOMICAL_UNIT)),
    )


def sun_moon_positions(reference: Reference) -> SunMoonPositions:
    """Position of the Sun of the file; the Moon has no effect."""
    needed = "Cr" in reference or "illumination" in reference
    sun = reference["r_sun"] if needed else np.array([ASTRONOMICAL_UNIT, 0.0, 0.0])
    return SunMoonPositions(sun_N=_array(sun), moon_N=_array([0.0, 3.8e8, 0.0]))


def attitude_feedback(reference: Reference) -> AttitudeFeedback | None:
    """Feedback law of the file, if it has one."""
    if "K" not in reference:
        return None
    return AttitudeFeedback(stiffness=_array(reference.number("K")), damping=_array(reference.number("P")))


@jax.jit
def _opposite_rotation(q: Array) -> Array:
    return quaternion.conjugate(quaternion.normalize(q))


def initial_truth(reference: Reference, params: PlantParams) -> Truth:
    """Initial state; a single craft is the servicer, with the target at the same position and attitude."""
    if "r_target" in reference:
        r, v = reference.initial("r0_target", "r_target"), reference.initial("v0_target", "v_target")
        r_ST = reference.initial("r0_chaser", "r_chaser") - r
        v_ST = reference.initial("v0_chaser", "v_chaser") - v
    elif "r" in reference:
        r, v = reference.initial("r0", "r"), reference.initial("v0", "v")
        r_ST = v_ST = np.zeros(3)
    else:
        r, v, r_ST, v_ST = np.array([RADIUS_EARTH, 0.0, 0.0]), np.zeros(3), np.zeros(3), np.zeros(3)
    turning = "q" in reference
    q = reference.initial("q0", "q") if turning else np.array([1.0, 0.0, 0.0, 0.0])
    omega = _array(reference.initial("omega0", "omega") if turning else np.zeros(3))
    q_BN = _opposite_rotation(q)
    return Truth(
        r_TN_N=_array(r),
        v_TN_N=_array(v),
        r_ST_N=_array(r_ST),
        v_ST_N=_array(v_ST),
        q_BN=q_BN,
        omega_BN_B=omega,
        wheel_speed=params.wheels.initial_speed,
        q_TN=q_BN,
        omega_TN_T=omega,
        mass=params.servicer.mass,
        delta_v=jnp.zeros(()),
    )
