"""Derivatives of the kernels in both modes against finite differences, at regular points and at the edges."""

import functools
from collections.abc import Callable
from dataclasses import replace as static
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import rendezvous_scene
from jax.test_util import check_grads
from numpy_reference import IDENTITY, axis_angle_quaternion, random_covariance, random_unit, rotation_matrix, unit
from scipy.optimize import brentq

from rpojax.core import frames, kalman_update, quaternion
from rpojax.core.kalman_update import MeasurementRows
from rpojax.core.numerics import runge_kutta, safe
from rpojax.core.numerics.exact_difference import Difference
from rpojax.core.numerics.runge_kutta import NODES, Method
from rpojax.core.orbits import clohessy_wiltshire, eclipse, keplerian_elements, sun_moon_ephemeris, third_body_gravity, two_body_gravity, zonal_gravity
from rpojax.core.orbits.keplerian_elements import KeplerianElements
from rpojax.core.orbits.zonal_gravity import EARTH_GRAVITY
from rpojax.core.pytree import replace
from rpojax.flight.computer import FlightParams
from rpojax.flight.control import attitude_control, formation_lqr
from rpojax.flight.control.attitude_control import AttitudeCommand
from rpojax.flight.guidance import burn_planning, slew_profile, target_pointing
from rpojax.flight.guidance.slew_profile import SlewReference
from rpojax.flight.navigation import attitude_ekf, orbit_filter, outlier_gate, relative_orbit_ekf, servicer_orbit_ekf
from rpojax.flight.navigation.attitude_ekf import AttitudeEstimate
from rpojax.flight.navigation.filter_tuning import BoxMeasurement, GpsMeasurement
from rpojax.physics import actuators, environment, equipment_faults, plant, rigid_body
from rpojax.physics.actuators import BurnError, ValveCommand
from rpojax.physics.environment import SunMoonPositions
from rpojax.physics.plant import PlantParams, Truth
from rpojax.physics.plant_options import Effects
from rpojax.scenario.params import Params
from rpojax.vision import bounding_box, pinhole

# Central differences with steps of 1e-6 of numbers near one: rounding 1e-10, and a margin for curvature.
TOLERANCE = 1e-5

RNG = np.random.default_rng(1)
Q, P = random_unit(RNG, 4), random_unit(RNG, 4)
V, W = random_unit(RNG), random_unit(RNG)
POSITION = np.array([4.0e6, -3.0e6, 4.5e6])

Kernel = Callable[..., Any]


def check(kernel: Kernel, size: int, *constants: Any) -> None:
    """Compares both derivatives of `kernel(x, *constants)` at x = 0 with finite differences.

    `kernel` is compiled and takes `size` numbers, each scaled so that one means a large change; points that share a
    kernel share its compilation.
    """

    def function(x: jax.Array) -> Any:
        return kernel(x, *constants)

    check_grads(function, (np.zeros(size),), order=1, modes=["fwd", "rev"], atol=TOLERANCE, rtol=TOLERANCE)


def check_finite(kernel: Kernel, size: int, *constants: Any) -> None:
    """Checks that both derivatives are finite where the kernel has a kink or a jump."""

    def function(x: jax.Array) -> Any:
        return kernel(x, *constants)

    value, forward = jax.jvp(function, (np.zeros(size),), (np.ones(size),))
    _, pull_back = jax.vjp(function, np.zeros(size))
    backward = pull_back(jax.tree.map(jnp.ones_like, value))
    for leaf in jax.tree.leaves((value, forward, backward)):
        assert np.all(np.isfinite(leaf))


# Quaternions


@jax.jit
def algebra(x: jax.Array, q: jax.Array, p: jax.Array, v: jax.Array) -> Any:
    q, p, v = q + x[:4], p + x[4:8], v + x[8:]
    return quaternion.multiply(q, p), quaternion.rotate(q, v), quaternion.to_matrix(p), quaternion.normalize(q)


@jax.jit
def exponential(x: jax.Array, phi: jax.Array) -> jax.Array:
    return quaternion.exp(phi + x)


@jax.jit
def logarithm(x: jax.Array, phi: jax.Array) -> jax.Array:
    return quaternion.log(quaternion.exp(phi + x))


@jax.jit
def from_matrix(x: jax.Array, phi: jax.Array) -> jax.Array:
    return quaternion.from_matrix(quaternion.to_matrix(quaternion.exp(phi + x)))


@jax.jit
def turn_from(x: jax.Array, a: jax.Array, b: jax.Array) -> jax.Array:
    """Turn from `a` to `b`, which the small rotation vector `x` moves."""
    return quaternion.rotation_vector_between(a, b + quaternion.cross(x, b))


@jax.jit
def propagated(x: jax.Array, q: jax.Array, omega: jax.Array) -> jax.Array:
    return quaternion.propagate(q, omega + x[:3], 0.2 + x[3])


def test_derivatives_of_quaternion_algebra_are_right() -> None:
    check(algebra, 11, Q, P, V)


