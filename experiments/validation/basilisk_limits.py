"""Errors of Basilisk that limit the comparison: held environment, thruster cutoff, two-body motion.

python -m experiments.validation.basilisk_limits
"""

from typing import Any

import numpy as np
from Basilisk.architecture import messaging  # pyright: ignore[reportMissingImports]
from Basilisk.simulation import (  # pyright: ignore[reportMissingImports]
    spacecraft,
    svIntegrators,
    thrusterDynamicEffector,
)
from Basilisk.utilities import SimulationBaseClass  # pyright: ignore[reportMissingImports]

from experiments.validation import replay
from experiments.validation.basilisk_simulation import Arrays, BasiliskSimulation, SimulationCase
from experiments.validation.make_references import DAY, LOW, MU, exponential_atmosphere, sunlight, zonal_gravity
from experiments.validation.reference_file import validate
from experiments.validation.replay import ReplayOptions

FORCE, MASS = 0.5, 80.0


def held_environment_error() -> None:
    """Prints position differences against Basilisk's outer step; they are proportional to it if holding dominates."""
    drag: Arrays = {**zonal_gravity(2), **LOW, **exponential_atmosphere()}
    light: Arrays = {**zonal_gravity(0), **LOW, **sunlight()}
    print("| outer step of Basilisk s | drag, 12 h, m | sunlight, 2 orbits, m |\n|---|---|---|")
    for step in (2.0, 1.0, 0.5):
        errors = [
            _position_error(SimulationCase(inputs, False, span, step, 600.0))
            for inputs, span in ((drag, DAY / 2), (light, 11400.0))
        ]
        print(f"| {step} | {errors[0]:.2e} | {errors[1]:.2e} |", flush=True)


def _position_error(run: SimulationCase) -> float:
    result = replay.replay(validate("limits", {**run.inputs, **BasiliskSimulation(run).simulate()}))
    assert result.position_error_m is not None
    return result.position_error_m


def cutoff_error() -> None:
    """Prints the excess burn time of Basilisk's on-time thruster with its RK4 integrator."""
    print("| on-time s | step s | excess s | excess over step |\n|---|---|---|---|")
    for on_time in (1.0, 1.05, 1.1, 1.13, 1.2, 2.5):
        for step in (0.2, 0.1):
            excess = _velocity_after(on_time, step) * MASS / FORCE - on_time
            print(f"| {on_time} | {step} | {excess:+.4f} | {excess / step:+.3f} |")


def _velocity_after(on_time: float, step: float) -> float:
    sim = SimulationBaseClass.SimBaseClass()
    sim.CreateNewProcess("process").addTask(sim.CreateNewTask("task", round(step * 1e9)))
    craft = spacecraft.Spacecraft()
    craft.hub.mHub, craft.hub.IHubPntBc_B = MASS, np.eye(3).tolist()
    integrator = svIntegrators.svIntegratorRK4(craft)
    craft.setIntegrator(integrator)
    thrusters, message = _thruster(on_time)
    craft.addDynamicEffector(thrusters)
    sim.AddModelToTask("task", craft, 50)
    sim.AddModelToTask("task", thrusters, 40)
    sim.InitializeSimulation()
    sim.ConfigureStopTime(5_000_000_000)
    sim.ExecuteSimulation()
    del message, integrator
    return float(np.linalg.norm(craft.scStateOutMsg.read().v_BN_N))


def _thruster(on_time: float) -> tuple[Any, Any]:
    config = thrusterDynamicEffector.THRSimConfig()
    config.thrLoc_B, config.thrDir_B = [[0.0], [0.0], [0.0]], [[1.0], [0.0], [0.0]]
    config.MaxThrust, config.steadyIsp, config.MinOnTime = FORCE, 1e12, 0.0
    thrusters = thrusterDynamicEffector.ThrusterDynamicEffector()
    thrusters.addThruster(config)
    payload = messaging.THRArrayOnTimeCmdMsgPayload()
    payload.OnTimeRequest = [on_time]
    message = messaging.THRArrayOnTimeCmdMsg().write(payload)
    thrusters.cmdsInMsg.subscribeTo(message)
    return thrusters, message


def two_body_error() -> None:
    """Prints the errors of both simulators against Kepler's equation over a day."""
    inputs: Arrays = {**zonal_gravity(0), **LOW}
    reference = validate(
        "two-body", {**inputs, **BasiliskSimulation(SimulationCase(inputs, False, DAY, 10.0, 900.0)).simulate()}
    )
    exact = _kepler(inputs["r0"], inputs["v0"], reference["t"])
    truth, _ = replay.propagate(reference, ReplayOptions())
    positions = {"package": np.asarray(truth.r_TN_N + truth.r_ST_N), "Basilisk": reference["r"]}
    print("| two-body, 1 day | from Kepler's equation m |\n|---|---|")
    for name, r in positions.items():
        print(f"| {name} | {np.max(np.linalg.norm((r - exact).astype(float), axis=1)):.1e} |")


def _kepler(r0: np.ndarray, v0: np.ndarray, times: np.ndarray) -> np.ndarray:
    """Positions by Kepler's equation in extended precision."""
    long = np.longdouble
    r, v, mu = r0.astype(long), v0.astype(long), long(MU)
    radius = np.sqrt(r @ r)
    a = 1 / (2 / radius - v @ v / mu)
    motion, cosine, sine = np.sqrt(mu / a**3), 1 - radius / a, r @ v / np.sqrt(mu * a)
    mean = motion * times.astype(long)
    change = mean.copy()
    for _ in range(50):
        found = change - cosine * np.sin(change) + sine * (1 - np.cos(change)) - mean
        change -= found / (1 - cosine * np.cos(change) + sine * np.sin(change))
    f = 1 - a / radius * (1 - np.cos(change))
    g = times.astype(long) + (np.sin(change) - change) / motion
    return f[:, None] * r + g[:, None] * v


if __name__ == "__main__":
    held_environment_error()
    cutoff_error()
    two_body_error()
