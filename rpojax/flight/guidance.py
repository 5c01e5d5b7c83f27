"""Attitude guidance: camera on the target, turn to the burn, burn, turn back; and a search when the target is lost.

The pointing schedule follows Figure 5 of the re-implemented paper; its times come from the slew that the wheels can do.
"""

import enum
import math

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from rpojax.core import light, quaternion, safe
from rpojax.core.frames import apply, apply_transposed, hill_frame, inertial_to_hill, look_at
from rpojax.core.orbital_mechanics import mean_motion, relative_transition, semi_major_axis
from rpojax.core.pytree import pytree, replace
from rpojax.core.quaternion import rotate
from rpojax.core.series import cos_sinc
from rpojax.flight.attitude_control import AttitudeCommand
from rpojax.flight.formation_control import Formation, FormationLaw
from rpojax.flight.onboard import Onboard
from rpojax.flight.orbit_filter import OrbitEstimate

Vector = Float[Array, "3"]
Scalar = Float[Array, ""]
Flag = Bool[Array, ""]


class Mode(enum.IntEnum):
    """What the body is doing; a turn to a target whose estimate has jumped counts as search."""

    LOOK = 0
    TURN = 1
    BURN = 2
    TURN_BACK = 3
    SEARCH = 4


@pytree
class Pointing:
    """Slew and search parameters.

    Attributes:
        slew_acceleration: () peak angular acceleration of a planned slew [rad/s^2]
        slew_minimum_time: () [s]
        settle_time: () between the end of a slew and the burn [s]
        look_away_limit: () from the start of the turn to the end of the turn back [s]
        search_after: () seconds without an accepted box, outside planned look-aways [s]
        acquisition_wait: () the same before the first accepted box of the run [s]
        search_pitch: () distance between turns of the search spiral [rad]
        search_acceleration: () centripetal acceleration along the spiral [rad/s^2]
        search_sigmas: () the spiral starts anew beyond this many sigma of projected uncertainty [-]
        search_radius_max: () and beyond this angle at any rate [rad]
        burn_attitude_limit: () no thrust while the attitude is further from the burn's [rad]
    """

    slew_acceleration: Array
    slew_minimum_time: Array
    settle_time: Array
    look_away_limit: Array
    search_after: Array
    acquisition_wait: Array
    search_pitch: Array
    search_acceleration: Array
    search_sigmas: Array
    search_radius_max: Array
    burn_attitude_limit: Array


@pytree
class BurnPlan:
    """The burn decided last. Times count from the start of the run.

    Attributes:
        turn_start: () [s]
        ignition: () [s]
        cutoff: () equal to ignition when there is no burn [s]
        delta_v_N: (3,) [m/s]
        q_burn: (4,) attitude during the burn
    """

    turn_start: Array
    ignition: Array
    cutoff: Array
    delta_v_N: Array
    q_burn: Array


@pytree
class Reference:
    """Commanded attitude as a function of time: a moving end attitude and a remainder of a slew that dies out.

    Attributes:
        q_EN: (4,) end attitude at the epoch of the reference
        omega_EN_E: (3,) its rate [rad/s]
        remainder: (3,) rotation vector of the whole slew, command from end [rad]
        slew_age: () since the slew began, at the epoch [s]
        slew_time: () its duration [s]
    """

    q_EN: Array
    omega_EN_E: Array
    remainder: Array
    slew_age: Array
    slew_time: Array


@pytree
class PointingState:
    """Memory of the attitude guidance.

    Attributes:
        reference: the present reference
        to_burn: () bool, the end attitude is the burn's
        acquired: () bool, the target has been seen for sure since it last came into the light
        sightings: () accepted boxes of late, fading with every frame that looks and sees none [-]
        unseen_time: () since the last accepted box, planned look-aways and darkness left out [s]
        search_time: () since the search began; 0 when not searching [s]
    """

    reference: Reference
    to_burn: Array
    acquired: Array
    sightings: Array
    unseen_time: Array
    search_time: Array


def no_burn() -> BurnPlan:
    """Plan before the first decision."""
    zero = jnp.zeros((), dtype=jnp.float64)
    identity = jnp.array([1.0, 0.0, 0.0, 0.0], dtype=jnp.float64)
    return BurnPlan(turn_start=zero, ignition=zero, cutoff=zero, delta_v_N=jnp.zeros(3), q_burn=identity)