@pytest.mark.parametrize("angle", [1.5, 0.0, 1e-5, 3.1], ids=["regular", "zero", "tiny", "nearly half a turn"])
@pytest.mark.parametrize("kernel", [exponential, logarithm, from_matrix], ids=["exp", "log", "from_matrix"])
def test_derivatives_between_rotation_vectors_quaternions_and_matrices_are_right(kernel: Kernel, angle: float) -> None:
    check(kernel, 3, angle * V)


def test_derivatives_of_a_propagated_attitude_are_right() -> None:
    check(propagated, 4, Q, V)


def test_derivatives_of_the_turn_between_directions_are_right() -> None:
    check(turn_from, 3, V, W)


@pytest.mark.parametrize("direction", [np.array([1.0, 0.0, 0.0]), V], ids=["an axis", "a skew direction"])
def test_the_turn_between_equal_directions_follows_the_second_one(direction: np.ndarray) -> None:
    found = jax.jacfwd(turn_from)(np.zeros(3), direction, direction)
    # A small rotation x of the second direction is a turn by the part of x across it.
    np.testing.assert_allclose(found, np.eye(3) - np.outer(direction, direction), atol=TOLERANCE)


def test_the_turn_between_opposite_directions_has_a_finite_derivative() -> None:
    check_finite(turn_from, 3, V, -V)


# Orbits and frames


@jax.jit
def orbit_state(x: jax.Array) -> Any:
    a, e, i, raan, w, nu = jnp.array([7.0e6, 0.0, 1.7, 1.3, 1.5, 0.4]) + x * jnp.array([1e6, 1, 1, 1, 1, 1.0])
    elements = KeplerianElements(
        semi_major_axis=a, eccentricity=e, inclination=i, raan=raan, argument_of_perigee=w, true_anomaly=nu
    )
    r_N, v_N = keplerian_elements.state_from_elements(elements)
    return r_N / 7e6, v_N / 7e3


@jax.jit
def gravities(x: jax.Array, r_N: jax.Array, d_N: jax.Array) -> Any:
    r = Difference(value=r_N + 1e6 * x[:3], change=d_N + 10.0 * x[3:])
    pull = zonal_gravity.gravity(EARTH_GRAVITY, 6, r)
    moon = third_body_gravity.third_body_acceleration(4.9028e12, 3.84e8 * jnp.asarray(W), r)
    gradient = two_body_gravity.gravity_gradient(r.value)
    return pull.value, 1e4 * pull.change, 1e6 * moon.value, 1e11 * moon.change, 1e6 * gradient


@jax.jit
def transition(x: jax.Array) -> Any:
    phi = clohessy_wiltshire.transition_matrix(1e-3 * (1.0 + x[0]), 200.0 * (1.0 + x[1]))
    scale = jnp.repeat(jnp.array([1.0, 1e-2]), np.array([3, 3]), total_repeat_length=6)
    return phi * scale[None, :] / scale[:, None]


@jax.jit
def axes(x: jax.Array, r_N: jax.Array, v_N: jax.Array) -> Any:
    R_HN, omega_N = frames.hill_frame(r_N + 1e6 * x[:3], v_N + 1e3 * x[3:6])
    return R_HN, 1e3 * omega_N, frames.look_at(v_N / 7e3 + x[6:9], r_N / 7e6 + x[9:])


def test_derivatives_of_the_state_from_elements_are_right_on_a_circular_orbit() -> None:
    check(orbit_state, 6)


@pytest.mark.parametrize("distance", [50.0, 0.0], ids=["apart", "at the target"])
@pytest.mark.parametrize("place", [POSITION, np.array([0.0, 0.0, 7e6])], ids=["anywhere", "over the pole"])
def test_derivatives_of_gravity_and_its_differences_are_right(place: np.ndarray, distance: float) -> None:
    check(gravities, 6, place, distance * V)


@jax.jit
def harmonics(x: jax.Array, r_N: jax.Array) -> Any:
    """What is left of gravity after the pull of a point, to its own constants."""
    field = replace(
        EARTH_GRAVITY,
        radius=EARTH_GRAVITY.radius * (1.0 + 0.1 * x[3]),
        zonals=jnp.asarray(EARTH_GRAVITY.zonals) + 1e-3 * x[4:],
    )
    r = Difference(value=r_N + 1e6 * x[:3], change=50.0 * jnp.asarray(V))
    full, point = (zonal_gravity.gravity(field, degree, r) for degree in (6, 0))
    return 1e2 * (full.value - point.value), 1e6 * (full.change - point.change)


@pytest.mark.parametrize("place", [POSITION, np.array([0.0, 0.0, 7e6]), np.array([0.0, -7e6, 0.0])],
                         ids=["anywhere", "over the pole", "over the equator"])  # fmt: skip
def test_derivatives_of_the_zonal_harmonics_are_right(place: np.ndarray) -> None:
    check(harmonics, 9, place)


@jax.jit
def sky(x: jax.Array) -> Any:
    seconds = 8e8 + 1e5 * x[0]
    return sun_moon_ephemeris.sun_position(seconds) / 1e10, sun_moon_ephemeris.moon_position(seconds) / 1e8


