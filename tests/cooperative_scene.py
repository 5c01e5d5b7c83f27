"""Small Monte Carlo of servicers around one target, with the errors that their filters believe in."""

from dataclasses import dataclass
from functools import partial

import jax
import jax.numpy as jnp
from jaxtyping import Array

from rpojax.batching.vmap_last_axis import vmap as vmap_last
from rpojax.core import quaternion
from rpojax.core.mahalanobis_distance import squared_mahalanobis_and_log_determinant
from rpojax.core.pytree import pytree
from rpojax.core.pytree import replace as replaced
from rpojax.flight.cooperation import baseline_motion, sharing
from rpojax.flight.cooperation.baseline_motion import TickMotion
from rpojax.flight.cooperation.sharing import SharingMemory
from rpojax.flight.cooperation.team_records import TeamRecords, of_pairs
from rpojax.flight.cooperation.team_settings import BaselineTuning, Link, LinkSettings, ServicerTuning
from rpojax.flight.navigation import burn_execution_error, combined_orbit_filter, lasting_error_effects, shape_errors
from rpojax.flight.navigation.box_measurement import outlier_gate
from rpojax.flight.navigation.box_measurement.box_measurement_model import linearise_box
from rpojax.flight.navigation.box_measurement.outlier_gate import GateState
from rpojax.flight.navigation.combined_orbit_filter import OrbitEstimate
from rpojax.flight.navigation.orbit_measurements import BoxMeasurement, GpsMeasurement, box_view
from rpojax.flight.navigation.relative_filter_state import VIEW_STATES
from rpojax.sensors import link_range
from rpojax.sensors.link_range import LinkRange

MU = 3.986004418e14
RADIUS = 6878137.0
DEGREE = 0
FOCAL_PX = 731.5


@dataclass(frozen=True)
class Case:
    """One case of the Monte Carlo."""

    link: LinkSettings
    loss: float = 0.0
    phases_deg: tuple[float, ...] = (0.0, 90.0)
    distance_m: float = 30.0
    baseline_noise: float = 0.05
    baseline_error: float = 0.007
    burn_m_s: float = 2e-3
    burn_period: int = 200
    black: tuple[tuple[int, int, int], ...] = ()
    outages: tuple[tuple[int, int], ...] = ()
    ticks: int = 2000
    alone: bool = False


@pytree
class World:
    """Truth and filters of a team; arrays have the servicers along the last axis."""

    r_SN_N: Array
    v_SN_N: Array
    d: Array
    scale: Array
    bias: Array
    center: Array
    aspect: Array
    gps_error: Array
    orbit: OrbitEstimate
    gate: GateState
    memory: SharingMemory
    key: Array


def settings(servicers: int, method: str, period: int = 1, delay: int = 0, ranging: bool = False) -> LinkSettings:
    pairs = tuple((i, j) for i in range(servicers) for j in range(servicers) if i != j)
    return LinkSettings(servicers, method, period, delay, pairs, DEGREE, ranging)


def look_at(r_TS_N: Array) -> Array:
    """Rotation from N to a camera that looks along a vector."""
    z = r_TS_N / jnp.linalg.norm(r_TS_N)
    x = jnp.cross(jnp.array([0.0, 0.0, 1.0]), z)
    x = x / jnp.linalg.norm(x)
    return jnp.stack([x, jnp.cross(z, x), z])


