"""Replays reference trajectories with the package's plant and prints the largest differences.

python -m experiments.validation.replay FILE.npz ... [--json]
"""

import argparse
import json
import sys
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Literal

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from experiments.validation.plant_from_reference import (
    AttitudeFeedback,
    active_effects,
    attitude_feedback,
    initial_truth,
    plant_effects,
    plant_params,
    sun_moon_positions,
    thrusters,
)
from experiments.validation.reference_file import FormatError, Reference, read_reference
from experiments.validation.replay_errors import largest_errors
from experiments.validation.step_schedule import StepSchedule, make_step_schedule
from rpojax.core import quaternion
from rpojax.core.numerics.runge_kutta import Method
from rpojax.core.orbits.sun_moon_ephemeris import SunMoonPositions
from rpojax.physics import plant
from rpojax.physics.equipment_faults import healthy
from rpojax.physics.plant_options import Effects
from rpojax.physics.plant_state import PlantParams, Truth
from rpojax.physics.thruster import BurnError, StepThrust, Thruster, ValveCommand, thrust_over_step


@dataclass(frozen=True)
class ReplayOptions:
    """Options of a replay.

    Attributes:
        integrator: of the plant
        step_s: longest step [s]; None for one that suits the file
        logged_commands: use the logged wheel torques even if the file has a feedback law
        whole_steps: do not split steps where a burn begins or ends
        gravity_gradient: the torque acts ("on"), does not ("off"), or as the file has it ("auto")
    """

    integrator: Method = "rk8"
    step_s: float | None = None
    logged_commands: bool = False
    whole_steps: bool = False
    gravity_gradient: Literal["on", "off", "auto"] = "auto"


@dataclass(frozen=True)
class ReplayResult:
    """Largest differences between plant and reference; None for histories that the file lacks.

    Attributes:
        effects: names of the effects that acted
    """

    case: str
    position_error_m: float | None
    velocity_error_m_s: float | None
    attitude_error_rad: float | None
    rate_error_rad_s: float | None
    relative_position_error_m: float | None
    illumination_error: float | None
    wheel_speed_error_rad_s: float | None
    integrator: str
    step_s: float
    effects: list[str]


def replay(reference: Reference, options: ReplayOptions | None = None) -> ReplayResult:
    """Propagates a reference and compares.

    Raises:
        FormatError: the file lacks a key, or cannot be propagated.
    """
    chosen = options or ReplayOptions()
    truth, longest = propagate(reference, chosen)
    errors = largest_errors(reference, truth)
    if any(value is not None and not np.isfinite(value) for value in errors.values()):
        raise FormatError(f"{reference.case}: the replay did not stay finite")
    effects = plant_effects(reference, chosen.integrator, chosen.gravity_gradient)
    acting = active_effects(reference, effects, "K" in reference and not chosen.logged_commands)
    return ReplayResult(reference.case, **errors, integrator=chosen.integrator, step_s=longest, effects=acting)


def propagate(reference: Reference, chosen: ReplayOptions) -> tuple[Truth, float]:
    """Truth at the samples of a reference, time first, and the longest step [s] that it took."""
    effects = plant_effects(reference, chosen.integrator, chosen.gravity_gradient)
    params = plant_params(reference)
    feedback = None if chosen.logged_commands else attitude_feedback(reference)
    closed_loop = feedback is not None
    steps, sample_rows = make_step_schedule(reference, effects, closed_loop, chosen.step_s, chosen.whole_steps)
    start = initial_truth(reference, params)
    rows = int(sample_rows[-1]) + 1
    sky = sun_moon_positions(reference)
    outputs = _propagate(effects, rows, params, thrusters(reference), sky, feedback, start, steps)
    return jax.tree.map(lambda history: np.asarray(history)[sample_rows], outputs), float(np.max(steps.dt))


