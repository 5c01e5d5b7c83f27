"""Free tumble of the target, propagated by the filter and by the plant, beside Basilisk's rigid body.

    pip install bsk
    python -m experiments.pose.basilisk_tumble [--duration 600] [--rate 1.0]

The target of `pose_inspection` turns without torque about an axis between those of inertia. Basilisk integrates
modified Rodrigues parameters and the rate with steps of 0.01 s. Printed are the largest angle between the attitudes
and the largest difference of the rates over the rate; the exit status is 1 if either is above 1e-9.
"""

import argparse
import sys
from typing import Final

import jax
import jax.numpy as jnp
import numpy as np
from Basilisk.simulation import spacecraft  # pyright: ignore[reportMissingImports]
from Basilisk.utilities import SimulationBaseClass  # pyright: ignore[reportMissingImports]
from scipy.spatial.transform import Rotation

import rpojax
from rpojax.core import quaternion
from rpojax.core.filter_state_layout import StateLayout
from rpojax.core.numerics import runge_kutta
from rpojax.flight.navigation import relative_filter_state, target_attitude_ekf
from rpojax.flight.navigation.target_attitude_ekf import TargetAttitude
from rpojax.physics import rigid_body

BAR: Final = 1e-9
BASILISK_STEP: Final = 0.01
PLANT_STEP: Final = 0.2
FAR: Final = np.array([1e14, 0.0, 0.0])
"""Place at which the gravity gradient is nothing [m]."""
Motion = tuple[np.ndarray, np.ndarray]
"""Attitude (n, 4), scalar first, and rate (n, 3) [rad/s] after each second."""


def by_filter(inertia: np.ndarray, rate: np.ndarray, seconds: int) -> Motion:
    """Motion by the prediction of the orbit filter, in its step of a second."""
    names = frozenset(each.name for each in relative_filter_state.states_with(["landmarks"], ()))
    layout: StateLayout = relative_filter_state.layout_of(names)
    start = TargetAttitude(
        q_TN=jnp.array([1.0, 0.0, 0.0, 0.0]),
        inertia=jnp.asarray(inertia),
        known=jnp.ones((), dtype=bool),
        unexplained_s=jnp.zeros(()),
    )
    slow = {name: jnp.zeros(layout[name].stop - layout[name].start) for name in names} | {"rate": jnp.asarray(rate)}
    covariance = jnp.eye(layout.size)

    def second(before: tuple[TargetAttitude, jax.Array], _: None) -> tuple[tuple[TargetAttitude, jax.Array], Motion]:
        reference, omega = before
        reference, after, _ = target_attitude_ekf.predict(
            reference, layout, slow | {"rate": omega}, covariance, jnp.asarray(FAR), 1.0
        )
        return (reference, after["rate"]), (reference.q_TN, after["rate"])  # pyright: ignore[reportReturnType]

    attitude, omega = jax.jit(lambda begin: jax.lax.scan(second, begin, None, length=seconds)[1])((start, slow["rate"]))
    return np.asarray(attitude), np.asarray(omega)


def by_plant(inertia: np.ndarray, rate: np.ndarray, seconds: int) -> Motion:
    """Motion by Euler's equation of the plant with its method and step."""
    matrix = jnp.asarray(inertia)
    inverse = rigid_body.inverse_3x3(matrix)

    def derivative(y: tuple[jax.Array, jax.Array], _: jax.Array | None) -> tuple[jax.Array, jax.Array]:
        q, omega = y
        return quaternion.derivative(q, omega), rigid_body.angular_acceleration(matrix, inverse, omega, jnp.zeros(3))

    def step(y: tuple[jax.Array, jax.Array], _: None) -> tuple[tuple[jax.Array, jax.Array], Motion]:
        change_q, change = runge_kutta.increment("rk4", derivative, y, None, PLANT_STEP)
        after = quaternion.normalize(y[0] + change_q), y[1] + change
        return after, after  # pyright: ignore[reportReturnType]

    start = jnp.array([1.0, 0.0, 0.0, 0.0]), jnp.asarray(rate)
    count = round(1.0 / PLANT_STEP)
    attitude, omega = jax.jit(lambda begin: jax.lax.scan(step, begin, None, length=count * seconds)[1])(start)
    return np.asarray(attitude)[count - 1 :: count], np.asarray(omega)[count - 1 :: count]


def by_basilisk(inertia: np.ndarray, rate: np.ndarray, seconds: int) -> Motion:
    """Motion by Basilisk."""
    simulation = SimulationBaseClass.SimBaseClass()
    process = simulation.CreateNewProcess("dynamics")
    process.addTask(simulation.CreateNewTask("task", round(BASILISK_STEP * 1e9)))
    body = spacecraft.Spacecraft()
    body.hub.mHub = 45.0
    body.hub.IHubPntBc_B = inertia.tolist()
    body.hub.omega_BN_BInit = rate[:, None].tolist()
    simulation.AddModelToTask("task", body)
    simulation.InitializeSimulation()
    attitude, omega = [], []
    for second in range(1, seconds + 1):
        simulation.ConfigureStopTime(round(second * 1e9))
        simulation.ExecuteSimulation()
        found = body.scStateOutMsg.read()
        # The inverse turns components from N into those of the body, as q_TN does.
        x, y, z, w = Rotation.from_mrp(np.array(found.sigma_BN)).inv().as_quat()
        attitude.append([w, x, y, z])
        omega.append(found.omega_BN_B)
    return np.array(attitude), np.array(omega)


def main() -> int:
    """Prints the differences."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--duration", type=int, default=600)
    parser.add_argument("--rate", type=float, default=1.0, help="rate of the tumble [deg/s]")
    options = parser.parse_args()
    rpojax.prepare_process()
    inertia = np.array(rpojax.load("pose_inspection").target.inertia_kg_m2)
    axis = np.array([1.0, 2.0, 0.5])
    rate = np.deg2rad(options.rate) * axis / np.linalg.norm(axis)
    expected = by_basilisk(inertia, rate, options.duration)
    worst = 0.0
    for name, motion in (("filter", by_filter), ("plant", by_plant)):
        attitude, omega = motion(inertia, rate, options.duration)
        # A small angle is twice the difference of quaternions of one sign.
        sign = np.sign(np.sum(attitude * expected[0], axis=1))
        angle = 2.0 * np.linalg.norm(attitude - sign[:, None] * expected[0], axis=1).max()
        change = np.abs(omega - expected[1]).max() / np.linalg.norm(rate)
        print(f"{name}: attitude {angle:.2g} rad, rate {change:.2g} of the rate, over {options.duration} s")
        worst = max(worst, angle, change)
    return int(worst > BAR)


if __name__ == "__main__":
    sys.exit(main())
