"""Integration steps of a replay: they end at every sample, command and burn edge and resolve the motion."""

import itertools

import jax
import numpy as np
from jaxtyping import Array

from experiments.validation.plant_from_reference import per_item
from experiments.validation.reference_file import FormatError, Numbers, Reference
from rpojax.core.pytree import pytree
from rpojax.physics.plant_options import Effects

TIME_TOLERANCE = 1e-9
"""Times closer than this [s] count as equal."""
ORBIT_ANGLE_PER_STEP = 0.02
"""Orbit angle at perigee per step [rad]."""
BODY_ANGLE_PER_STEP = 0.1
"""Rotation of the body, and of its angular momentum in the body, per step [rad]."""
MAX_STEP_IN_SUNLIGHT = 1.0
"""Longest step with solar pressure [s], as the edges of the penumbra lie inside steps."""
MAX_STEPS = 5e6
"""Most steps of a replay."""


@pytree
class StepSchedule:
    """Steps of a replay, along the first axis.

    Attributes:
        dt: (n,) [s]
        output_row: (n,) row of the result that holds the state after the step; out of range if none
        torque: (n, wheels) logged wheel torque [N m]
        update_feedback: (n,) bool, whether the feedback law computes a new torque at the start of the step
        thruster: (n, slots) index of the thruster of a burn in this step
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


def make_step_schedule(
    reference: Reference, effects: Effects, closed_loop: bool, step_s: float | None, whole_steps: bool
) -> tuple[StepSchedule, Numbers]:
    """Steps, and the output row of each sample.

    Args:
        reference: trajectory with its commands and burns
        effects: of the plant
        closed_loop: whether the feedback law replaces logged commands
        step_s: longest step [s]; None for one that suits the reference
        whole_steps: do not split steps where a burn begins or ends
    """
    samples = reference["t"]
    decisions = _decision_times(reference) if closed_loop else np.zeros(0)
    commands = reference["t_cmd"] if "u_cmd" in reference and not closed_loop else np.zeros(0)
    burns = reference["burns"] if "burns" in reference else np.zeros((0, 3))
    edges = np.zeros(0) if whole_steps else np.concatenate([burns[:, 1], burns[:, 1] + burns[:, 2]])
    knots = _distinct_times(np.concatenate([[0.0], samples, decisions, commands, edges]), float(samples[-1]))
    times = _subdivide(reference.case, knots, step_s or _longest_step(reference, effects))
    begin, dt = times[:-1], np.diff(times)
    thruster, ignition, cutoff = _burns_by_step(burns, begin, dt)
    # Two samples at one time share a row; a sample at the start is row 0 before any step.
    ends, rows_of_samples = np.unique(np.searchsorted(times, samples - TIME_TOLERANCE), return_inverse=True)
    row = np.full(dt.size + 1, ends.size)
    row[ends] = np.arange(ends.size)
    steps = StepSchedule(
        dt=jax.device_put(dt),
        output_row=jax.device_put(row[1:]),
        torque=jax.device_put(_torque_in_effect(reference, commands, begin)),
        update_feedback=jax.device_put(_nearest_distance(decisions, begin) < TIME_TOLERANCE),
        thruster=jax.device_put(thruster),
        ignition=jax.device_put(ignition),
        cutoff=jax.device_put(cutoff),
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
        raise FormatError(f"{case}: found {steps:.3g} steps to simulate, expected {MAX_STEPS:.0g} at most")


def _subdivide(case: str, knots: Numbers, longest: float) -> Numbers:
    """Knots and equal subdivisions of each interval, so that no step is longer than `longest`."""
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
    """Bound on the angular rate of the body, and of its angular momentum in the body [rad/s]."""
    inertia = reference["I"]
    least = float(np.linalg.eigvalsh(inertia)[0])
    spin = inertia @ reference.initial("omega0", "omega")
    stored = 0.0
    if "gs" in reference:
        count = reference["gs"].shape[0]
        history = per_item(reference, "Js", count) * reference["Omega0"][None, :]
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
    force = per_item(reference, "F_max", directions.shape[0])[:, None] * directions
    torque = np.linalg.norm(np.cross(reference["thr_loc"], force), axis=1)
    burns = reference["burns"]
    return float(np.sum(torque[burns[:, 0].astype(int)] * burns[:, 2]))


def _torque_in_effect(reference: Reference, commands: Numbers, begin: Numbers) -> Numbers:
    """Logged command that holds in each step; zero before the first."""
    count = reference["gs"].shape[0] if "gs" in reference else 3
    if commands.size == 0:
        return np.zeros((begin.size, count))
    rows = np.searchsorted(commands, begin + TIME_TOLERANCE, side="right") - 1
    return np.where(rows[:, None] >= 0, reference["u_cmd"][np.maximum(rows, 0)], 0.0)


def _nearest_distance(times: Numbers, points: Numbers) -> Numbers:
    """Distance of each point from the nearest of `times` [s]; infinite without any."""
    padded = np.concatenate([[-np.inf], times, [np.inf]])
    after = np.searchsorted(padded, points)
    return np.minimum(points - padded[after - 1], padded[after] - points)


def _burns_by_step(burns: Numbers, begin: Numbers, dt: Numbers) -> tuple[Numbers, Numbers, Numbers]:
    """Thruster, ignition and cutoff (n, slots) of the burns that overlap each step."""
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