def slew_duration(pointing: Pointing, angle: Scalar) -> Scalar:
    """Time [s] of a rest-to-rest slew over `angle` [rad] with the cycloidal profile of `evaluate`."""
    time = safe.sqrt(2.0 * math.pi * angle / pointing.slew_acceleration)
    return jnp.maximum(time, pointing.slew_minimum_time)


def look_attitude(onboard: Onboard, estimate: OrbitEstimate) -> tuple[Float[Array, "4"], Vector]:
    """Attitude `q_BN` with the camera on the estimated target and its x axis towards the orbit normal, and its rate."""
    line = safe.normalize(estimate.relative.r_TS_N)
    distance = safe.norm(estimate.relative.r_TS_N)
    line_rate = (estimate.relative.v_TS_N - jnp.sum(estimate.relative.v_TS_N * line, axis=0) * line) / distance
    normal = safe.normalize(quaternion.cross(estimate.servicer.r_SN_N, estimate.servicer.v_SN_N))
    R_KN = look_at(line, normal)
    elevation = jnp.sum(normal * line, axis=0)
    roll_rate = -elevation * jnp.sum(line_rate * R_KN[1], axis=0) / safe.norm(normal - elevation * line)
    omega_N = quaternion.cross(line, line_rate) + roll_rate * line
    q_BK = quaternion.conjugate(quaternion.normalize(onboard.camera_mounting))
    q_BN = quaternion.multiply(q_BK, quaternion.from_matrix(R_KN))
    return q_BN, rotate(q_BN, omega_N)


def plan_burn(
    law: FormationLaw,
    formation: Formation,
    pointing: Pointing,
    onboard: Onboard,
    gain: Float[Array, "3 6"],
    estimate: OrbitEstimate,
    allowed: Flag,
    time: Scalar,
) -> BurnPlan:
    """Next burn: deviation predicted to the burn's middle, control law there, thrust axis, on-time, turn.

    No burn inside the dead band, below the thruster's minimum on-time, while the range is too uncertain, or unless
    `allowed`; a burn too long for the look-away limit is shortened.
    """
    deviation, R_CN = _deviation_at_burn(formation, estimate)
    delta_v_N = apply_transposed(R_CN, law(gain, deviation))
    size, direction_N = safe.norm(delta_v_N), safe.normalize(delta_v_N)

    q_look, _ = look_attitude(onboard, estimate)
    thrust_now_N = rotate(quaternion.conjugate(q_look), onboard.thrust_direction)
    turn_N = quaternion.between(thrust_now_N, direction_N)
    turn_time = slew_duration(pointing, safe.norm(turn_N))

    longest = pointing.look_away_limit - 2.0 * turn_time - pointing.settle_time - _SCHEDULE_GRAIN
    on_time = jnp.minimum(size * onboard.mass / onboard.thrust, jnp.maximum(longest, 0.0))
    wanted = safe.gate(size - formation.dead_band, 0.05 * formation.dead_band + 1e-6)
    possible = (
        (on_time >= onboard.minimum_on_time)
        & (range_uncertainty(estimate) < formation.range_uncertainty_limit)
        & allowed
    )
    on_time = wanted * jnp.where(possible, on_time, 0.0)
    ignition = time + formation.lead - 0.5 * on_time
    return BurnPlan(
        # Without a burn there is no look-away: the turn "starts" when it is already over.
        turn_start=jnp.where(on_time > 0.0, jnp.maximum(ignition - pointing.settle_time - turn_time, time), ignition),
        ignition=ignition,
        cutoff=ignition + on_time,
        delta_v_N=on_time * onboard.thrust / onboard.mass * direction_N,
        q_burn=quaternion.multiply(q_look, quaternion.exp(-turn_N)),
    )


_SCHEDULE_GRAIN = 3.0
"""Turns begin on whole guidance ticks, which can add a second to each; one more for the target's own motion [s]."""


