"""Replays reference trajectories through the package's own plant, from the file alone.

python -m experiments.validation.replay FILE.npz ... [--json]
"""

import argparse
import itertools
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

from experiments.validation.gravity_gradient_switch import has_gravity_gradient
from experiments.validation.reference_file import FormatError, Numbers, Reference, read_reference
from rpojax.core import quaternion
from rpojax.core.constants import ASTRONOMICAL_UNIT, RADIUS_EARTH, SPEED_OF_LIGHT
from rpojax.core.frames import hill_frame, inertial_to_hill
from rpojax.core.numerics.runge_kutta import Method
from rpojax.core.orbits import eclipse
from rpojax.core.orbits.orbital_mechanics import GravityField
from rpojax.core.pytree import pytree
from rpojax.physics import actuators, plant
from rpojax.physics.actuators import BurnError, ReactionWheels, StepThrust, Thruster, ValveCommand
from rpojax.physics.environment import Atmosphere, Sunlight, SunMoonPositions, Surface
from rpojax.physics.equipment_faults import Fault, healthy
from rpojax.physics.plant import PlantParams, Target, Truth
from rpojax.physics.plant_options import Effects
from rpojax.physics.rigid_body import Body

TIME_TOLERANCE = 1e-9
"""Times nearer than this [s] are one."""

ORBIT_ANGLE_PER_STEP = 0.02
"""Turn of the orbit at perigee in one step [rad]."""

BODY_ANGLE_PER_STEP = 0.1
"""Turn of the body, and of its momentum in the body, in one step [rad]."""

MAX_STEP_IN_SUNLIGHT = 1.0
"""Longest step where sunlight pushes [s]: an edge of the penumbra lies somewhere inside a step."""

MAX_STEPS = 5e6
"""A file that needs more steps than these is refused."""


@dataclass(frozen=True)
class ReplayOptions:
    """How to replay.

    Attributes:
        integrator: of the plant
        step_s: longest step [s], or None for one that suits the file
        logged_commands: fly the logged wheel torques even where the file has a feedback law
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
    """Largest differences between the plant and a file; None where the file has none.

    Attributes:
        effects: names of what was found in the file and flown
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


@pytree
class AttitudeFeedback:
    """Attitude control of a file: torque `K sigma_BN + P omega_BN_B` onto the wheels, towards q_BN = 1.

    Attributes:
        stiffness: () K [N m]
        damping: () P [N m s]
    """

    stiffness: Array
    damping: Array


@pytree
class StepSchedule:
    """Steps of one replay, all of them along the first axis.

    Attributes:
        dt: (n,) [s]
        row: (n,) which kept row holds the state after the step; out of range if none
        torque: (n, wheels) logged command [N m]
        decide: (n,) bool, the feedback law computes a new command at the start of the step
        thruster: (n, slots) which thruster a burn in this step uses
        ignition: (n, slots) of that burn, from the start of the step [s]
        cutoff: (n, slots) of that burn, from the start of the step [s]
    """

    dt: Array
    output_row: Array
    torque: Array
    update_feedback: Array
    thruster: Array
    ignition: Array
    cutoff: Array


def replay(reference: Reference, options: ReplayOptions | None = None) -> ReplayResult:
    """Flies a reference and compares; raises `FormatError` if the file lacks something or cannot be flown."""
    chosen = options or ReplayOptions()
    truth, longest = propagate(reference, chosen)
    errors = _errors(reference, truth)
    if any(value is not None and not np.isfinite(value) for value in errors.values()):
        raise FormatError(f"{reference.case}: the replay did not stay finite")
    acting = _active_effects(reference, _effects(reference, chosen), "K" in reference and not chosen.logged_commands)
    return ReplayResult(reference.case, **errors, integrator=chosen.integrator, step_s=longest, effects=acting)