def test_derivatives_of_sun_and_moon_to_time_are_right() -> None:
    check(sky, 1)


def swing(x: jax.Array, method: Method) -> Any:
    """A pendulum over one step, forced at the method's nodes."""
    forces = 1.0 + x[2] * jnp.asarray(NODES[method])
    start = (0.5 + x[0], 1.0 + x[1])
    return runge_kutta.step(method, lambda y, u: (y[1], u * (1.0 + x[3]) - jnp.sin(y[0])), start, forces, 0.5)


rk4_swing, rk8_swing = (jax.jit(lambda x, method=method: swing(x, method)) for method in ("rk4", "rk8"))


@pytest.mark.parametrize("kernel", [rk4_swing, rk8_swing], ids=["rk4", "rk8"])
def test_derivatives_through_a_step_of_integration_are_right(kernel: Kernel) -> None:
    check(kernel, 4)


# Light


SUN_N = np.array([1.2e11, 0.0, 9e10])


@jax.jit
def lit_share(x: jax.Array, r_N: jax.Array) -> jax.Array:
    """One along each axis is a penumbra's width in low orbit."""
    return eclipse.illumination(
        r_N + 3e4 * x[:3], SUN_N * (1.0 + 0.01 * x[3]), 6378137.0 + 3e4 * x[4], 7e8 + 1e7 * x[5]
    )


def behind(distance: float, off_axis: float) -> np.ndarray:
    """Place in the night at a distance from the Earth's centre and an angle off the shadow's axis."""
    axis, across = -unit(SUN_N), unit(np.cross(SUN_N, V))
    return distance * (np.cos(off_axis) * axis + np.sin(off_axis) * across)


def touching(distance: float, inner: bool, sun_radius: float = 7e8) -> float:
    """Angle off the axis of a border of the penumbra."""

    def gap(angle: float) -> float:
        r = behind(distance, angle)
        to_sun = SUN_N - r
        sun, earth = np.arcsin(sun_radius / np.linalg.norm(to_sun)), np.arcsin(6378137.0 / distance)
        apart = np.arctan2(np.linalg.norm(np.cross(to_sun, r)), -to_sun @ r)
        return apart - (abs(earth - sun) if inner else earth + sun)

    return brentq(gap, 0.0, np.pi / 2, xtol=1e-15)


@pytest.mark.parametrize(
    "way",
    [-0.1, 0.05, 0.3, 0.5, 0.8, 0.95, 1.1],
    ids=["umbra", "just inside", "a third", "half", "most of it", "almost outside", "light"],
)
@pytest.mark.parametrize("distance", [7.0e6, 4.2e7], ids=["low orbit", "geostationary"])
def test_derivatives_of_the_light_are_right_in_and_beside_the_penumbra(distance: float, way: float) -> None:
    inner, outer = touching(distance, True), touching(distance, False)
    check(lit_share, 6, behind(distance, inner + way * (outer - inner)))


@pytest.mark.parametrize("off_axis", [1e-3, 4e-3, 7e-3], ids=["ring", "partial", "light"])
def test_derivatives_of_the_light_are_right_beyond_the_end_of_the_umbra(off_axis: float) -> None:
    check(lit_share, 6, behind(3e9, off_axis))


@pytest.mark.parametrize("inner", [True, False], ids=["inner border", "outer border"])
@pytest.mark.parametrize("distance", [7.0e6, 3e9], ids=["low orbit", "beyond the umbra"])
def test_the_light_has_finite_derivatives_on_the_borders_of_the_penumbra(distance: float, inner: bool) -> None:
    edge = touching(distance, inner)
    for off in (0.0, 1e-15, -1e-15, 1e-12, -1e-12):
        check_finite(lit_share, 6, behind(distance, edge + off))


@pytest.mark.parametrize("distance", [7.0e6, 1.3e9, 3e9], ids=["umbra", "its far end", "ring"])
@pytest.mark.parametrize("side", [1.0, -1.0], ids=["night", "day"])
def test_the_light_has_finite_derivatives_on_the_axis_of_the_shadow(distance: float, side: float) -> None:
    check_finite(lit_share, 6, side * behind(distance, 0.0))


def test_derivatives_of_the_relative_transition_are_right() -> None:
    check(transition, 2)


def test_derivatives_of_hill_and_camera_axes_are_right() -> None:
    check(axes, 12, POSITION, 7e3 * W)


# Measurement updates


@jax.jit
def measurement_update(x: jax.Array, covariance: jax.Array, z: jax.Array, H: jax.Array, R: jax.Array) -> Any:
    rows = MeasurementRows(
        residual=z + x[:3],
        jacobian=H + x[3:15].reshape(3, 4),
        variance=R * (1.0 + x[15:18]),
        weight=jnp.array([1.0, 0.0, 1.0]),
    )
    return kalman_update.update(covariance * (1.0 + x[18]), rows)