def _deviation_at_burn(formation: Formation, estimate: OrbitEstimate) -> tuple[Float[Array, "6"], Float[Array, "3 3"]]:
    """Deviation of (rho, rho_dot) predicted to the burn's middle [m, m/s], and the Hill frame `R_CN` there.

    The motion is predicted and then compared, since a place off the along-track axis does not stay where it is.
    """
    r_TN_N, v_TN_N = (
        estimate.servicer.r_SN_N + estimate.relative.r_TS_N,
        estimate.servicer.v_SN_N + estimate.relative.v_TS_N,
    )
    R_HN, omega_HN_N = hill_frame(r_TN_N, v_TN_N)
    rho, rho_dot = inertial_to_hill(-estimate.relative.r_TS_N, -estimate.relative.v_TS_N, R_HN, omega_HN_N)
    n = mean_motion(semi_major_axis(r_TN_N, v_TN_N))
    now = jnp.concatenate([rho, rho_dot])
    desired = jnp.pad(formation.desired_position, (0, 3))
    transition = relative_transition(n, formation.lead)
    angle = n * formation.lead
    c, s = jnp.cos(angle), jnp.sin(angle)
    R_CN = jnp.stack([c * R_HN[0] + s * R_HN[1], -s * R_HN[0] + c * R_HN[1], R_HN[2]])
    return jnp.sum(transition * now[None, :], axis=1) - desired, R_CN


def range_uncertainty(estimate: OrbitEstimate) -> Scalar:
    """1-sigma of the range over the range [-]."""
    line = safe.normalize(estimate.relative.r_TS_N)
    P = estimate.relative.covariance[:3, :3]
    return safe.sqrt(jnp.sum(line * apply(P, line), axis=0)) / safe.norm(estimate.relative.r_TS_N)


def bearing_uncertainty(estimate: OrbitEstimate) -> Scalar:
    """1-sigma of the bearing in its worse direction, at most [rad]: the trace across the line of sight."""
    line = safe.normalize(estimate.relative.r_TS_N)
    P = estimate.relative.covariance[:3, :3]
    across = P[0, 0] + P[1, 1] + P[2, 2] - jnp.sum(line * apply(P, line), axis=0)
    return safe.sqrt(across) / safe.norm(estimate.relative.r_TS_N)


def initial_pointing(onboard: Onboard, estimate: OrbitEstimate) -> PointingState:
    """Camera on the estimated target, no slew under way."""
    q_EN, omega = look_attitude(onboard, estimate)
    zero = jnp.zeros((), dtype=jnp.float64)
    reference = Reference(
        q_EN=q_EN, omega_EN_E=omega, remainder=jnp.zeros(3), slew_age=zero, slew_time=jnp.ones((), dtype=jnp.float64)
    )
    never = jnp.zeros((), dtype=bool)
    return PointingState(
        reference=reference, to_burn=never, acquired=never, sightings=zero, unseen_time=zero, search_time=zero
    )


def inhibit(pointing: Pointing, plan: BurnPlan, q_BN: Float[Array, "4"], time: Scalar, dt: float) -> BurnPlan:
    """The plan, cut off now if the thruster is to push within the next `dt` [s] and the attitude is not the burn's."""
    # Half the chord between the quaternions is the sine of a quarter of the angle; small angles suffice here.
    alike = jnp.abs(jnp.sum(plan.q_burn * q_BN, axis=0))
    astray = alike < jnp.cos(0.5 * pointing.burn_attitude_limit)
    due = (time + dt > plan.ignition) & (time < plan.cutoff)
    stop = astray & due
    ignition = jnp.where(stop, jnp.minimum(plan.ignition, time), plan.ignition)
    return replace(plan, ignition=ignition, cutoff=jnp.where(stop, jnp.maximum(ignition, time), plan.cutoff))


def can_see(onboard: Onboard, estimate: OrbitEstimate, sun_N: Vector, tolerance: float = 0.0) -> Flag:
    """True while the target should be visible: by the estimate, the Sun at `sun_N` [m] and the camera's limits.

    `tolerance` [rad] widens the limits: what may just be visible is not to be disbelieved.
    """
    r_TN_N = estimate.servicer.r_SN_N + estimate.relative.r_TS_N
    phase, exclusion = onboard.phase_limit + tolerance, onboard.sun_exclusion - tolerance
    return light.is_observable(r_TN_N, -estimate.relative.r_TS_N, sun_N, phase, exclusion)