def propagate(reference: Reference, chosen: ReplayOptions) -> tuple[Truth, float]:
    """Truth at the samples of a reference, time first, and the longest step [s] that it took."""
    effects = _effects(reference, chosen)
    params = _params(reference)
    feedback = None if chosen.logged_commands else _feedback(reference)
    steps, rows_of_samples = _step_schedule(reference, effects, chosen, feedback is not None)
    start = _initial_truth(reference, params)
    rows = int(rows_of_samples[-1]) + 1
    kept = _propagate(effects, rows, params, _thrusters(reference), _sky(reference), feedback, start, steps)
    return jax.tree.map(lambda history: history[rows_of_samples], kept), float(jnp.max(steps.dt))


# What the file describes, in the plant's terms.


def _effects(reference: Reference, chosen: ReplayOptions) -> Effects:
    zonals = reference["J"].size if "J" in reference else 0
    return Effects(
        integrator=chosen.integrator,
        zonal_degree=zonals + 1 if zonals else 0,
        gravity_gradient=has_gravity_gradient(reference, chosen.gravity_gradient),
        drag="Cd" in reference,
        solar_pressure="Cr" in reference,
    )


def _active_effects(reference: Reference, effects: Effects, feedback: bool) -> list[str]:
    """What acts in a replay."""
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


def _params(reference: Reference) -> PlantParams:
    mass, inertia = jnp.asarray(reference.number("m", 1.0)), jnp.asarray(_inertia(reference))
    zero, no_vector = jnp.zeros(()), jnp.zeros(3)
    surface = _surface(reference)
    return PlantParams(
        servicer=Body(mass=mass, inertia=inertia),
        servicer_surface=surface,
        target=Target(
            mass=mass,
            inertia=inertia,
            hull=jnp.zeros((1, 3)),
            tumble_rate=zero,
            tumble_axis=no_vector,
            attitude=jnp.array([1.0, 0.0, 0.0, 0.0]),
        ),
        target_surface=surface,
        thruster=_thruster(zero, no_vector, jnp.array([1.0, 0.0, 0.0])),
        wheels=_wheels(reference),
        gravity=_gravity(reference),
        atmosphere=_atmosphere(reference),
        sunlight=_sunlight(reference),
        fault=Fault(kind=zero, start=zero, duration=zero, severity=zero, wheel=zero),
    )


def _inertia(reference: Reference) -> Numbers:
    return reference["I"] if "q" in reference else np.eye(3)


def _gravity(reference: Reference) -> GravityField:
    moving = "r" in reference or "r_target" in reference
    zonals = reference["J"] if "J" in reference and reference["J"].size else np.zeros(1)
    return GravityField(
        mu=jnp.asarray(reference.number("mu") if moving else 0.0),
        radius=jnp.asarray(reference.number("Re", RADIUS_EARTH)),
        zonals=jnp.asarray(zonals),
    )


def _wheels(reference: Reference) -> ReactionWheels:
    """The file's wheels, or three without axes, which do nothing."""
    present = any(key in reference for key in ("gs", "u_cmd", "K"))
    axes = reference["gs"] if present else np.zeros((3, 3))
    count = axes.shape[0]
    none, unlimited = jnp.zeros(count), jnp.full(count, jnp.inf)
    return ReactionWheels(
        axes=jnp.asarray(axes),
        inertia=jnp.asarray(_per_item(reference, "Js", count)) if present else jnp.ones(count),
        torque_limit=jnp.asarray(_per_item(reference, "u_max", count)) if "u_max" in reference else unlimited,
        speed_limit=unlimited,
        initial_speed=jnp.asarray(reference["Omega0"]) if present else none,
        viscous_friction=none,
        coulomb_friction=none,
        stiction_speed=jnp.ones(()),
        torque_step=jnp.ones(()),
    )


def _per_item(reference: Reference, key: str, count: int) -> Numbers:
    value = reference[key]
    if value.size not in (1, count):
        raise FormatError(f"{reference.case}: key {key!r} has {value.size} numbers, expected 1 or {count}")
    return np.broadcast_to(value.ravel(), (count,))