def start(case: Case, tuning, baseline: BaselineTuning, key: Array) -> World:
    n = jnp.sqrt(MU / RADIUS**3)
    N = len(case.phases_deg)
    keys = jax.random.split(key, 9)
    phase = jnp.deg2rad(jnp.array(case.phases_deg))
    # A circular relative orbit, of radius distance.
    a = case.distance_m / 2.0
    x, y, z = a * jnp.sin(phase), 2 * a * jnp.cos(phase), jnp.sqrt(3.0) * a * jnp.sin(phase)
    vx, vy, vz = a * n * jnp.cos(phase), -2 * a * n * jnp.sin(phase), jnp.sqrt(3.0) * a * n * jnp.cos(phase)
    rho = jnp.stack([x, y, z])
    rho_dot = jnp.stack([vx, vy, vz])
    # At the start, N and H are parallel.
    omega = jnp.array([0.0, 0.0, n])
    v_rel = rho_dot + jnp.cross(omega[:, None], rho, axis=0)
    r_T, v_T = jnp.array([RADIUS, 0.0, 0.0]), jnp.array([0.0, RADIUS * n, 0.0])
    d = jnp.concatenate([-rho, -v_rel])
    err = jax.random.normal(keys[0], (12, N))
    r_S, v_S = r_T[:, None] + rho, v_T[:, None] + v_rel
    orbit = vmap_last(partial(combined_orbit_filter.initial, tuning, slow_states=VIEW_STATES), in_axes=-1, out_axes=-1)(
        r_S + tuning.initial_position_sigma * err[:3],
        v_S + tuning.initial_velocity_sigma * err[3:6],
        d[:3] + tuning.initial_relative_position_sigma * err[6:9],
        d[3:] + tuning.initial_relative_velocity_sigma * err[9:12],
    )
    gate = jax.tree.map(lambda leaf: jnp.stack([leaf] * N, axis=-1), outlier_gate.initial())
    center_sigma = jnp.sqrt(shape_errors.center_variance(tuning, jnp.zeros(()), d[:3, 0]))
    world = World(
        r_SN_N=r_S,
        v_SN_N=v_S,
        d=d,
        scale=tuning.scale_sigma[:, None] * jax.random.normal(keys[1], (2, N)),
        bias=tuning.bearing_bias_sigma * jax.random.normal(keys[2], (2, N)),
        center=center_sigma * jax.random.normal(keys[3], (2, N)),
        aspect=jnp.sqrt(0.2) * jax.random.normal(keys[4], (N,)),
        gps_error=case.baseline_error / jnp.sqrt(2.0) * jax.random.normal(keys[5], (3, N)),
        orbit=orbit,
        gate=gate,
        memory=None,
        key=keys[6],
    )
    records = records_of(world, blank(N), zero_gps(N), jnp.zeros(N, dtype=bool), None)
    if case.link.ranging:
        records = replaced(records, ranges=jnp.zeros((N - 1, N)))
    memory = sharing.initial(link_of(case, baseline), servicers_tuning(tuning, N), records)
    return replaced(world, memory=memory)


def link_of(case: Case, baseline: BaselineTuning) -> Link:
    return Link(case.link, baseline, 1.0)


def servicers_tuning(tuning, N: int) -> ServicerTuning:
    return each(ServicerTuning(filter=tuning, focal_px=jnp.asarray(FOCAL_PX)), N)


def each(tree, N: int):
    return jax.tree.map(lambda leaf: jnp.stack([leaf] * N, axis=-1), tree)


def zero_gps(N: int) -> GpsMeasurement:
    return GpsMeasurement(position_N=jnp.zeros((3, N)), present=jnp.ones(N, dtype=bool))


def blank(N: int) -> BoxMeasurement:
    zero, no = jnp.zeros(N), jnp.zeros(N, dtype=bool)
    return BoxMeasurement(
        tangent=jnp.zeros((2, N)),
        log_size=zero,
        log_aspect=zero,
        side_px=zero,
        present=no,
        expected=no,
        truncated=no,
        half_frame_tangent=jnp.full((2, N), 0.0875),
        attitude_variance_change=zero,
        interval=zero + 1.0,
    )


def records_of(world: World, box, gps, accepted, q_KN) -> TeamRecords:
    N = world.d.shape[1]
    return TeamRecords(
        orbit=world.orbit,
        gate=world.gate,
        accepted=accepted,
        box=box,
        gps=gps,
        q_KN=jnp.zeros((4, N)) if q_KN is None else q_KN,
        running=jnp.ones(N, dtype=bool),
    )