def test_derivatives_of_a_measurement_update_are_right() -> None:
    rng = np.random.default_rng(2)
    check(
        measurement_update,
        19,
        random_covariance(rng, np.ones(4)),
        rng.normal(size=3),
        rng.normal(size=(3, 4)),
        rng.uniform(0.5, 2.0, 3),
    )


# Physics


@jax.jit
def torques(x: jax.Array, plant_params: PlantParams, speed: jax.Array) -> Any:
    """Wheel torques, what they do to body and wheels, and the gravity gradient."""
    body, wheels = plant_params.servicer, plant_params.wheels
    command = jnp.array([0.01, 0.1, 0.02]) + x[:3]
    motor = actuators.limit_torque(wheels, command, speed + x[3:6], 0.2)
    hub = rigid_body.inverse_hub_inertia(body.inertia, wheels.axes, wheels.inertia)
    omega = 0.1 * V + 0.1 * x[6:9]
    torque = 1e4 * environment.gravity_gradient_torque(POSITION + 1e6 * x[9:], body.inertia)
    found = rigid_body.accelerations_with_wheels(
        body.inertia, hub, wheels.axes, wheels.inertia, omega, speed, motor, torque
    )
    return found[0], 1e-2 * found[1]


@pytest.mark.parametrize("speed", [0.0, 627.5, 628.0], ids=["free", "near the speed limit", "at the speed limit"])
def test_derivatives_of_wheel_and_body_torques_are_right_also_when_saturated(params: Params, speed: float) -> None:
    if speed == 628.0:
        check_finite(torques, 12, params.plant, np.array([0.0, 0.0, speed]))
    else:
        check(torques, 12, params.plant, np.array([0.0, 0.0, speed]))


@jax.jit
def surface_forces(x: jax.Array, plant_params: PlantParams, r_N: jax.Array, v_N: jax.Array, sun_N: jax.Array) -> Any:
    air, sunlight, surface = plant_params.atmosphere, plant_params.sunlight, plant_params.servicer_surface
    air = replace(air, density=air.density * (1.0 + x[6]), scale_height=air.scale_height * (1.0 + x[7]))
    surface = replace(surface, area=surface.area * (1.0 + x[8]))
    r_N, v_N = r_N + 1e4 * x[:3], v_N + 1e3 * x[3:6]
    drag = environment.drag(air, surface, plant_params.gravity.radius, r_N, v_N)
    share = environment.sunlit_fraction(sunlight, r_N, sun_N)
    return 1e5 * drag, 1e6 * environment.solar_radiation_pressure(sunlight, surface, r_N, sun_N, share)


@pytest.mark.parametrize("speed", [7.6e3, 1.0], ids=["in orbit", "nearly with the air"])
@pytest.mark.parametrize("way", [0.0, 0.4, 2.0], ids=["umbra's border", "penumbra", "light"])
def test_derivatives_of_drag_and_light_pressure_are_right(params: Params, way: float, speed: float) -> None:
    inner, outer = (touching(7.0e6, border, 6.957e8) for border in (True, False))
    r_N = behind(7.0e6, inner + way * (outer - inner))
    wind = 7.292115e-5 * np.array([-r_N[1], r_N[0], 0.0])
    compare = check_finite if way == 0.0 else check
    compare(surface_forces, 9, params.plant, r_N, wind + speed * W, SUN_N)


def test_drag_has_finite_derivatives_on_a_craft_that_rests_in_the_air(params: Params) -> None:
    still = replace(params.plant, atmosphere=replace(params.plant.atmosphere, rotation=jnp.zeros(())))
    check_finite(surface_forces, 9, still, POSITION, np.zeros(3), SUN_N)


@jax.jit
def wheel_drive(x: jax.Array, plant_params: PlantParams, command: jax.Array, speed: jax.Array) -> Any:
    wheels, speed = plant_params.wheels, speed + 10.0 * x[3:6]
    wheels = replace(
        wheels,
        coulomb_friction=wheels.coulomb_friction * (1.0 + x[6:9]),
        stiction_speed=wheels.stiction_speed * (10.0 + x[9]),
    )
    motor = actuators.limit_torque(wheels, command + 0.01 * x[:3], speed, 0.2)
    return 1e2 * motor, 1e3 * actuators.bearing_friction(wheels, speed)


@pytest.mark.parametrize("speed", [0.0, 300.0, 627.0, -640.0], ids=["at rest", "fast", "near its limit", "beyond it"])
def test_derivatives_of_motor_torque_and_friction_are_right(params: Params, speed: float) -> None:
    check(wheel_drive, 10, params.plant, np.array([0.01, 0.04, 0.02]), np.array([0.0, 1.0, speed]))


def test_motor_torque_and_friction_have_finite_derivatives_at_the_limits_of_torque_and_speed(params: Params) -> None:
    check_finite(wheel_drive, 10, params.plant, np.array([0.025, -0.025, 0.0]), np.array([0.0, 628.0, -628.0]))