def _thruster(force: Array, position: Array, direction: Array) -> Thruster:
    """A thruster whose exhaust weighs nothing, with an instant valve."""
    zero, no_vector = jnp.zeros(()), jnp.zeros(3)
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
        magnitude_noise=zero,
        direction_noise=zero,
    )


def _thrusters(reference: Reference) -> Thruster:
    """All thrusters of the file, along the first axis."""
    if "burns" not in reference:
        return jax.vmap(_thruster)(jnp.zeros(1), jnp.zeros((1, 3)), jnp.ones((1, 3)))
    reference.number("m")
    directions = reference["thr_dir"]
    force = _per_item(reference, "F_max", directions.shape[0]) * np.linalg.norm(directions, axis=1)
    return jax.vmap(_thruster)(jnp.asarray(force), jnp.asarray(reference["thr_loc"]), jnp.asarray(directions))


def _surface(reference: Reference) -> Surface:
    exposed = "Cd" in reference or "Cr" in reference
    if exposed:
        reference.number("m")
    return Surface(
        area=jnp.asarray(reference.number("A") if exposed else 0.0),
        drag_coefficient=jnp.asarray(reference.number("Cd", 0.0)),
        pressure_coefficient=jnp.asarray(reference.number("Cr", 0.0)),
        center_of_pressure=jnp.zeros(3),
    )


def _atmosphere(reference: Reference) -> Atmosphere:
    """Air that does not turn; its density is stated at the equatorial radius."""
    present = "Cd" in reference
    return Atmosphere(
        density=jnp.asarray(reference.number("rho0") if present else 0.0),
        altitude=jnp.zeros(()),
        scale_height=jnp.asarray(reference.number("H") if present else 1.0),
        rotation=jnp.zeros(()),
    )


def _sunlight(reference: Reference) -> Sunlight:
    """The file's sunlight; a file without a shadow gets an Earth too small to cast one."""
    present = "Cr" in reference
    own_speed = reference.number("c", SPEED_OF_LIGHT)
    return Sunlight(
        # The plant divides by its own speed of light.
        flux=jnp.asarray(reference.number("flux") * SPEED_OF_LIGHT / own_speed if present else 0.0),
        shadow_radius=jnp.asarray(reference.number("Re_eclipse") if "Re_eclipse" in reference else 1e-3),
        sun_radius=jnp.asarray(reference.number("R_sun") if "R_sun" in reference else 6.957e8),
        astronomical_unit=jnp.asarray(reference.number("AU", ASTRONOMICAL_UNIT)),
    )


def _sky(reference: Reference) -> SunMoonPositions:
    needed = "Cr" in reference or "illumination" in reference
    sun = reference["r_sun"] if needed else np.array([ASTRONOMICAL_UNIT, 0.0, 0.0])
    return SunMoonPositions(sun_N=jnp.asarray(sun), moon_N=jnp.array([0.0, 3.8e8, 0.0]))


def _feedback(reference: Reference) -> AttitudeFeedback | None:
    if "K" not in reference:
        return None
    return AttitudeFeedback(stiffness=jnp.asarray(reference.number("K")), damping=jnp.asarray(reference.number("P")))


def _initial_truth(reference: Reference, params: PlantParams) -> Truth:
    """A lone craft flies as the servicer, with the target at the same place and attitude."""
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
    omega = jnp.asarray(reference.initial("omega0", "omega") if turning else np.zeros(3))
    q_BN = quaternion.conjugate(quaternion.normalize(jnp.asarray(q)))
    return Truth(
        r_TN_N=jnp.asarray(r),
        v_TN_N=jnp.asarray(v),
        r_ST_N=jnp.asarray(r_ST),
        v_ST_N=jnp.asarray(v_ST),
        q_BN=q_BN,
        omega_BN_B=omega,
        wheel_speed=params.wheels.initial_speed,
        q_TN=q_BN,
        omega_TN_T=omega,
        mass=params.servicer.mass,
        delta_v=jnp.zeros(()),
    )


