"""Speed of orbit propagation with J2: many vehicles at once, by classical Runge-Kutta steps."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import jax
import numpy as np
from jaxtyping import Array, Float

from rpojax.benchmark.timed_device_programs import MultiDeviceProgram, compile_for_devices
from rpojax.core.constants import MU_EARTH, RADIUS_EARTH, ZONALS_EARTH
from rpojax.runtime.programs_per_device import choose_devices

Vectors = Float[Array, "3 n"]

DEFAULT_VEHICLES = 1024
"""Vehicles per device: as many as a core's fast memory holds."""
DEFAULT_STEPS = 10_000
STEP_S = 0.2

_POLAR_FACTORS = np.array([[1.0], [1.0], [3.0]])


@dataclass(frozen=True)
class OrbitSpeed:
    """Speed of orbit propagation.

    Attributes:
        vehicles: at once, on all devices together
        devices: devices that share them
        steps: of each vehicle in a pass
        step_s: length of a step, four force evaluations [s]
        compile_s: tracing and compiling [s]
        run_s: fastest pass [s]
        cpu_s: processor time of that pass [s]
        vehicle_steps_per_s: steps of all vehicles per second
    """

    vehicles: int
    devices: int
    steps: int
    step_s: float
    compile_s: float
    run_s: float
    cpu_s: float
    vehicle_steps_per_s: float


def j2_gravity(r_N: Vectors) -> Vectors:
    """Gravity [m/s^2] with J2 at the positions [m] of many vehicles, vehicles in the last axis.

    Equal to `zonal_gravity.gravity` at degree 2 without its differences. XLA stores only one reciprocal root per
    vehicle; written as a sum over the components, the radius would be stored too, in another layout.
    """
    square = r_N[0:1] * r_N[0:1] + r_N[1:2] * r_N[1:2] + r_N[2:3] * r_N[2:3]
    inverse = jax.lax.rsqrt(square)
    inverse2 = inverse * inverse
    oblateness = 1.5 * ZONALS_EARTH[0] * RADIUS_EARTH**2 * inverse2
    sine2 = r_N[2:3] * r_N[2:3] * inverse2
    return -MU_EARTH * inverse * inverse2 * (1.0 + oblateness * (_POLAR_FACTORS - 5.0 * sine2)) * r_N


def rk4_step(r_N: Vectors, v_N: Vectors, dt: float) -> tuple[Vectors, Vectors]:
    """Positions and velocities after one classical Runge-Kutta step, unrolled, as a loop over its stages is slower."""
    half = 0.5 * dt
    a1 = j2_gravity(r_N)
    v2 = v_N + half * a1
    a2 = j2_gravity(r_N + half * v_N)
    v3 = v_N + half * a2
    a3 = j2_gravity(r_N + half * v2)
    v4 = v_N + dt * a3
    a4 = j2_gravity(r_N + dt * v3)
    return r_N + dt / 6.0 * (v_N + 2.0 * v2 + 2.0 * v3 + v4), v_N + dt / 6.0 * (a1 + 2.0 * a2 + 2.0 * a3 + a4)


def initial_orbits(vehicles: int) -> tuple[np.ndarray, np.ndarray]:
    """Positions [m] and velocities [m/s] (3, vehicles), evenly spaced along an inclined circular orbit at 7000 km."""
    angle = np.linspace(0.0, 2.0 * np.pi, vehicles, endpoint=False)
    radius, inclination = 7.0e6, np.radians(51.6)
    speed = np.sqrt(MU_EARTH / radius)
    across = np.array([0.0, np.cos(inclination), np.sin(inclination)])[:, None]
    node = np.array([1.0, 0.0, 0.0])[:, None]
    return (
        radius * (np.cos(angle) * node + np.sin(angle) * across),
        speed * (np.cos(angle) * across - np.sin(angle) * node),
    )


def compile_propagation(
    vehicles: int = DEFAULT_VEHICLES, steps: int = DEFAULT_STEPS, devices: Sequence[Any] | None = None
) -> MultiDeviceProgram:
    """Program that propagates `vehicles` vehicles on each device through `steps` steps."""
    used = choose_devices(devices)

    def propagate(r_N: Vectors, v_N: Vectors) -> tuple[Vectors, Vectors]:
        def body(state: tuple[Vectors, Vectors], _: None) -> tuple[tuple[Vectors, Vectors], None]:
            return rk4_step(*state, STEP_S), None

        return jax.lax.scan(body, (r_N, v_N), None, length=steps)[0]

    return compile_for_devices(propagate, [initial_orbits(vehicles)] * len(used), used)


def measure(
    vehicles: int = DEFAULT_VEHICLES, steps: int = DEFAULT_STEPS, devices: Sequence[Any] | None = None
) -> OrbitSpeed:
    """Steps per second of `vehicles` vehicles on each device, propagated through `steps` steps."""
    program = compile_propagation(vehicles, steps, devices)
    elapsed = program.fastest_pass()
    total = vehicles * len(program.inputs)
    return OrbitSpeed(
        vehicles=total,
        devices=len(program.inputs),
        steps=steps,
        step_s=STEP_S,
        compile_s=program.compile_s,
        run_s=elapsed.wall_s,
        cpu_s=elapsed.cpu_s,
        vehicle_steps_per_s=total * steps / elapsed.wall_s,
    )
