"""Commands of the inspection mission simulated by Basilisk and by the plant; prints and plots the differences.

python -m experiments.validation.side_by_side --out out/side_by_side
"""

import argparse
import json
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import jax
import matplotlib.pyplot as plt
import numpy as np

import rpojax
from experiments.validation import replay, replay_errors
from experiments.validation.basilisk_simulation import Arrays, BasiliskSimulation, Integrator, SimulationCase
from experiments.validation.make_references import add_hill_position
from experiments.validation.reference_file import Numbers, Reference, validate
from experiments.validation.replay import ReplayOptions
from rpojax.campaign import single_run
from rpojax.core.numerics.runge_kutta import Method
from rpojax.scenario.params import Params
from rpojax.scenario.static_settings import Scenario
from rpojax.simulation.rollout import rollout
from rpojax.simulation.state import State
from rpojax.simulation.telemetry import Telemetry

WORDS = "gravity gradient of a point mass"


def mission_commands(duration_s: float, seed: int) -> tuple[SimulationCase, int]:
    """Plant, initial state and logged commands of one run of `inspection`, and the number of commands.

    Burns are rounded to steps of the attitude control, because Basilisk switches forces only there.
    """
    file = rpojax.load("inspection", [f"duration_s={duration_s}"])
    static, params, state = single_run.initialise_run(file, seed)
    torques: list[Numbers] = []
    telemetry = jax.tree.map(np.asarray, _rollout(static, _stages_recording(torques), params, state))
    jax.effects_barrier()
    steps = static.ticks * static.substeps
    if len(torques) != steps:
        raise RuntimeError(f"recorded {len(torques)} torque commands, expected {steps}")
    inputs = _plant(params) | _initial_state(telemetry) | _burns(params, telemetry, static)
    inputs |= {"t_cmd": np.arange(steps) * static.step_s, "u_cmd": _saturated(np.stack(torques), params)}
    return SimulationCase(inputs, True, steps * static.step_s, static.step_s, 10.0 * static.tick_s), steps


def _stages_recording(torques: list[Numbers]) -> rpojax.Stages:
    def wheel_torque(**arguments: Any) -> jax.Array:
        torque = rpojax.Stages().call("wheel_torque", **arguments)
        jax.debug.callback(lambda value: torques.append(np.array(value)), torque, ordered=True)
        return torque

    return rpojax.Stages(wheel_torque=wheel_torque)


@partial(jax.jit, static_argnums=(0, 1))
def _rollout(static: Scenario, stages: rpojax.Stages, params: Params, state: State) -> Telemetry:
    return rollout(static, params, state, static.ticks, stages)[1]


def _plant(params: Params) -> Arrays:
    truth = params.plant
    thruster = truth.thruster
    return {
        "mu": np.asarray(truth.gravity.mu),
        "Re": np.asarray(truth.gravity.radius),
        "J": np.asarray(truth.gravity.zonals)[:1],
        "m": np.asarray(truth.servicer.mass),
        "I": np.asarray(truth.servicer.inertia),
        "gs": np.asarray(truth.wheels.axes),
        "Js": np.asarray(truth.wheels.inertia),
        "F_max": np.asarray(thruster.force * thruster.force_scale),
        "thr_loc": np.asarray(thruster.position)[None],
        "thr_dir": np.asarray(thruster.direction / np.linalg.norm(thruster.direction))[None],
    }


def _initial_state(telemetry: Telemetry) -> Arrays:
    truth = jax.tree.map(lambda history: history[0], telemetry.truth)
    q = truth.q_BN * np.array([1.0, -1.0, -1.0, -1.0]) * (1.0 if truth.q_BN[0] >= 0.0 else -1.0)
    return {
        "r0_target": truth.r_TN_N,
        "v0_target": truth.v_TN_N,
        "r0_chaser": truth.r_TN_N + truth.r_ST_N,
        "v0_chaser": truth.v_TN_N + truth.v_ST_N,
        "sigma0": q[1:] / (1.0 + q[0]),
        "q0": q,
        "omega0": truth.omega_BN_B,
        "Omega0": truth.wheel_speed,
    }


def _burns(params: Params, telemetry: Telemetry, static: Scenario) -> Arrays:
    """Executed burns, each once."""
    plan, step_s = telemetry.flight.plan, static.step_s
    pairs = np.unique(np.round(np.stack([plan.ignition, plan.cutoff], axis=1) / step_s) * step_s, axis=0)
    least = float(params.plant.thruster.minimum_on_time)
    end = static.ticks * static.tick_s
    fired = [(0.0, begin, stop - begin) for begin, stop in pairs if stop - begin > least and 0.0 <= begin < end]
    return {"burns": np.array(fired).reshape(-1, 3)}