# Steps: they end at every sample, command and edge of a burn, and are short enough for the motion.


def _step_schedule(
    reference: Reference, effects: Effects, options: ReplayOptions, closed_loop: bool
) -> tuple[StepSchedule, Numbers]:
    """The steps, and for each sample the row of what they keep that belongs to it."""
    samples = reference["t"]
    decisions = _decision_times(reference) if closed_loop else np.zeros(0)
    commands = reference["t_cmd"] if "u_cmd" in reference and not closed_loop else np.zeros(0)
    burns = reference["burns"] if "burns" in reference else np.zeros((0, 3))
    edges = np.zeros(0) if options.whole_steps else np.concatenate([burns[:, 1], burns[:, 1] + burns[:, 2]])
    knots = _distinct_times(np.concatenate([[0.0], samples, decisions, commands, edges]), float(samples[-1]))
    times = _subdivide(reference.case, knots, options.step_s or _longest_step(reference, effects))
    begin, dt = times[:-1], np.diff(times)
    thruster, ignition, cutoff = _burns_by_step(burns, begin, dt)
    # Two samples at one time share a row; a sample at the start is row 0 before any step.
    ends, rows_of_samples = np.unique(np.searchsorted(times, samples - TIME_TOLERANCE), return_inverse=True)
    row = np.full(dt.size + 1, ends.size)
    row[ends] = np.arange(ends.size)
    steps = StepSchedule(
        dt=jnp.asarray(dt),
        output_row=jnp.asarray(row[1:]),
        torque=jnp.asarray(_torque_in_effect(reference, commands, begin)),
        update_feedback=jnp.asarray(_nearest_distance(decisions, begin) < TIME_TOLERANCE),
        thruster=jnp.asarray(thruster),
        ignition=jnp.asarray(ignition),
        cutoff=jnp.asarray(cutoff),
    )
    return steps, rows_of_samples


def _decision_times(reference: Reference) -> Numbers:
    period = reference.number("dt_ctrl")
    _refuse_too_many(reference.case, reference["t"][-1] / period)
    return np.arange(int(reference["t"][-1] / period) + 1) * period


def _distinct_times(times: Numbers, end: float) -> Numbers:
    ordered = np.sort(times[times <= end])
    return ordered[np.concatenate([[True], np.diff(ordered) > TIME_TOLERANCE])]


def _refuse_too_many(case: str, steps: float) -> None:
    if not steps <= MAX_STEPS:
        raise FormatError(f"{case}: found {steps:.3g} steps to fly, expected {MAX_STEPS:.0g} at most")


def _subdivide(case: str, knots: Numbers, longest: float) -> Numbers:
    """Knots with each interval divided evenly into as many parts as the longest step asks for."""
    _refuse_too_many(case, float(np.sum(np.maximum(1.0, np.ceil(np.diff(knots) / longest - 1e-9)))))
    parts = [
        np.linspace(begin, end, max(1, int(np.ceil((end - begin) / longest - 1e-9))), endpoint=False)
        for begin, end in itertools.pairwise(knots)
    ]
    return np.concatenate([*parts, knots[-1:]])


def _longest_step(reference: Reference, effects: Effects) -> float:
    limits = [60.0]
    for name in ("", "_target"):
        if f"r{name}" in reference:
            r, v = reference.initial(f"r0{name}", f"r{name}"), reference.initial(f"v0{name}", f"v{name}")
            limits.append(ORBIT_ANGLE_PER_STEP / _perigee_rate(reference.number("mu"), r, v))
    if "q" in reference:
        limits.append(BODY_ANGLE_PER_STEP / max(_body_rate(reference), 1e-6))
    if effects.solar_pressure:
        limits.append(MAX_STEP_IN_SUNLIGHT)
    return min(limits)