LIGHT_TOLERANCE = math.radians(10.0)
"""Widening of the camera's light limits within which a box is believed [rad]: what a bearing may be wrong at worst."""


def is_lost(pointing: Pointing, state: PointingState) -> Flag:
    """True when the target has not been seen for too long, or not yet since it came into the light."""
    return (state.unseen_time > pointing.search_after) | ~state.acquired | (state.sightings < _SURE)


def evaluate(reference: Reference, age: Scalar) -> AttitudeCommand:
    """Command `age` [s] after the epoch of the reference."""
    q_EN = quaternion.propagate(reference.q_EN, reference.omega_EN_E, age)
    fraction = jnp.clip((reference.slew_age + age) / reference.slew_time, 0.0, 1.0)
    # The cycloid sin(2 pi f) with its argument shifted by pi, into the range of the series.
    phase = 2.0 * math.pi * (fraction - 0.5)
    cosine, sinc = cos_sinc(phase * phase)
    sine = phase * sinc
    done = fraction + sine / (2.0 * math.pi)
    moving = fraction < 1.0
    rate = jnp.where(moving, (1.0 + cosine) / reference.slew_time, 0.0)
    acceleration = jnp.where(moving, -2.0 * math.pi * sine / reference.slew_time**2, 0.0)
    q_CE = quaternion.exp((1.0 - done) * reference.remainder)
    return AttitudeCommand(
        q_CN=quaternion.multiply(q_CE, q_EN),
        omega_CN_C=rate * reference.remainder + rotate(q_CE, reference.omega_EN_E),
        acceleration_C=acceleration * reference.remainder,
    )


def guide(
    pointing: Pointing,
    onboard: Onboard,
    estimate: OrbitEstimate,
    plan: BurnPlan,
    state: PointingState,
    box_accepted: Flag,
    visible: Flag,
    time: Scalar,
    dt: float,
) -> tuple[PointingState, Array]:
    """Reference for the next `dt` [s] and the present mode; in the dark (not `visible`) nothing is searched for."""
    visible = visible | box_accepted
    to_burn = (time >= plan.turn_start) & (time < plan.cutoff)
    looking_away = to_burn | (state.to_burn | _slewing_back(state)) & ~box_accepted
    sightings = _count_sightings(state.sightings, box_accepted, visible, looking_away)
    sure = box_accepted & (sightings > _SURE)
    acquired = (state.acquired & visible) | sure
    patience = jnp.where(acquired, pointing.search_after, pointing.acquisition_wait)
    unseen = state.unseen_time + jnp.where(looking_away, 0.0, dt)
    # One box may be false: it makes the camera stay for a while, the next one makes it believe.
    unseen = jnp.where(box_accepted, jnp.minimum(unseen, patience - _STARE), unseen)
    unseen = jnp.where(sure | ~visible, 0.0, unseen)
    searching = (unseen > patience) & ~to_burn
    search_time = jnp.where(searching, _search_clock(pointing, estimate, state.search_time + dt), 0.0)

    q_look, omega_look = look_attitude(onboard, estimate)
    offset_K, offset_rate_K = _spiral(pointing, search_time)
    q_BK = quaternion.conjugate(quaternion.normalize(onboard.camera_mounting))
    q_search = quaternion.multiply(quaternion.exp(-rotate(q_BK, offset_K)), q_look)
    q_home = jnp.where(searching, q_search, q_look)
    omega_home = omega_look + jnp.where(searching, rotate(q_BK, offset_rate_K), 0.0)
    q_end = jnp.where(to_burn, plan.q_burn, q_home)
    omega_end = jnp.where(to_burn, 0.0, omega_home)

    reference = _retarget(pointing, state.reference, q_end, omega_end, to_burn != state.to_burn, dt)
    slewing = reference.slew_age < reference.slew_time
    away = jnp.where(time >= plan.ignition, Mode.BURN, Mode.TURN)
    # A burn that was called off has a turn, too.
    after_burn = (plan.cutoff > plan.turn_start) & (time < plan.cutoff + pointing.look_away_limit)
    back = jnp.where(after_burn, Mode.TURN_BACK, Mode.SEARCH)
    home = jnp.where(searching, Mode.SEARCH, jnp.where(slewing, back, Mode.LOOK))
    mode = jnp.where(to_burn, away, home)
    after = PointingState(
        reference=reference,
        to_burn=to_burn,
        acquired=acquired,
        sightings=sightings,
        unseen_time=unseen,
        search_time=search_time,
    )
    return after, mode