@functools.partial(jax.jit, static_argnums=(4, 5))
def valve(
    x: jax.Array, plant_params: PlantParams, ignition: jax.Array, on_time: jax.Array, method: Method, ramps: bool
) -> Any:
    """Openings of a thruster of any on-time, and what it does."""
    known = plant_params.thruster
    thruster = replace(
        known,
        minimum_on_time=jnp.zeros(()),
        rise_time=known.rise_time * (1.0 + 0.1 * x[0]),
        fall_time=known.fall_time * (1.0 + 0.1 * x[1]),
        misalignment=0.1 * x[2:5],
        force=known.force * (1.0 + x[5]),
    )
    error = BurnError(magnitude=x[6], direction=0.1 * x[7:10])
    begin = ignition + 0.02 * x[10]
    burn = ValveCommand(ignition=begin, cutoff=begin + on_time + 0.02 * x[11], burn_error=error)
    found = actuators.thrust_over_step(thruster, burn, method, ramps, 0.2)
    shift = actuators.center_of_mass_shift(thruster, 1.0 + x[12], 30.0 - x[12])
    return found.node_factors, 1e2 * found.force_B, 1e4 * found.mass_flow, 1e2 * shift


VALVES: tuple[tuple[Method, bool], ...] = (("rk4", False), ("rk4", True), ("rk8", True))


@pytest.mark.parametrize(("method", "ramps"), VALVES, ids=["on or off", "ramps", "ramps for the checks"])
@pytest.mark.parametrize(
    ("ignition", "on_time"),
    [(0.03, 0.02), (0.03, 0.11), (-1.0, 1.1), (0.17, 1.0), (-0.3, 0.27)],
    ids=["cut while it rises", "inside", "ends inside", "starts inside", "falls inside"],
)
def test_derivatives_of_a_thruster_over_a_step_are_right(
    params: Params, ignition: float, on_time: float, method: Method, ramps: bool
) -> None:
    check(lambda *arguments: valve(*arguments, method, ramps), 13, params.plant, np.float64(ignition),
          np.float64(on_time))  # fmt: skip


@pytest.mark.parametrize("ramps", [False, True], ids=["on or off", "ramps"])
@pytest.mark.parametrize(
    ("ignition", "on_time"),
    [(0.1, 0.0), (0.1, 0.05), (0.0, 0.2), (0.2, 0.5), (-0.08, 0.0)],
    ids=["no time", "just risen", "exactly the step", "from the end on", "just fallen"],
)
def test_a_thruster_has_finite_derivatives_where_its_profile_has_a_corner(
    params: Params, ignition: float, on_time: float, ramps: bool
) -> None:
    check_finite(lambda *arguments: valve(*arguments, "rk4", ramps), 13, params.plant, np.float64(ignition),
                 np.float64(on_time))  # fmt: skip


NOMINAL = Effects()
FULL = Effects(
    zonal_degree=6,
    sun_gravity=True,
    moon_gravity=True,
    drag=True,
    solar_pressure=True,
    wheel_friction=True,
    thruster_ramps=True,
    center_of_mass_shift=True,
    faults=True,
)
"""All but the steps of torque, which no finite difference follows; their derivative has its own test."""
SKY = SunMoonPositions(sun_N=jnp.asarray(SUN_N), moon_N=3.84e8 * jnp.asarray(W))


def plant_step(
    effects: Effects, x: jax.Array, plant_params: PlantParams, truth: Truth, ignition: jax.Array, cutoff: jax.Array
) -> Any:
    """Parts of the truth after a step, each over what a large change of it would be."""
    moved = replace(
        truth,
        r_TN_N=truth.r_TN_N + 1e5 * x[15:18],
        r_ST_N=truth.r_ST_N + x[:3],
        omega_BN_B=truth.omega_BN_B + 0.1 * x[3:6],
        mass=truth.mass + 10.0 * x[6],
        wheel_speed=truth.wheel_speed + x[18:],
    )
    error = BurnError(magnitude=0.1 * x[8], direction=0.1 * x[9:12])
    command = jnp.array([0.01, 0.1, 0.01]) + 0.01 * x[12:15]
    burn = ValveCommand(ignition=ignition, cutoff=cutoff + 0.1 * x[7], burn_error=error)
    thrust = actuators.thrust_over_step(plant_params.thruster, burn, effects.integrator, effects.thruster_ramps, 0.2)
    failed = replace(
        equipment_faults.healthy(),
        thrust_fraction=jnp.asarray(0.6),
        wheel_friction=jnp.array([0.1, 0.0, 0.0]),
        wheel_stuck=jnp.array([False, True, False]),
    )
    after = plant.step(effects, plant_params, moved, command, (thrust,), SKY, failed, 0.2)
    gained = (after.v_ST_N - truth.v_ST_N) * 1e3
    turned = (after.omega_BN_B, after.q_BN, 1e-2 * (after.wheel_speed - truth.wheel_speed))
    target = (1e-1 * (after.v_TN_N - truth.v_TN_N), 1e3 * (after.omega_TN_T - truth.omega_TN_T))
    return after.r_ST_N - truth.r_ST_N, gained, *turned, *target, 1e4 * (after.mass - truth.mass)