def step(case: Case, tuning, baseline: BaselineTuning, world: World, tick: Array):
    N = world.d.shape[1]
    keys = jax.random.split(jax.random.fold_in(world.key, tick), 16)
    normal = lambda k, shape: jax.random.normal(keys[k], shape)  # noqa: E731
    q_KN = jnp.stack([quaternion.from_matrix(look_at(world.d[:3, i])) for i in range(N)], axis=-1)
    white, misses = normal(0, (4, N)), jax.random.uniform(keys[1], (N,)) < 0.05
    boxes = []
    for i in range(N):
        template = jax.tree.map(lambda leaf, i=i: leaf[..., i], blank(N))
        view = box_view(template, jnp.asarray(FOCAL_PX), q_KN[:, i])
        model = linearise_box(tuning, view, world.d[:3, i], world.scale[0, i])
        noise = jnp.sqrt(model.variance) * white[:3, i]
        tangent = model.predicted[:2] + world.bias[:, i] + model.inverse_depth * world.center[:, i] + noise[:2]
        log_size = model.predicted[2] + jnp.sum(world.scale[:, i]) + noise[2]
        black = jnp.zeros((), dtype=bool)
        for who, begin, end in case.black:
            if who == i:
                black = (tick >= begin) & (tick < end)
        boxes.append(
            replaced(
                template,
                tangent=tangent,
                log_size=log_size,
                log_aspect=world.aspect[i] + 2.0 / (FOCAL_PX * jnp.exp(log_size)) * white[3, i],
                side_px=FOCAL_PX * jnp.exp(log_size),
                present=~misses[i] & ~black,
                expected=~black,
            )
        )
    box = jax.tree.map(lambda *leaves: jnp.stack(leaves, axis=-1), *boxes)
    common = 1.2 * normal(2, (3,))
    code = world.r_SN_N + common[:, None] + 2.0 * normal(3, (3, N))
    carrier = world.r_SN_N + common[:, None] + world.gps_error + case.baseline_noise / jnp.sqrt(2.0) * normal(4, (3, N))
    present = jnp.ones(N, dtype=bool)

    def navigate(orbit, gate, gps, q_KN, box):
        return combined_orbit_filter.update(tuning, True, jnp.asarray(FOCAL_PX), orbit, gate, gps, q_KN, box)

    orbit, gate, innovation = vmap_last(navigate, in_axes=-1, out_axes=-1)(
        world.orbit, world.gate, GpsMeasurement(position_N=code, present=present), q_KN, box
    )
    world = replaced(world, orbit=orbit, gate=gate)
    accepted = innovation.sensors["box"].accepted
    records = records_of(world, box, GpsMeasurement(position_N=carrier, present=present), accepted, q_KN)
    if case.link.ranging:
        records = replaced(records, ranges=ranges_of(case, baseline, world, normal(13, (N, N))))
    due = (tick - case.link.delay_ticks) % case.link.period_ticks == 0
    received = (jax.random.uniform(keys[5], (N, N)) >= case.loss) & due
    for begin, end in case.outages:
        received = received & ~((tick >= begin) & (tick < end))
    memory = world.memory
    link, many = link_of(case, baseline), servicers_tuning(tuning, N)
    if not case.alone:
        arrived = of_pairs(received, case.link.peers)
        records, memory = sharing.share(link, many, records, memory, arrived, tick.astype(float))
    orbit = records.orbit
    out = measure(world, orbit)
    # Burns of random direction, at another time for each servicer.
    burning = (tick + 37 * jnp.arange(N)) % case.burn_period < 5
    group = (tick + 37 * jnp.arange(N)) // case.burn_period
    planned = []
    errors = []
    for i in range(N):
        k = jax.random.fold_in(jax.random.fold_in(world.key, 7919 + i), group[i])
        v = jax.random.normal(k, (7,))
        planned.append(case.burn_m_s * v[:3])
        along = v[:3] / jnp.linalg.norm(v[:3])
        across = v[3:6] - along * jnp.sum(along * v[3:6])
        errors.append(
            case.burn_m_s
            * jnp.linalg.norm(v[:3])
            * (tuning.burn_magnitude_sigma * v[6] * along + tuning.burn_direction_sigma * across)
        )
    on = jnp.where(burning, 0.2, 0.0)[None, :]
    delta_v, error = on * jnp.stack(planned, axis=-1), on * jnp.stack(errors, axis=-1)
    size = jnp.linalg.norm(jnp.stack(planned, axis=-1), axis=0)

    def predict(orbit, delta_v, size):
        return combined_orbit_filter.predict(
            tuning, DEGREE, orbit, delta_v, size, jnp.ones(()), jnp.zeros(3), lasting_error_effects.none(), 1.0
        )

    def burn_covariance(delta_v, size):
        return burn_execution_error.burn_covariance(
            delta_v, size, burn_execution_error.new_sigma(tuning), tuning.burn_direction_sigma
        )

    after = vmap_last(predict, in_axes=-1, out_axes=-1)(orbit, delta_v, size)
    if not case.alone:
        covariance = vmap_last(burn_covariance, in_axes=-1, out_axes=-1)(delta_v, size)
        motion = motion_of(orbit.servicer.r_SN_N, after.servicer.r_SN_N, delta_v, covariance)
        memory = sharing.predict(link, many, memory, after.relative, motion)
    q = tuning.relative_acceleration_noise / jnp.sqrt(2.0)
    drift_T, drift = q * normal(6, (3,)), q * normal(7, (3, N))
    world = replaced(world, orbit=after, memory=memory)
    return advance(tuning, case, world, delta_v + error, drift_T, drift, keys), out


def motion_of(r_before, r_after, delta_v, covariance) -> TickMotion:
    """Motion of all servicers over a tick in which none reopens its estimate."""
    return TickMotion(
        r_before_N=r_before,
        r_after_N=r_after,
        delta_v_N=delta_v,
        burn_covariance=covariance,
        reopened=jnp.zeros(delta_v.shape[1], dtype=bool),
    )


