"""Makes the committed reference trajectories with Basilisk, which must be installed.

python -m experiments.validation.make_references tests/validation/references
"""

import argparse
import json
from collections.abc import Iterator
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from experiments.validation.basilisk_simulation import Arrays, BasiliskSimulation, SimulationCase
from experiments.validation.reference_file import quaternion_from_mrp

MU, RADIUS = 3.986004418e14, 6378137.0
ZONALS = (1.08262668e-3, -2.53265649e-6, -1.61962159e-6, -2.27296083e-7, 5.40681239e-7)
DAY = 86400.0
INERTIA = np.array([[11.0, 0.5, -0.2], [0.5, 8.0, 0.3], [-0.2, 0.3, 6.0]])
TILTED = np.array([[1.0, 0.1, 0.0], [0.0, 1.0, -0.1], [0.1, 0.0, 1.0]])


def orbit(a: float, e: float, degrees: tuple[float, float, float, float]) -> Arrays:
    """Initial position and velocity of an orbit: inclination, node, perigee and true anomaly in degrees."""
    i, node, perigee, nu = np.deg2rad(degrees)
    p = a * (1.0 - e * e)
    cos_o, sin_o, cos_i, sin_i, cos_w, sin_w = *_cs(node), *_cs(i), *_cs(perigee)
    x = np.array([cos_o * cos_w - sin_o * sin_w * cos_i, sin_o * cos_w + cos_o * sin_w * cos_i, sin_w * sin_i])
    y = np.array([-cos_o * sin_w - sin_o * cos_w * cos_i, -sin_o * sin_w + cos_o * cos_w * cos_i, cos_w * sin_i])
    r = p / (1.0 + e * np.cos(nu)) * (np.cos(nu) * x + np.sin(nu) * y)
    v = np.sqrt(MU / p) * (-np.sin(nu) * x + (e + np.cos(nu)) * y)
    return {"r0": r, "v0": v}


def _cs(angle: float) -> tuple[float, float]:
    return float(np.cos(angle)), float(np.sin(angle))


LOW_ELEMENTS = (6878137.0, 0.002, (97.4, 30.0, 20.0, 10.0))
HIGH_APOGEE_ELEMENTS = (24000e3, 0.7, (63.4, 100.0, 270.0, 40.0))
LOW, HIGH_APOGEE = orbit(*LOW_ELEMENTS), orbit(*HIGH_APOGEE_ELEMENTS)


def zonal_gravity(degree: int) -> Arrays:
    """Gravity with zonals up to a degree; 0 for a point mass."""
    return {"mu": np.array(MU), "Re": np.array(RADIUS), "J": np.array(ZONALS[: max(degree - 1, 0)])}


def rigid_body(
    sigma: tuple[float, float, float], omega: tuple[float, float, float], inertia: Arrays | None = None
) -> Arrays:
    """Rigid body with initial attitude and rate."""
    start = np.array(sigma)
    return {
        "I": INERTIA if inertia is None else inertia["I"],
        "m": np.array(60.0),
        "sigma0": start,
        "q0": quaternion_from_mrp(start),
        "omega0": np.array(omega),
    }


def wheels(axes: np.ndarray) -> Arrays:
    """Three wheels; spin axes in rows."""
    unit = axes / np.linalg.norm(axes, axis=1, keepdims=True)
    return {"Js": np.array(0.008), "gs": unit, "Omega0": np.array([120.0, -80.0, 30.0])}


def torque_commands(period: float, duration: float) -> Arrays:
    """Wheel torque commands: square waves of three amplitudes and periods."""
    times = np.arange(0.0, duration, period)
    turn = np.stack([np.sign(np.sin(2.0 * np.pi * (times + 0.5 * period) / length)) for length in (90.0, 140.0, 70.0)])
    return {"t_cmd": times, "u_cmd": turn.T * np.array([0.03, -0.02, 0.025])}


def thrusters(burns: list[tuple[int, float, float]]) -> Arrays:
    """Two thrusters, one with a lever arm, and burns as rows of index, start, on-time."""
    return {
        "F_max": np.array(0.6),
        "thr_loc": np.array([[-0.25, 0.0, 0.0], [-0.25, 0.03, -0.015]]),
        "thr_dir": np.array([[1.0, 0.0, 0.0], [0.8, 0.6, 0.0]]),
        "burns": np.array(burns),
    }