@partial(jax.jit, static_argnums=(0, 1))
def _propagate(
    effects: Effects,
    output_rows: int,
    params: PlantParams,
    all_thrusters: Thruster,
    sky: SunMoonPositions,
    feedback: AttitudeFeedback | None,
    start: Truth,
    steps: StepSchedule,
) -> Truth:
    """Truth at the output rows; the first is the start unless a step writes it."""

    def body(carry: tuple[Truth, Array, Truth], step: StepSchedule) -> tuple[tuple[Truth, Array, Truth], None]:
        truth, torque, outputs = carry
        torque = (
            step.torque
            if feedback is None
            else jnp.where(step.update_feedback, _feedback_torque(feedback, params, truth), torque)
        )
        thrusts = tuple(_thrust(effects, all_thrusters, step, slot) for slot in range(step.thruster.shape[0]))
        truth = plant.step(effects, params, truth, torque, thrusts, sky, healthy(), step.dt)
        outputs = jax.tree.map(lambda history, now: history.at[step.output_row].set(now, mode="drop"), outputs, truth)
        return (truth, torque, outputs), None

    outputs = jax.tree.map(lambda value: jnp.broadcast_to(value, (output_rows, *value.shape)), start)
    return jax.lax.scan(body, (start, jnp.zeros_like(params.wheels.initial_speed), outputs), steps)[0][2]


def _thrust(effects: Effects, all_thrusters: Thruster, step: StepSchedule, slot: int) -> StepThrust:
    thruster = jax.tree.map(lambda leaf: leaf[step.thruster[slot]], all_thrusters)
    exact = BurnError(magnitude=jnp.zeros(()), direction=jnp.zeros(3))
    burn = ValveCommand(ignition=step.ignition[slot], cutoff=step.cutoff[slot], burn_error=exact)
    return thrust_over_step(thruster, burn, effects.integrator, False, step.dt)


def _feedback_torque(feedback: AttitudeFeedback, params: PlantParams, truth: Truth) -> Float[Array, " wheels"]:
    """Wheel torques `-gs . Lr` with `Lr = -K sigma_BN - P omega_BN_B`, sigma of the shorter rotation."""
    q = quaternion.conjugate(truth.q_BN)
    q = jnp.where(q[0] < 0.0, -q, q)
    sigma = q[1:] / (1.0 + q[0])
    law = feedback.stiffness * sigma + feedback.damping * truth.omega_BN_B
    return jnp.sum(params.wheels.axes * law[None, :], axis=1)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="replay", description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("files", nargs="+", type=Path, metavar="FILE.npz")
    parser.add_argument("--json", action="store_true", help="one JSON object per file and line, instead of a table")
    parser.add_argument("--commands", action="store_true", help="use logged wheel torques, not the file's feedback law")
    parser.add_argument("--integrator", choices=("rk4", "rk8"), default="rk8")
    parser.add_argument("--step", type=float, metavar="S", help="longest step [s]; default: one that suits the file")
    parser.add_argument(
        "--gravity-gradient", choices=("on", "off", "auto"), default="auto", help="auto: as in the file"
    )
    parser.add_argument("--whole-steps", action="store_true", help="do not split steps at burn edges")
    return parser


def _table_row(result: ReplayResult) -> str:
    cells = [f"{value:.2e}" if isinstance(value, float) else "-" for value in list(asdict(result).values())[1:8]]
    return f"| {result.case} | {' | '.join(cells)} | {result.integrator}, {result.step_s:.4g} s |"


_TABLE_HEADER = (
    "| case | position m | velocity m/s | attitude rad | rate rad/s | relative m | illumination "
    "| wheels rad/s | step |\n|---|---|---|---|---|---|---|---|---|"
)


def main(argv: list[str] | None = None) -> int:
    """Replays the files named on the command line; returns 2 if one is refused, with one line on stderr."""
    parser = _parser()
    parsed = parser.parse_args(argv)
    if parsed.step is not None and not parsed.step > 0.0:
        parser.error(f"--step: found {parsed.step}, expected more than 0")
    options = ReplayOptions(
        parsed.integrator, parsed.step, parsed.commands, parsed.whole_steps, parsed.gravity_gradient
    )
    if not parsed.json:
        print(_TABLE_HEADER)
    refused = [path for path in parsed.files if not _replay_file(path, options, parsed.json)]
    return 2 if refused else 0


def _replay_file(path: Path, options: ReplayOptions, as_json: bool) -> bool:
    """Replays one file and prints the result; False if it is refused."""
    try:
        result = replay(read_reference(path), options)
    except (ValueError, ArithmeticError, RuntimeError, MemoryError) as error:
        message = " ".join(str(error).split()) or type(error).__name__
        known = isinstance(error, FormatError) and str(path) in message
        print(f"error: {message}" if known else f"error: {path}: {message}", file=sys.stderr, flush=True)
        return False
    print(json.dumps(asdict(result)) if as_json else _table_row(result), flush=True)
    return True


if __name__ == "__main__":
    sys.exit(main())
