"""True parameters and true state of servicer and target."""

from dataclasses import field

import jax.numpy as jnp
from jaxtyping import Array, Float

from rpojax.core import quaternion
from rpojax.core.declared_numbers import number
from rpojax.core.frames import hill_frame, hill_to_inertial
from rpojax.core.orbits import keplerian_elements
from rpojax.core.orbits.exponential_atmosphere import Atmosphere
from rpojax.core.orbits.zonal_gravity import GravityField
from rpojax.core.pytree import pytree
from rpojax.core.quaternion import rotate
from rpojax.physics.environment.solar_radiation_pressure import Sunlight
from rpojax.physics.environment.spacecraft_surface import Surface
from rpojax.physics.equipment_faults import Fault
from rpojax.physics.hull_distance import HullFaces
from rpojax.physics.plume_impingement import Facets, Plume
from rpojax.physics.rcs_thrusters import IsolationValves, RcsThruster
from rpojax.physics.reaction_wheels import ReactionWheels
from rpojax.physics.rigid_body import Body
from rpojax.physics.thruster import Thruster
from rpojax.value_types import Direction, Hull, Inertia, Quaternion

Vector = Float[Array, "3"]


@pytree
class Target:
    """True properties of the target."""

    mass: Array = number("mass", unit="kg", above=0.0)
    inertia: Array = number("inertia about the centre of mass, T", unit="kg_m2", form=Inertia)
    hull: Array = number("vertices that span the outline, from the centre of mass, T", unit="m", form=Hull)
    scale: Array = number(
        "true size of outline and radiance field over that of `hull_m` and `imaging.field`; the belief is "
        "`navigation.target_size_m`, mass and surfaces keep their own keys",
        above=0.0,
        default=1.0,
    )
    tumble_rate: Array = number("rate of rotation at the start", unit="deg_s")
    tumble_axis: Array = number("direction of that rate, T; any length", form=Direction)
    attitude: Array = number("`q_TN` at the start; any length", form=Quaternion)

    @property
    def true_hull(self) -> Float[Array, "n 3"]:
        """Vertices that span the true outline, from the centre of mass in T [m]."""
        return self.hull * self.scale


@pytree
class PlantParams:
    """True parameters of the two vehicles and their environment.

    Attributes:
        faults: of the equipment by name, empty without one
        thrusters: of the reaction control system by name, empty without one
        facets: of the target, None unless plumes push it
        hull_faces: of the target, None unless a phase is in its frame
    """

    servicer: Body
    servicer_surface: Surface
    target: Target
    target_surface: Surface
    thruster: Thruster
    wheels: ReactionWheels
    gravity: GravityField
    atmosphere: Atmosphere
    sunlight: Sunlight
    plume: Plume
    isolation: IsolationValves
    faults: dict[str, Fault] = field(default_factory=dict)
    thrusters: dict[str, RcsThruster] = field(default_factory=dict)
    facets: Facets | None = None
    hull_faces: HullFaces | None = None


@pytree
class Motion:
    """Orbit of the target and motion of the servicer relative to it, in N.

    Attributes:
        r_TN_N: (3,) target position [m]
        v_TN_N: (3,) target velocity [m/s]
        r_ST_N: (3,) servicer from target [m]
        v_ST_N: (3,) its inertial derivative [m/s]
    """

    r_TN_N: Array
    v_TN_N: Array
    r_ST_N: Array
    v_ST_N: Array


@pytree
class Truth(Motion):
    """True state of both vehicles.

    Attributes:
        q_BN: (4,) servicer attitude
        omega_BN_B: (3,) servicer rate [rad/s]
        wheel_speed: (3,) relative to the body [rad/s]
        q_TN: (4,) target attitude
        omega_TN_T: (3,) target rate [rad/s]
        mass: () servicer mass [kg]
        delta_v: () velocity change applied by the thruster so far, summed in magnitude [m/s]
        orbit_low: (2, 3) low-order parts of target position [m] and velocity [m/s] in single precision; else None
        mass_low: () low-order part of the mass in single precision [kg]; else None
        plume_impulse: () impulse of plumes on the target so far, summed in magnitude [N s]; None without plumes
    """

    q_BN: Array
    omega_BN_B: Array
    wheel_speed: Array
    q_TN: Array
    omega_TN_T: Array
    mass: Array
    delta_v: Array
    orbit_low: Array | None = None
    mass_low: Array | None = None
    plume_impulse: Array | None = None


def propellant_used(params: PlantParams, truth: Truth) -> Array:
    """Propellant () that the servicer has used since the start [kg]."""
    used = params.servicer.mass - truth.mass
    return used if truth.mass_low is None else used - truth.mass_low


def initial_truth(
    params: PlantParams, orbit: keplerian_elements.KeplerianElements, rho_H: Vector, rho_dot_H: Vector, q_BN: Array
) -> Truth:
    """Truth at the start of a run: servicer at `rho_H` [m], `rho_dot_H` [m/s], not rotating in H."""
    r_TN_N, v_TN_N = keplerian_elements.state_from_elements(orbit)
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
        plume_impulse=None if params.facets is None else zero,
    )