def target_and_chaser() -> Arrays:
    """Target, and chaser 80 m behind it with a relative velocity."""
    r, v = LOW["r0"], LOW["v0"]
    radial, normal = r / np.linalg.norm(r), np.cross(r, v)
    rate = normal / (r @ r)
    along = np.cross(normal / np.linalg.norm(normal), radial)
    rho = 10.0 * radial - 80.0 * along + 5.0 * normal / np.linalg.norm(normal)
    drift = 0.01 * radial + np.cross(rate, rho)
    return {"r0_target": r, "v0_target": v, "r0_chaser": r + rho, "v0_chaser": v + drift}


def safety_ellipse(a: float, e: float, degrees: tuple[float, float, float, float]) -> Arrays:
    """Target, and chaser on a safety ellipse: relative eccentricity and inclination vectors towards the perigee.

    Semi-major axis and mean anomaly are equal. Amplitudes are 20 m radially and, at the semi-latus rectum, 30 m across.
    """
    i, _, perigee, nu = np.deg2rad(degrees)
    eta_square = 1.0 - e * e
    more_e, tilt = 20.0 / a, 30.0 / (a * eta_square)
    more_node = tilt * np.sin(perigee) / np.sin(i)
    more_nu = more_e * np.sin(nu) * (2.0 + e * np.cos(nu)) / eta_square
    perigee_change = -more_node * np.cos(i)
    change = np.rad2deg([tilt * np.cos(perigee), more_node, perigee_change, more_nu])
    chaser_degrees = (degrees[0] + change[0], degrees[1] + change[1], degrees[2] + change[2], degrees[3] + change[3])
    target, chaser = orbit(a, e, degrees), orbit(a, e + more_e, chaser_degrees)
    return {
        "r0_target": target["r0"],
        "v0_target": target["v0"],
        "r0_chaser": chaser["r0"],
        "v0_chaser": chaser["v0"],
    }


def sunlight() -> Arrays:
    """Sun with Basilisk's constants, and a sphere in sunlight."""
    direction = np.array([0.9, -0.4, -0.17])
    distance = 149597870693.0
    return {
        "r_sun": distance * direction / np.linalg.norm(direction),
        "R_sun": np.array(695000e3),
        "Re_eclipse": np.array(6378136.6),
        "AU": np.array(distance),
        "c": np.array(299792458.0),
        "flux": np.array(1361.0),
        "Cr": np.array(1.5),
        "A": np.array(0.4),
        "m": np.array(15.0),
    }


def exponential_atmosphere() -> Arrays:
    """Exponential atmosphere and a sphere with drag."""
    return {
        "Cd": np.array(2.1),
        "A": np.array(0.3),
        "m": np.array(30.0),
        "H": np.array(60000.0),
        "rho0": np.array(2.5e-9),
    }