nominal_step, full_step, rk8_step = (
    jax.jit(functools.partial(plant_step, effects)) for effects in (NOMINAL, FULL, static(FULL, integrator="rk8"))
)


@pytest.fixture(scope="module")
def truth(params: Params) -> Truth:
    start = plant.initial_truth(
        params.plant,
        params.orbit,
        jnp.array([2.0, -30.0, 1.0]),
        jnp.array([0.01, 0.0, 0.0]),
        jnp.asarray(axis_angle_quaternion(V, 0.7)),
    )
    return replace(start, wheel_speed=jnp.array([10.0, -20.0, 628.5]))  # the third beyond its limit


@pytest.fixture(scope="module")
def ready(params: Params) -> PlantParams:
    """The plant with a thruster of any on-time, and with sunlight and air strong enough to be seen in a step."""
    return replace(
        params.plant,
        thruster=replace(params.plant.thruster, minimum_on_time=jnp.zeros(())),
        sunlight=replace(params.plant.sunlight, flux=jnp.float64(1e8)),
        atmosphere=replace(params.plant.atmosphere, density=jnp.float64(1e-8)),
    )


STEPS = pytest.mark.parametrize("kernel", [nominal_step, full_step], ids=["nominal", "every effect"])


@STEPS
@pytest.mark.parametrize(("ignition", "cutoff"), [(-1.0, 0.13), (0.4, 0.9)], ids=["burning", "coasting"])
def test_derivatives_of_a_step_of_the_plant_are_right_with_a_saturated_wheel(
    ready: PlantParams, truth: Truth, kernel: Kernel, ignition: float, cutoff: float
) -> None:
    check(kernel, 21, ready, truth, np.float64(ignition), np.float64(cutoff))


@pytest.mark.slow
def test_derivatives_of_a_step_of_the_checking_integrator_are_right(ready: PlantParams, truth: Truth) -> None:
    check(rk8_step, 21, ready, truth, np.float64(-1.0), np.float64(0.13))


@STEPS
def test_derivatives_of_a_step_of_the_plant_are_right_where_nothing_turns(
    ready: PlantParams, truth: Truth, kernel: Kernel
) -> None:
    resting = replace(truth, omega_BN_B=jnp.zeros(3), omega_TN_T=jnp.zeros(3), wheel_speed=jnp.zeros(3))
    check(kernel, 21, ready, resting, np.float64(-1.0), np.float64(0.13))


def test_derivatives_of_a_step_of_the_plant_are_right_in_the_penumbra(ready: PlantParams, truth: Truth) -> None:
    inner, outer = touching(7.0e6, True, 6.957e8), touching(7.0e6, False, 6.957e8)
    there = replace(truth, r_TN_N=jnp.asarray(behind(7.0e6, 0.6 * inner + 0.4 * outer)))
    check(full_step, 21, ready, there, np.float64(-1.0), np.float64(0.13))


@STEPS
def test_a_step_of_the_plant_has_finite_derivatives_with_a_burn_of_no_duration(
    params: Params, ready: PlantParams, truth: Truth, kernel: Kernel
) -> None:
    for plant_params in (params.plant, ready):
        check_finite(kernel, 21, plant_params, truth, np.float64(0.1), np.float64(0.1))


@pytest.mark.parametrize("inner", [True, False], ids=["inner border", "outer border"])
def test_a_step_of_the_plant_has_finite_derivatives_at_the_border_of_the_shadow_with_wheels_at_their_limits(
    ready: PlantParams, truth: Truth, inner: bool
) -> None:
    edge = replace(
        truth,
        r_TN_N=jnp.asarray(behind(7.0e6, touching(7.0e6, inner, 6.957e8))),
        r_ST_N=jnp.zeros(3),
        wheel_speed=jnp.array([628.0, 0.0, -628.0]),
    )
    check_finite(full_step, 21, ready, edge, np.float64(0.1), np.float64(0.1))


def test_a_step_of_the_plant_has_finite_derivatives_with_a_thruster_without_force(
    ready: PlantParams, truth: Truth
) -> None:
    dead = replace(ready, thruster=replace(ready.thruster, force_scale=jnp.zeros(())))
    check_finite(nominal_step, 21, dead, truth, np.float64(-1.0), np.float64(0.13))


# Vision


@jax.jit
def outline(x: jax.Array, hull_K: jax.Array) -> jax.Array:
    lens = pinhole.pinhole_intrinsics(0.2 + 0.01 * x[12], 128, 128)
    return 1e-2 * bounding_box.projected_box(lens, hull_K + x[:12].reshape(4, 3))


def test_derivatives_of_the_outline_are_right() -> None:
    check(outline, 13, np.array([[1.0, 0.2, 30.0], [-1.1, -0.3, 29.0], [0.1, 0.9, 31.0], [0.2, -1.2, 30.5]]))


def test_the_outline_has_finite_derivatives_with_points_behind_the_camera_and_at_its_centre() -> None:
    check_finite(outline, 13, np.array([[1.0, 0.2, -30.0], [0.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.2, -1.2, 30.5]]))