def _perigee_rate(mu: float, r: Numbers, v: Numbers) -> float:
    """Angular rate at perigee [rad/s] of the two-body orbit through a state."""
    momentum = float(np.linalg.norm(np.cross(r, v)))
    energy = float(v @ v) / 2.0 - mu / float(np.linalg.norm(r))
    parameter = momentum**2 / mu
    eccentricity = np.sqrt(max(0.0, 1.0 + 2.0 * energy * parameter / mu))
    return momentum * float((1.0 + eccentricity) / parameter) ** 2


def _body_rate(reference: Reference) -> float:
    """Bound on how fast attitude and momentum turn in the body [rad/s]."""
    inertia = reference["I"]
    least = float(np.linalg.eigvalsh(inertia)[0])
    spin = inertia @ reference.initial("omega0", "omega")
    stored = 0.0
    if "gs" in reference:
        count = reference["gs"].shape[0]
        history = _per_item(reference, "Js", count) * reference["Omega0"][None, :]
        if "u_cmd" in reference:
            spans = np.diff(np.append(reference["t_cmd"], max(reference["t"][-1], reference["t_cmd"][-1])))
            history = np.concatenate([history, history + np.cumsum(reference["u_cmd"] * spans[:, None], axis=0)])
        stored = float(np.max(np.linalg.norm(history, axis=1)))
    return (float(np.linalg.norm(spin)) + stored + _angular_impulse(reference)) / least


def _angular_impulse(reference: Reference) -> float:
    """Bound on the angular momentum [N m s] that all burns together give."""
    if "burns" not in reference:
        return 0.0
    directions = reference["thr_dir"]
    force = _per_item(reference, "F_max", directions.shape[0])[:, None] * directions
    torque = np.linalg.norm(np.cross(reference["thr_loc"], force), axis=1)
    burns = reference["burns"]
    return float(np.sum(torque[burns[:, 0].astype(int)] * burns[:, 2]))


def _torque_in_effect(reference: Reference, commands: Numbers, begin: Numbers) -> Numbers:
    """The command that holds in each step, none before the first."""
    count = reference["gs"].shape[0] if "gs" in reference else 3
    if commands.size == 0:
        return np.zeros((begin.size, count))
    rows = np.searchsorted(commands, begin + TIME_TOLERANCE, side="right") - 1
    return np.where(rows[:, None] >= 0, reference["u_cmd"][np.maximum(rows, 0)], 0.0)


def _nearest_distance(times: Numbers, points: Numbers) -> Numbers:
    """From each point to the nearest of the times [s]; infinite if there are none."""
    padded = np.concatenate([[-np.inf], times, [np.inf]])
    after = np.searchsorted(padded, points)
    return np.minimum(points - padded[after - 1], padded[after] - points)


def _burns_by_step(burns: Numbers, begin: Numbers, dt: Numbers) -> tuple[Numbers, Numbers, Numbers]:
    """Thruster, ignition and cutoff of the burns that touch each step, as many as ever touch one."""
    end = begin + dt
    used = np.zeros(begin.size, dtype=np.int64)
    touched = []
    for which, start, on_time in burns[burns[:, 2] > 0.0]:
        first = int(np.searchsorted(end, start + TIME_TOLERANCE, side="right"))
        rows = np.arange(first, max(first, int(np.searchsorted(begin, start + on_time - TIME_TOLERANCE))))
        touched.append((rows, used[rows].copy(), int(which), start, start + on_time))
        used[rows] += 1
    shape = (begin.size, int(np.max(used)))
    thruster, ignition, cutoff = np.zeros(shape, dtype=np.int32), np.zeros(shape), np.zeros(shape)
    for rows, slot, which, start, stop in touched:
        thruster[rows, slot] = which
        ignition[rows, slot], cutoff[rows, slot] = start - begin[rows], stop - begin[rows]
    return thruster, ignition, cutoff


# The flight itself.