def _saturated(torques: Numbers, params: Params) -> Numbers:
    limit = np.asarray(params.plant.wheels.torque_limit)
    return np.clip(torques, -limit, limit)


@dataclass(frozen=True)
class Comparison:
    """Histories of differences from Basilisk's adaptive integrator.

    Attributes:
        name: of the simulator that is compared with it
        time: [s]
        position: of the servicer [m]
        relative: of the servicer from the target, Hill frame [m]
        attitude: [rad]
    """

    name: str
    time: Numbers
    position: Numbers
    relative: Numbers
    attitude: Numbers


def _as_reference(run: SimulationCase) -> Reference:
    simulated = add_hill_position(BasiliskSimulation(run).simulate())
    simulated.pop("u_last", None)
    meta = np.array(json.dumps({"case": "inspection", "torque": WORDS}))
    return validate("inspection", {"meta_json": meta, **run.inputs, **simulated})


def compare_package(name: str, truth: Reference, integrator: Method, step_s: float | None) -> Comparison:
    """Compares the package's plant."""
    simulated, _ = replay.propagate(truth, ReplayOptions(integrator, step_s))
    relative, attitude = (
        replay_errors.relative_errors(truth, simulated),
        replay_errors.attitude_errors(truth, simulated),
    )
    assert relative is not None and attitude is not None
    ours = np.asarray(simulated.r_TN_N + simulated.r_ST_N)
    position = np.linalg.norm(ours - truth["r_chaser"], axis=1)
    return Comparison(name, truth["t"], position, relative, attitude)


def compare_basilisk(name: str, truth: Reference, run: SimulationCase, integrator: Integrator) -> Comparison:
    """Compares Basilisk with another integrator."""
    other = _as_reference(SimulationCase(run.inputs, True, run.duration_s, run.step_s, run.sample_s, integrator))
    position = np.linalg.norm(other["r_chaser"] - truth["r_chaser"], axis=1)
    relative = np.linalg.norm(other["rho"] - truth["rho"], axis=1)
    sine = np.linalg.norm(other["q"] - truth["q"] * np.sign(np.sum(other["q"] * truth["q"], axis=1))[:, None], axis=1)
    return Comparison(name, truth["t"], position, relative, 4.0 * np.arcsin(0.5 * np.minimum(sine, 2.0)))


def plot(comparisons: list[Comparison], burns: Numbers, path: Path) -> None:
    """Differences over time, with the burns marked."""
    figure, axes = plt.subplots(3, 1, figsize=(9, 8), sharex=True, layout="constrained")
    titles = {"position": "position [m]", "relative": "relative position [m]", "attitude": "attitude [rad]"}
    for axis, (field, title) in zip(axes, titles.items(), strict=True):
        for one in comparisons:
            values = getattr(one, field)
            axis.semilogy(one.time, np.where(values > 1e-15, values, np.nan), label=one.name)
        for _, begin, on_time in burns:
            axis.axvspan(begin, begin + on_time, color="0.85")
        axis.set_ylabel(title)
        axis.grid(alpha=0.3)
    axes[0].legend()
    axes[0].set_title("Difference from Basilisk with RKF78 for the same commands; burns in grey")
    axes[-1].set_xlabel("time [s]")
    figure.savefig(path, dpi=130)
    plt.close(figure)


def main() -> None:
    """Simulates the mission in the closed loop, then its commands in both simulators."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--duration", type=float, default=3000.0, help="[s]")
    parser.add_argument("--seed", type=int, default=0)
    parsed = parser.parse_args()
    run, steps = mission_commands(parsed.duration, parsed.seed)
    truth = _as_reference(run)
    comparisons = [
        compare_package("package, rk8, step fitted", truth, "rk8", None),
        compare_package(f"package, rk4, {run.step_s} s", truth, "rk4", run.step_s),
        compare_basilisk(f"Basilisk, RK4, {run.step_s} s", truth, run, "rk4"),
    ]
    burns = run.inputs["burns"]
    turned = 2.0 * np.arccos(np.clip(np.abs(truth["q"] @ truth["q"][0]), 0.0, 1.0))
    print(f"{steps} torque commands, {len(burns)} burns of {burns[:, 2].sum():.1f} s together,", end=" ")
    print(f"turns of up to {np.rad2deg(turned.max()):.0f} deg; largest difference from Basilisk with RKF78:")
    print("| simulator | position m | relative position m | attitude rad |\n|---|---|---|---|")
    for one in comparisons:
        print(f"| {one.name} | {one.position.max():.1e} | {one.relative.max():.1e} | {one.attitude.max():.1e} |")
    parsed.out.mkdir(parents=True, exist_ok=True)
    plot(comparisons, burns, parsed.out / "side_by_side.png")


if __name__ == "__main__":
    main()