# Attitude


@jax.jit
def wheel_command(x: jax.Array, flight: FlightParams, q_BC: jax.Array) -> jax.Array:
    q_BN = quaternion.multiply(quaternion.exp(0.1 * x[:3]), q_BC)
    omega = 0.01 * x[3:6]
    body = AttitudeEstimate(
        q_BN=q_BN, omega_BN_B=omega, bias_B=jnp.zeros(3), gyro_B=omega, covariance=jnp.zeros((6, 6))
    )
    command = AttitudeCommand(q_CN=jnp.asarray(IDENTITY), omega_CN_C=0.01 * x[6:], acceleration_C=jnp.zeros(3))
    speed = jnp.array([10.0, -20.0, 30.0])
    return 10.0 * attitude_control.wheel_torque(
        flight.attitude_control, flight.vehicle, jnp.eye(3), body, command, speed
    )


@pytest.mark.parametrize("angle", [0.0, 0.02, 2.0], ids=["no error", "small error", "saturated"])
def test_derivatives_of_the_attitude_controller_are_right(params: Params, angle: float) -> None:
    check(wheel_command, 9, params.flight, axis_angle_quaternion(V, angle))


@jax.jit
def attitude_update(x: jax.Array, flight: FlightParams, q_BN: jax.Array) -> Any:
    tuning = flight.attitude_filter
    before = attitude_ekf.initial(tuning, q_BN, 0.01 * jnp.asarray(V))
    measured = quaternion.multiply(quaternion.exp(1e-3 * x[:3]), q_BN)
    louder = replace(tuning, star_tracker_noise=tuning.star_tracker_noise * (1.0 + x[3:]))
    after = attitude_ekf.update(louder, before, measured, jnp.asarray(True))
    return 1e3 * after.q_BN, 1e3 * after.bias_B, 1e6 * after.covariance


def test_derivatives_of_the_attitude_filters_update_are_right(params: Params) -> None:
    check(attitude_update, 6, params.flight, Q)


@jax.jit
def slew_command(x: jax.Array, q_EN: jax.Array, remainder: jax.Array, age: jax.Array) -> AttitudeCommand:
    reference = SlewReference(
        q_EN=q_EN,
        omega_EN_E=0.01 * x[:3],
        remainder=remainder + x[3:6],
        slew_age=jnp.zeros(()),
        slew_time=20.0 + x[6],
    )
    return slew_profile.evaluate(reference, age)


@pytest.mark.parametrize("size", [0.0, 1.0], ids=["no angle", "a radian"])
@pytest.mark.parametrize("age", [0.0, 4.0, 30.0], ids=["its start", "its middle", "after its end"])
def test_derivatives_of_a_slew_are_right(age: float, size: float) -> None:
    check(slew_command, 7, Q, size * W, np.float64(age))


@jax.jit
def slew_duration(x: jax.Array, flight: FlightParams, angle: jax.Array) -> jax.Array:
    return slew_profile.slew_duration(flight.pointing, angle + x[0])


@pytest.mark.parametrize("angle", [0.0, 1e-12], ids=["zero", "nearly zero"])
def test_the_duration_of_a_slew_over_no_angle_has_a_finite_derivative(params: Params, angle: float) -> None:
    check_finite(slew_duration, 1, params.flight, np.float64(angle))


@jax.jit
def planned_burn(x: jax.Array, flight: FlightParams, r_TS_N: jax.Array, gain: jax.Array) -> Any:
    known = rendezvous_scene.estimate(flight, r_TS_N + x[:3], 0.01 * jnp.asarray(V) + 0.01 * x[3:6])
    law, gain = formation_lqr.lqr_feedback, gain * (1.0 + 0.1 * x[6])
    allowed, time = jnp.asarray(True), jnp.asarray(0.0)
    station = formation_lqr.solve_station_keeping(flight.formation, jnp.asarray(1.1e-3), 200.0)
    q_BN, omega = target_pointing.look_attitude(flight.vehicle, known)
    plan = burn_planning.plan_burn(
        law, flight.formation, flight.pointing, flight.vehicle, gain, station, known, q_BN, allowed, time
    )
    return 0.1 * plan.ignition, 0.1 * plan.cutoff, 1e2 * plan.delta_v_N, plan.q_burn, q_BN, 1e2 * omega


def test_derivatives_of_the_burn_plan_and_of_the_look_attitude_are_right(params: Params) -> None:
    gain = formation_lqr.lqr_gain(params.flight.formation, jnp.asarray(1.1e-3), 200.0)
    check(planned_burn, 7, params.flight, rendezvous_scene.TARGET_AHEAD + np.array([1.0, -2.0, 3.0]), gain)


# The orbit filter