@partial(jax.jit, static_argnums=(0, 1))
def _propagate(
    effects: Effects,
    output_rows: int,
    params: PlantParams,
    thrusters: Thruster,
    sky: SunMoonPositions,
    feedback: AttitudeFeedback | None,
    start: Truth,
    steps: StepSchedule,
) -> Truth:
    """Truth at the rows that are kept; the first is the start unless a step writes it."""

    def body(carry: tuple[Truth, Array, Truth], step: StepSchedule) -> tuple[tuple[Truth, Array, Truth], None]:
        truth, torque, kept = carry
        torque = (
            step.torque
            if feedback is None
            else jnp.where(step.update_feedback, _feedback_torque(feedback, params, truth), torque)
        )
        thrusts = tuple(_thrust(effects, thrusters, step, slot) for slot in range(step.thruster.shape[0]))
        truth = plant.step(effects, params, truth, torque, thrusts, sky, healthy(), step.dt)
        kept = jax.tree.map(lambda history, now: history.at[step.output_row].set(now, mode="drop"), kept, truth)
        return (truth, torque, kept), None

    kept = jax.tree.map(lambda value: jnp.broadcast_to(value, (output_rows, *value.shape)), start)
    return jax.lax.scan(body, (start, jnp.zeros_like(params.wheels.initial_speed), kept), steps)[0][2]


def _thrust(effects: Effects, thrusters: Thruster, step: StepSchedule, slot: int) -> StepThrust:
    thruster = jax.tree.map(lambda all_of_them: all_of_them[step.thruster[slot]], thrusters)
    exact = BurnError(magnitude=jnp.zeros(()), direction=jnp.zeros(3))
    burn = ValveCommand(ignition=step.ignition[slot], cutoff=step.cutoff[slot], burn_error=exact)
    return actuators.thrust_over_step(thruster, burn, effects.integrator, False, step.dt)


def _feedback_torque(feedback: AttitudeFeedback, params: PlantParams, truth: Truth) -> Float[Array, " wheels"]:
    """Wheel torques `-gs . Lr` with `Lr = -K sigma_BN - P omega_BN_B`, sigma the shorter way round."""
    q = quaternion.conjugate(truth.q_BN)
    q = jnp.where(q[0] < 0.0, -q, q)
    sigma = q[1:] / (1.0 + q[0])
    law = feedback.stiffness * sigma + feedback.damping * truth.omega_BN_B
    return jnp.sum(params.wheels.axes * law[None, :], axis=1)


# Comparison.


def _errors(reference: Reference, truth: Truth) -> dict[str, float | None]:
    r_SN_N, v_SN_N = truth.r_TN_N + truth.r_ST_N, truth.v_TN_N + truth.v_ST_N
    position = {"r": r_SN_N, "r_target": truth.r_TN_N, "r_chaser": r_SN_N}
    velocity = {"v": v_SN_N, "v_target": truth.v_TN_N, "v_chaser": v_SN_N}
    return {
        "position_error_m": _largest_distance(reference, position),
        "velocity_error_m_s": _largest_distance(reference, velocity),
        "attitude_error_rad": _maximum_or_none(attitude_errors(reference, truth)),
        "rate_error_rad_s": _largest_distance(reference, {"omega": truth.omega_BN_B}),
        "relative_position_error_m": _maximum_or_none(relative_errors(reference, truth)),
        "illumination_error": _maximum_or_none(illumination_errors(reference)),
        "wheel_speed_error_rad_s": _largest_distance(reference, {"Omega": truth.wheel_speed}),
    }


def _largest_distance(reference: Reference, propagated: dict[str, Array]) -> float | None:
    """Largest distance between any of the histories that the file has and what was flown."""
    found = [float(np.max(_distances(ours, reference[key]))) for key, ours in propagated.items() if key in reference]
    return max(found) if found else None


def _distances(ours: Array | Numbers, theirs: Numbers) -> Numbers:
    return np.linalg.norm(np.asarray(ours) - theirs, axis=1)