def cases() -> Iterator[tuple[str, SimulationCase, dict[str, str]]]:
    """Name, simulation and description of every reference."""
    gradient = {"torque": "gravity gradient of a point mass"}
    long_body = {"I": np.array([[30.0, 0.6, -0.5], [0.6, 120.0, 1.0], [-0.5, 1.0, 110.0]])}
    middle = {"I": np.diag([11.0, 8.0, 6.0])}
    feedback = {"K": np.array(0.3), "P": np.array(2.5), "dt_ctrl": np.array(0.25), "u_max": np.array(0.08)}
    spin, slow = (0.03, -0.02, 0.04), (0.002, -0.003, 0.001)
    burns = [(0, 11.0, 7.0), (1, 15.0, 9.5), (1, 120.0, 2.5), (0, 200.5, 0.5)]
    angles, start = (0.15, -0.1, 0.2), (-0.3, 0.25, 0.2)
    orbits = {**zonal_gravity(0), **LOW}
    yield "a_two_body", SimulationCase(orbits, False, DAY, 10.0, 900.0), {}
    yield "a_two_body_eccentric", SimulationCase({**zonal_gravity(0), **HIGH_APOGEE}, False, DAY, 2.0, 620.0), {}
    yield "b_j2", SimulationCase({**zonal_gravity(2), **LOW}, False, DAY, 10.0, 900.0), {}
    yield "b_zonals_6", SimulationCase({**zonal_gravity(6), **LOW}, False, DAY, 10.0, 900.0), {}
    yield "c_relative", SimulationCase({**zonal_gravity(2), **target_and_chaser()}, False, 28400.0, 10.0, 200.0), {}
    for name, elements, step, spacing in (
        ("low", LOW_ELEMENTS, 10.0, 200.0),
        ("eccentric", HIGH_APOGEE_ELEMENTS, 2.0, 620.0),
    ):
        pair = {**zonal_gravity(0), **safety_ellipse(*elements)}
        yield f"c_safety_ellipse_{name}", SimulationCase(pair, False, 100.0 * spacing, step, spacing), {}
    yield "d_tumble", SimulationCase(rigid_body(angles, spin), False, 3600.0, 0.5, 37.0), {}
    yield "d_middle_axis", SimulationCase(rigid_body(angles, (1e-4, 0.06, -1e-4), middle), False, 3600.0, 0.5, 37.0), {}
    e = {**rigid_body(angles, slow), **wheels(TILTED), **torque_commands(4.0, 600.0)}
    yield "e_wheels", SimulationCase(e, False, 600.0, 0.1, 7.0), {}
    f = {**orbits, **rigid_body(angles, (1e-4, 1.1e-3, -2e-4), long_body)}
    yield "f_gravity_gradient", SimulationCase(f, True, 5700.0, 1.0, 60.0), gradient
    g = {**orbits, **rigid_body(angles, slow), **thrusters(burns)}
    yield "g_burns", SimulationCase(g, False, 300.0, 0.1, 4.0), {}
    yield (
        "h_drag",
        SimulationCase({**zonal_gravity(2), **LOW, **exponential_atmosphere()}, False, DAY / 2.0, 0.5, 600.0),
        {},
    )
    yield "h_sunlight", SimulationCase({**orbits, **sunlight()}, False, 11400.0, 1.0, 30.0), {}
    i = {
        **zonal_gravity(2),
        **LOW,
        **rigid_body(angles, slow),
        **wheels(TILTED),
        **torque_commands(4.0, 600.0),
        **thrusters(burns),
    }
    yield "i_combined", SimulationCase(i, True, 600.0, 0.1, 7.0), gradient
    j = {**rigid_body(start, (0.02, 0.01, -0.015)), **wheels(np.eye(3)), **feedback}
    yield "j_attitude_loop", SimulationCase(j, False, 300.0, 0.25, 1.25), {}


def add_hill_position(arrays: Arrays) -> Arrays:
    """Adds the relative position in the target's Hill frame, if there are two spacecraft."""
    if "r_target" not in arrays:
        return arrays
    r, v = arrays["r_target"], arrays["v_target"]
    x = r / np.linalg.norm(r, axis=1, keepdims=True)
    momentum = np.cross(r, v)
    z = momentum / np.linalg.norm(momentum, axis=1, keepdims=True)
    frame = np.stack([x, np.cross(z, x), z], axis=1)
    return {**arrays, "rho": np.einsum("tij,tj->ti", frame, arrays["r_chaser"] - r)}


def write_reference(folder: Path, name: str, run: SimulationCase, description: dict[str, str]) -> int:
    """Simulates one case and writes its file; returns the size in bytes."""
    histories = add_hill_position(BasiliskSimulation(run).simulate())
    histories.pop("u_last", None)
    meta = {
        "case": name,
        "made_with": f"Basilisk {version('bsk')}",
        "integrator": f"Basilisk {run.integrator}, outer step {run.step_s} s",
        **description,
    }
    path = folder / f"{name}.npz"
    arrays: dict[str, Any] = {"meta_json": np.array(json.dumps(meta)), **run.inputs, **histories}
    np.savez_compressed(path, **arrays)
    return path.stat().st_size


def main() -> None:
    """Writes all cases or those named, and prints their sizes."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("names", nargs="*", help="only these cases")
    parsed = parser.parse_args()
    parsed.folder.mkdir(parents=True, exist_ok=True)
    for name, run, description in cases():
        if not parsed.names or name in parsed.names:
            print(f"{name}: {write_reference(parsed.folder, name, run, description)} bytes", flush=True)


if __name__ == "__main__":
    main()