@jax.jit
def prediction(x: jax.Array, flight: FlightParams, delta_v_N: jax.Array) -> Any:
    known = rendezvous_scene.estimate(flight)
    relative = replace(known.relative, r_TS_N=known.relative.r_TS_N + 10.0 * x[:3])
    servicer = replace(known.servicer, v_SN_N=known.servicer.v_SN_N + 10.0 * x[3:6])
    tuning = replace(flight.navigation, relative_acceleration_noise=1e-3 * (1.0 + x[6]))
    moved = replace(known, relative=relative, servicer=servicer)
    gained, doubt, pull_N = delta_v_N + 1e-3 * x[7:10], 2.0 + x[10], 1e-6 * x[11:]
    after = orbit_filter.predict(tuning, 6, moved, gained, jnp.asarray(0.02), doubt, pull_N, 1.0)
    sigma = jnp.repeat(jnp.array([0.2, 1e-3, 0.1, 1e-3, 5e-3]), np.array([3, 3, 2, 2, 2]), total_repeat_length=12)
    return (
        after.relative.r_TS_N - known.relative.r_TS_N,
        after.servicer.r_SN_N - known.servicer.r_SN_N,
        after.relative.covariance / (sigma[:, None] * sigma[None, :]),
    )


def test_derivatives_of_the_orbit_filters_prediction_are_right_during_a_burn(params: Params) -> None:
    check(prediction, 14, params.flight, 1e-3 * V)


def test_the_orbit_filters_prediction_has_finite_derivatives_to_a_velocity_change_of_zero(params: Params) -> None:
    check_finite(prediction, 14, params.flight, np.zeros(3))


@jax.jit
def box_update(x: jax.Array, flight: FlightParams, q_KN: jax.Array, box: BoxMeasurement, sigma: jax.Array) -> Any:
    """Update by a box that the one before it confirms, of a target known to `sigma` [m]."""
    known = rendezvous_scene.estimate(flight).relative
    spread = jnp.eye(12).at[:3, :3].multiply(sigma**2 / 0.2**2)
    moved = replace(known, r_TS_N=known.r_TS_N + x[:3], covariance=known.covariance * spread)
    measured = replace(box, tangent=box.tangent + 0.1 * x[3:5], log_size=box.log_size + x[5])
    tuning = replace(flight.navigation, edge_noise=1.0 + x[6], scale_sigma=flight.navigation.scale_sigma + 0.1 * x[7:])
    track = replace(
        outlier_gate.initial(), direction_N=jnp.asarray(unit(rendezvous_scene.TARGET_AHEAD)), age=jnp.ones(())
    )
    after, _, result, _, _ = relative_orbit_ekf.update(
        tuning, True, flight.vehicle.focal_px, moved, track, q_KN, measured
    )
    return after.r_TS_N - known.r_TS_N, after.scale, 1e2 * after.covariance, 1e-3 * result.log_likelihood


@pytest.fixture(scope="module")
def q_KN(params: Params) -> np.ndarray:
    """Attitude of a camera that looks at the target."""
    return rendezvous_scene.camera_attitude(params.flight, rendezvous_scene.estimate(params.flight))


@pytest.mark.parametrize("present", [True, False], ids=["with a box", "without a box"])
@pytest.mark.parametrize("sigma", [0.05, 1.0], ids=["narrow prior", "wide prior"])
def test_derivatives_of_a_box_update_are_right_far_from_the_gates_border(
    params: Params, q_KN: np.ndarray, sigma: float, present: bool
) -> None:
    box = rendezvous_scene.box(params.flight, rotation_matrix(q_KN), rendezvous_scene.TARGET_AHEAD, present=present)
    check(box_update, 9, params.flight, q_KN, box, np.float64(sigma))


@pytest.mark.parametrize("offset", [0.01, 0.05], ids=["near the border", "outlier"])
def test_a_box_update_has_finite_derivatives_at_and_beyond_the_gates_border(
    params: Params, q_KN: np.ndarray, offset: float
) -> None:
    box = rendezvous_scene.box(params.flight, rotation_matrix(q_KN), rendezvous_scene.TARGET_AHEAD)
    moved = replace(box, tangent=box.tangent + jnp.array([offset, 0.0]))
    check_finite(box_update, 9, params.flight, q_KN, moved, np.float64(0.05))


@jax.jit
def gps_update(x: jax.Array, flight: FlightParams, gps_N: jax.Array) -> Any:
    tuning = replace(flight.navigation, gps_noise=2.0 + x[3])
    gps = GpsMeasurement(position_N=gps_N + x[:3], present=jnp.asarray(True))
    after, result = servicer_orbit_ekf.update(tuning, rendezvous_scene.estimate(flight).servicer, gps)
    return after.r_SN_N - rendezvous_scene.R_SN_N, after.gps_error_N, result.log_likelihood


def test_derivatives_of_a_gps_update_are_right(params: Params) -> None:
    check(gps_update, 4, params.flight, rendezvous_scene.R_SN_N + 3.0 * V)


def test_the_gate_passes_a_derivative_only_near_its_threshold() -> None:
    slope = jax.jit(jax.grad(lambda x: safe.gate(x, jnp.asarray(0.1))))
    assert float(slope(0.01)) > 1.0
    assert float(slope(-0.01)) > 1.0
    assert float(slope(50.0)) == 0.0