def _maximum_or_none(values: Numbers | None) -> float | None:
    return None if values is None else float(np.max(values))


def attitude_errors(reference: Reference, truth: Truth) -> Numbers | None:
    """Angles between attitudes at the samples [rad]; the file's quaternion is the conjugate of `q_BN`."""
    if "q" not in reference:
        return None
    between = jax.vmap(quaternion.multiply)(truth.q_BN, jnp.asarray(reference["q"]))
    return np.asarray(2.0 * jnp.arctan2(jnp.sqrt(jnp.sum(between[:, 1:] ** 2, axis=1)), jnp.abs(between[:, 0])))


def relative_errors(reference: Reference, truth: Truth) -> Numbers | None:
    """Differences [m] of the chaser's position from the target, in the target's Hill frame, at the samples."""
    if "r_target" not in reference:
        return None
    if "rho" in reference:
        frames = jax.vmap(hill_frame)(truth.r_TN_N, truth.v_TN_N)
        rho_H, _ = jax.vmap(inertial_to_hill)(truth.r_ST_N, truth.v_ST_N, *frames)
        return _distances(rho_H, reference["rho"])
    return _distances(truth.r_ST_N, reference["r_chaser"] - reference["r_target"])


def illumination_errors(reference: Reference) -> Numbers | None:
    """Differences of the lit share of the Sun at the file's own positions, at the samples.

    A position error of a millimetre moves the share by 1e-8 in the penumbra, which would hide an error of the formula.
    Not compiled: operations that a compiler fuses round differently, which costs half of the digits in the penumbra.
    """
    if "illumination" not in reference:
        return None
    sun, light_of = jnp.asarray(reference["r_sun"]), _sunlight(reference)
    with jax.disable_jit():
        share = jax.vmap(lambda r: eclipse.illumination(r, sun, light_of.shadow_radius, light_of.sun_radius))
        ours = np.asarray(share(jnp.asarray(reference["r"])))
    return np.abs(ours - reference["illumination"])


# Command line.


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="replay", description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("files", nargs="+", type=Path, metavar="FILE.npz")
    parser.add_argument("--json", action="store_true", help="one JSON object per file and line, instead of a table")
    parser.add_argument("--commands", action="store_true", help="fly logged wheel torques, not the file's feedback law")
    parser.add_argument("--integrator", choices=("rk4", "rk8"), default="rk8")
    parser.add_argument("--step", type=float, metavar="S", help="longest step [s]; default: one that suits the file")
    parser.add_argument(
        "--gravity-gradient", choices=("on", "off", "auto"), default="auto", help="auto: as in the file"
    )
    parser.add_argument("--whole-steps", action="store_true", help="leave burn edges inside steps to the plant")
    return parser


def _table_row(result: ReplayResult) -> str:
    cells = [f"{value:.2e}" if isinstance(value, float) else "-" for value in list(asdict(result).values())[1:8]]
    return f"| {result.case} | {' | '.join(cells)} | {result.integrator}, {result.step_s:.4g} s |"


_TABLE_HEADER = (
    "| case | position m | velocity m/s | attitude rad | rate rad/s | relative m | illumination "
    "| wheels rad/s | step |\n|---|---|---|---|---|---|---|---|---|"
)


def main(arguments: list[str] | None = None) -> int:
    """Replays the files named on the command line; 2 if one cannot be, with one line on stderr."""
    parser = _parser()
    given = parser.parse_args(arguments)
    if given.step is not None and not given.step > 0.0:
        parser.error(f"--step: found {given.step}, expected more than 0")
    options = ReplayOptions(given.integrator, given.step, given.commands, given.whole_steps, given.gravity_gradient)
    if not given.json:
        print(_TABLE_HEADER)
    refused = [path for path in given.files if not _replay_file(path, options, given.json)]
    return 2 if refused else 0


def _replay_file(path: Path, options: ReplayOptions, as_json: bool) -> bool:
    """True if a file could be replayed."""
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