def ranges_of(case: Case, baseline: BaselineTuning, world: World, normals: Array) -> Array:
    """Ranges (peers, N) over the links with the errors that the filters believe in."""
    errors = LinkRange(noise=baseline.range_noise, bias_sigma=baseline.range_bias_sigma)
    N = world.d.shape[1]
    biases = link_range.bias(errors, jax.random.normal(jax.random.fold_in(world.key, 4242), (N, N)))
    ranges = link_range.measure(errors, world.d[:3], biases, normals)
    return of_pairs(ranges, case.link.peers)


def advance(tuning, case: Case, world: World, delta_v, drift_T, drift, keys) -> World:
    N = world.d.shape[1]
    r, v = world.r_SN_N, world.v_SN_N
    g = lambda r: -MU * r / jnp.linalg.norm(r, axis=0)[None, :] ** 3  # noqa: E731
    a = g(r) + delta_v
    r_after = r + v + 0.5 * a
    v_after = v + 0.5 * (a + g(r_after) + delta_v) + drift
    motion = motion_of(r, r_after, delta_v, jnp.zeros((3, 3, N)))
    motions = [jax.tree.map(lambda leaf, i=i: leaf[..., i], motion) for i in range(N)]
    d = jnp.stack([baseline_motion.propagate(DEGREE, world.d[:, i], motions[i], 1.0) for i in range(N)], axis=-1)
    d = d + jnp.concatenate([jnp.zeros((3, N)), drift_T[:, None] - drift])

    def gm(x, sigma, tau, k):
        decay = jnp.exp(-1.0 / tau)
        return decay * x + sigma * jnp.sqrt(1.0 - decay**2) * jax.random.normal(keys[k], x.shape)

    center = jnp.sqrt(shape_errors.center_variance(tuning, jnp.zeros(()), world.d[:3, 0]))
    errors = [
        shape_errors.shape_errors(tuning, tuning.outline_time_constant, jnp.zeros(()), world.d[:3, i], world.d[3:, i])
        for i in range(N)
    ]
    walk = jnp.sqrt(errors[0].bearing_process_variance)
    return replaced(
        world,
        r_SN_N=r_after,
        v_SN_N=v_after,
        d=d,
        scale=gm(world.scale, tuning.scale_sigma[:, None], jnp.stack([of.scale_time_constant for of in errors], -1), 8),
        bias=world.bias + walk * jax.random.normal(keys[9], world.bias.shape),
        center=gm(world.center, center, tuning.center_time_constant, 10),
        aspect=gm(world.aspect, jnp.sqrt(0.2), tuning.outline_time_constant, 11),
        gps_error=gm(world.gps_error, case.baseline_error / jnp.sqrt(2.0), 700.0, 12),
    )


def measure(world: World, orbit: OrbitEstimate):
    """NEES, position and range errors of each servicer."""
    error = jnp.concatenate([orbit.relative.r_TS_N, orbit.relative.v_TS_N]) - world.d
    nees, position, along, sigma = [], [], [], []
    for i in range(world.d.shape[1]):
        P = orbit.relative.covariance[:6, :6, i]
        nees.append(squared_mahalanobis_and_log_determinant(P, error[:, i])[0])
        line = world.d[:3, i] / jnp.linalg.norm(world.d[:3, i])
        position.append(jnp.linalg.norm(error[:3, i]))
        along.append(jnp.sum(line * error[:3, i]))
        sigma.append(jnp.sqrt(jnp.sum(line * (P[:3, :3] @ line))))
    return {
        "nees": jnp.stack(nees),
        "position": jnp.stack(position),
        "range": jnp.stack(along),
        "range_sigma": jnp.stack(sigma),
    }


def simulate(case: Case, tuning, runs: int, seed: int = 0):
    """Records (runs, ticks, servicers) of a case."""
    baseline = BaselineTuning(
        noise=jnp.asarray(case.baseline_noise),
        error_sigma=jnp.asarray(case.baseline_error),
        error_time_constant=jnp.asarray(700.0),
        range_noise=jnp.asarray(0.1),
        range_bias_sigma=jnp.asarray(0.05),
    )

    def run(key):
        world = start(case, tuning, baseline, key)
        return jax.lax.scan(partial(step, case, tuning, baseline), world, jnp.arange(case.ticks))[1]

    return jax.jit(jax.vmap(run))(jax.random.split(jax.random.key(seed), runs))