def _count_sightings(before: Scalar, accepted: Flag, visible: Flag, looking_away: Flag) -> Scalar:
    """Accepted boxes of late; planned look-aways leave the count as it is, darkness ends it."""
    count = jnp.where(accepted, before + 1.0, jnp.where(looking_away, before, _SIGHTING_FADES * before))
    return jnp.where(visible, jnp.minimum(count, _SIGHTINGS_KEPT), 0.0)


_SIGHTING_FADES = 0.8
"""What is left of the count of sightings after a frame without one."""
_SIGHTINGS_KEPT = 10.0
"""The count goes no higher, so that it is forgotten within half a minute."""
_SURE = 2.5
"""From so many sightings on the target counts as seen: false boxes come once in twenty frames and rarely agree."""
_STARE = 5.0
"""How long a single box keeps the camera from searching [s]."""


def _slewing_back(state: PointingState) -> Flag:
    return ~state.to_burn & (state.reference.slew_age < state.reference.slew_time)


def _retarget(
    pointing: Pointing, before: Reference, q_end: Array, omega_end: Vector, changed: Flag, dt: float
) -> Reference:
    """Reference with a new end attitude; a change of task or a jump of the end starts a new slew from the command."""
    step = jnp.asarray(dt, dtype=jnp.float64)
    q_end_expected = quaternion.propagate(before.q_EN, before.omega_EN_E, dt)
    jump = safe.norm(quaternion.log(quaternion.multiply(q_end, quaternion.conjugate(q_end_expected))))
    restart = changed | (jump > _JUMP)
    command = evaluate(before, step)
    remainder = quaternion.log(quaternion.multiply(command.q_CN, quaternion.conjugate(q_end)))
    return Reference(
        q_EN=q_end,
        omega_EN_E=omega_end,
        remainder=jnp.where(restart, remainder, before.remainder),
        slew_age=jnp.where(restart, 0.0, before.slew_age + dt),
        slew_time=jnp.where(restart, slew_duration(pointing, safe.norm(remainder)), before.slew_time),
    )


_JUMP = math.radians(5.0)
"""A larger step of the end attitude within one tick is flown as a slew [rad]."""


def _search_clock(pointing: Pointing, estimate: OrbitEstimate, time: Scalar) -> Scalar:
    """Time along the spiral [s]; back to its start once it has left the projected uncertainty."""
    radius = jnp.minimum(pointing.search_sigmas * bearing_uncertainty(estimate), pointing.search_radius_max)
    full = jnp.maximum(radius**1.5 / _spiral_growth(pointing), 10.0)
    return jnp.where(time > full, 1.0, time)


def _spiral_growth(pointing: Pointing) -> Scalar:
    """Rate of radius^(3/2) [rad^(3/2)/s] on an Archimedean spiral flown at constant centripetal acceleration."""
    return 0.75 * pointing.search_pitch * jnp.sqrt(pointing.search_acceleration) / math.pi


def _spiral(pointing: Pointing, time: Scalar) -> tuple[Vector, Vector]:
    """Turn of the camera [rad] and its rate [rad/s] on the search spiral."""
    growth = _spiral_growth(pointing)
    # The first second is left out: there the spiral's radius would start at an infinite rate.
    volume = growth * (time + 1.0)
    radius = jnp.cbrt(volume * volume)
    radius_rate = 2.0 / 3.0 * growth / jnp.sqrt(radius)
    turns = 2.0 * math.pi / pointing.search_pitch
    c, s = jnp.cos(turns * radius), jnp.sin(turns * radius)
    none = jnp.zeros_like(radius)
    outward, around = jnp.stack([c, s, none]), jnp.stack([-s, c, none])
    return radius * outward, radius_rate * (outward + turns * radius * around)
