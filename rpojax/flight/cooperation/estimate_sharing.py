"""Sharing of estimates: each servicer fuses its own estimate of the target with the latest one of each peer.

What is sent comes from the sender's own boxes alone, and what was fused is never sent or filtered again. So the errors
that come from the noise of its boxes, the mounting of its camera and its own burns are independent of those of other
servicers. What is left may be correlated in any way: the hand-over, and whatever comes from the one target, its
accelerations and its shape. The covariance of every estimate is kept in these two parts, and estimates are fused by
split covariance intersection. The errors of the baseline come from GPS, and are independent of both estimates, but
those of two baselines have the own receiver in common. The control that fuses estimates as if they were independent,
and sends on what it has fused, is `receive_naively`.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from rpojax.core import kalman_update
from rpojax.core.kalman_update import MeasurementRows
from rpojax.core.numerics import gradient_safe
from rpojax.core.orbits import two_body_gravity
from rpojax.core.pytree import pytree, replace
from rpojax.core.state_layout import MOTION
from rpojax.core.vectors import product
from rpojax.flight.cooperation import baseline_motion, covariance_intersection, free_relative_motion, peer_news
from rpojax.flight.cooperation.baseline_motion import baseline_layout
from rpojax.flight.cooperation.covariance_intersection import SplitEstimate
from rpojax.flight.cooperation.free_relative_motion import apply
from rpojax.flight.cooperation.link_settings import BaselineTuning
from rpojax.flight.cooperation.message import TargetTrack
from rpojax.flight.cooperation.peer_news import News
from rpojax.flight.navigation import believed_sensor, orbit_covariance, relative_orbit_ekf, relative_state
from rpojax.flight.navigation.combined_orbit_filter import OrbitEstimate
from rpojax.flight.navigation.orbit_covariance import OrbitStep
from rpojax.flight.navigation.orbit_filter_tuning import OrbitFilterTuning
from rpojax.flight.navigation.orbit_measurements import BoxMeasurement, box_view
from rpojax.flight.navigation.relative_state import RelativeEstimate

Flag = Bool[Array, ""]
Matrix = Float[Array, "3 3"]
Scalar = Float[Array, ""]
Vector = Float[Array, "3"]


@pytree
class Baselines:
    """Positions of the peers from this servicer, by GPS alone.

    Attributes:
        mean: (peers, n) in the order of `baseline_layout`
        covariance: (peers, n, n)
        of_own: (peers, n, n) part of it that comes from this servicer, and is in all its baselines
    """

    mean: Array
    covariance: Array
    of_own: Array


@pytree
class Tracks:
    """Latest estimates of the peers, as the target from this servicer.

    Attributes:
        estimates: (peers, 6) means, with the parts of their covariances, the peers' share of the baselines among them
        of_own: (peers, 6, 6) covariance that this servicer's share of the baselines adds
        known: (peers,) bool, there is one
    """

    estimates: SplitEstimate
    of_own: Array
    known: Array


@pytree
class EstimateSharing:
    """Memory of one servicer.

    Attributes:
        baselines: to its peers
        local: estimate by its own boxes alone, None if fused estimates are filtered on
        correlated: (n, n) part of its covariance that may be correlated with others' estimates, None likewise
        tracks: of its peers, None likewise
    """

    baselines: Baselines
    local: RelativeEstimate | None = None
    correlated: Array | None = None
    tracks: Tracks | None = None


def initial(
    tuning: OrbitFilterTuning,
    baseline: BaselineTuning,
    own: RelativeEstimate,
    baselines: Float[Array, "peers 6"],
    peer_tuning: OrbitFilterTuning,
    naive: bool,
    has_ranges: bool,
) -> EstimateSharing:
    """Memory at hand-over, with the first baselines [m, m/s]; the tuning of the peers has a leading axis."""
    count, dtype = baselines.shape[0], baselines.dtype
    covariances = []
    bias = jnp.full(int(has_ranges), baseline.range_bias_sigma**2)
    slow_size = baseline_layout(has_ranges).size - MOTION.size
    for k in range(count):
        motion = baseline_motion.initial_variance(tuning, jax.tree.map(lambda leaf, k=k: leaf[k], peer_tuning))
        covariances.append(jnp.diag(jnp.concatenate([motion, jnp.full(3, baseline.error_sigma**2), bias])))
    mean = jnp.concatenate([baselines, jnp.zeros((count, slow_size), dtype=dtype)], axis=1)
    slow = jnp.full(3, 0.5 * baseline.error_sigma**2)
    of_own = jnp.diag(jnp.concatenate([0.5 * baseline_motion.initial_variance(tuning, tuning), slow, 0.0 * bias]))
    baseline_memory = Baselines(mean=mean, covariance=jnp.stack(covariances), of_own=jnp.stack([of_own] * count))
    memory = EstimateSharing(baselines=baseline_memory)
    if naive:
        return memory
    none = jnp.stack([jnp.eye(MOTION.size, dtype=dtype)] * count)
    tracks = Tracks(
        estimates=SplitEstimate(mean=jnp.zeros((count, MOTION.size), dtype=dtype), correlated=none, independent=none),
        of_own=none,
        known=jnp.zeros(count, dtype=bool),
    )
    # Only the mounting of the camera is its own.
    mounting = own.layout.vector(bearing_bias=jnp.full(2, tuning.bearing_bias_sigma**2))
    correlated = own.covariance - jnp.diag(mounting)
    return replace(memory, local=own, correlated=correlated, tracks=tracks)


def target_track(estimate: RelativeEstimate, correlated: Float[Array, "n n"]) -> TargetTrack:
    """What a message tells of the target, with the part of the covariance that may be correlated with others'."""
    return TargetTrack(
        state=jnp.concatenate([estimate.r_TS_N, estimate.v_TS_N]),
        covariance=estimate.motion_covariance,
        correlated=replace(estimate, covariance=correlated).motion_covariance,
    )


def update(
    tuning: OrbitFilterTuning,
    focal_px: Scalar,
    memory: EstimateSharing,
    orbit: OrbitEstimate,
    q_KN: Float[Array, "4"],
    box: BoxMeasurement,
    recovered: Flag,
    sensor_rows: MeasurementRows | None = None,
) -> EstimateSharing:
    """Memory after the own box and sensors, before the messages of the tick.

    The box is present if it passed the gate; `sensor_rows` are as of a state of zero, None without such sensors.
    """
    local, correlated = memory.local, memory.correlated
    assert local is not None
    assert correlated is not None
    rows, _ = relative_orbit_ekf.rows_of_box(tuning, False, local, box_view(box, focal_px, q_KN))
    drift = local.layout.vector(bearing_bias=jnp.full(2, box.attitude_variance_change))
    inflation = relative_orbit_ekf.recovery_variance(tuning, local.layout, local.r_TS_N, recovered)
    gains, P = kalman_update.reduced_by_rows(local.covariance + jnp.diag(drift), rows)
    correlated = kalman_update.part_after(correlated, rows, gains) + jnp.diag(inflation)
    local = relative_state.corrected(local, gains.deviation, P + jnp.diag(inflation))
    if sensor_rows is not None:
        rows = believed_sensor.at_estimate(sensor_rows, local)
        gains, P = kalman_update.reduced_by_rows(local.covariance, rows)
        correlated = kalman_update.part_after(correlated, rows, gains)
        local = relative_state.corrected(local, gains.deviation, P)
    return replace(memory, local=replace(local, outline=orbit.relative.outline), correlated=correlated)


def receive(
    baseline: BaselineTuning, memory: EstimateSharing, orbit: OrbitEstimate, news: News, delay: float
) -> tuple[EstimateSharing, RelativeEstimate]:
    """Memory after the messages of a tick, which are `delay` [s] old, and the fused estimate."""
    local, tracks = memory.local, memory.tracks
    assert local is not None
    assert tracks is not None
    baselines = _updated_baselines(baseline, memory.baselines, orbit, news, delay)
    arrived = Tracks(
        estimates=_tracks(baselines, orbit, news, delay),
        of_own=baselines.of_own[:, : MOTION.size, : MOTION.size],
        known=news.used,
    )
    tracks = replace(peer_news.select_peers(news.used, arrived, tracks), known=tracks.known | news.used)
    assert memory.correlated is not None
    independent = local.covariance - memory.correlated
    own = SplitEstimate(mean=local.vector, correlated=memory.correlated, independent=independent)
    mean, P = covariance_intersection.fuse(own, _others(tracks), tracks.known)
    return replace(memory, baselines=baselines, tracks=tracks), relative_state.moved_to(local, mean, P)


def _others(tracks: Tracks) -> list[SplitEstimate]:
    """Estimates of the peers; this servicer's share of a baseline's error is in all other baselines."""
    each = []
    for k in range(tracks.known.shape[0]):
        track, of_own = jax.tree.map(lambda leaf, k=k: leaf[k], (tracks.estimates, tracks.of_own))
        if tracks.known.shape[0] == 1:
            each.append(replace(track, independent=track.independent + of_own))
        else:
            each.append(replace(track, correlated=track.correlated + of_own))
    return each


def receive_naively(
    baseline: BaselineTuning, memory: EstimateSharing, orbit: OrbitEstimate, news: News, delay: float
) -> tuple[EstimateSharing, RelativeEstimate]:
    """Memory and estimate after estimates of peers are taken as independent of the own one, which they are not."""
    baselines = _updated_baselines(baseline, memory.baselines, orbit, news, delay)
    arrived = _tracks(baselines, orbit, news, delay)
    mean, P = orbit.relative.vector, orbit.relative.covariance
    for k in range(news.used.shape[0]):
        total = arrived.correlated[k] + arrived.independent[k] + baselines.of_own[k, : MOTION.size, : MOTION.size]
        mean, P = covariance_intersection.independent_fusion(mean, P, arrived.mean[k], total, news.used[k])
    return replace(memory, baselines=baselines), relative_state.moved_to(orbit.relative, mean, P)


def _updated_baselines(
    baseline: BaselineTuning, baselines: Baselines, orbit: OrbitEstimate, news: News, delay: float
) -> Baselines:
    """Baselines after burns of the peers, differences of GPS positions and ranges over the links."""
    back = free_relative_motion.transition_matrix(two_body_gravity.gravity_gradient(orbit.servicer.r_SN_N), -delay)
    updated = []
    for k in range(news.used.shape[0]):
        before, of_peer = jax.tree.map(lambda leaf, k=k: leaf[k], (baselines, replace(news, own_burns=news.used)))
        updated.append(_updated_baseline(baseline, before, replace(of_peer, own_burns=news.own_burns), back))
    return jax.tree.map(lambda *leaves: jnp.stack(leaves), *updated)


def _updated_baseline(baseline: BaselineTuning, before: Baselines, news: News, back: Float[Array, "6 6"]) -> Baselines:
    """Baseline to one peer, with the news of that peer; half of the noise of a difference is the own receiver's."""
    used, layout = news.used, baseline_layout(news.ranges is not None)
    decay = jnp.exp(-news.interval / baseline.error_time_constant)
    factors = jnp.ones(layout.size, dtype=decay.dtype).at[layout["gps_difference"]].set(decay)
    slow = jnp.diag(layout.vector(gps_difference=jnp.full(3, baseline.error_sigma**2 * (1.0 - decay**2))))
    rest = (0, layout.size - MOTION.size)
    x = factors * before.mean + jnp.pad(jnp.where(used, news.burns.change, 0.0), rest)
    both = factors[:, None] * factors[None, :]
    burns = jnp.pad(jnp.where(used, news.burns.covariance, 0.0), (rest, rest))
    rows, of_receiver = _baseline_rows(baseline, x, before.covariance * both + burns + slow, news, back)
    gains, covariance = kalman_update.reduced_by_rows(before.covariance * both + burns + slow, rows)
    of_own = kalman_update.part_after(before.of_own * both + 0.5 * slow, rows, gains, of_receiver)
    return Baselines(mean=x + gains.deviation, covariance=covariance, of_own=of_own)


def _baseline_rows(
    baseline: BaselineTuning, x: Float[Array, " n"], P: Float[Array, "n n"], news: News, back: Float[Array, "6 6"]
) -> tuple[MeasurementRows, Float[Array, " m"]]:
    """Difference of GPS positions, and range if there is one; and the variance that the own receiver adds to each."""
    layout, then = baseline_layout(news.ranges is not None), back[MOTION["position"]]
    part = layout.split(x)
    motion = jnp.concatenate([part["position"], part["velocity"]])
    position, same = apply(then, motion + news.own_burns), jnp.eye(3, dtype=x.dtype)
    by_position, by_velocity = then[:, MOTION["position"]], then[:, MOTION["velocity"]]
    residual = news.baseline - position - part["gps_difference"]
    jacobian = layout.rows(position=by_position, velocity=by_velocity, gps_difference=same)
    variance = jnp.full(3, baseline.noise**2)
    weight = jnp.full(3, jnp.where(news.measured, 1.0, 0.0)).astype(x.dtype)
    of_receiver = 0.5 * variance
    if news.ranges is not None:
        distance = gradient_safe.norm(position)
        u = position / distance
        at_stamp = product(then, product(then, P[: MOTION.size, : MOTION.size]).T)
        across = jnp.trace(at_stamp) - jnp.sum(u * apply(at_stamp, u), axis=0)
        # Of second order, as in the joint filter.
        excess = jnp.maximum(across, 0.0) / distance
        residual = jnp.concatenate([residual, (news.ranges - distance - 0.5 * excess - part["range_bias"][0])[None]])
        of_range = layout.rows(
            position=product(u[None], by_position),
            velocity=product(u[None], by_velocity),
            range_bias=jnp.ones((1, 1), dtype=x.dtype),
        )
        jacobian = jnp.concatenate([jacobian, of_range], axis=0)
        variance = jnp.concatenate([variance, (baseline.range_noise**2 + 0.5 * excess**2)[None]])
        weight = jnp.concatenate([weight, jnp.where(news.used, 1.0, 0.0)[None].astype(x.dtype)])
        of_receiver = jnp.pad(of_receiver, (0, 1))
    rows = MeasurementRows(residual=residual, jacobian=jacobian, variance=variance, weight=weight)
    return rows, of_receiver


def _tracks(baselines: Baselines, orbit: OrbitEstimate, news: News, delay: float) -> SplitEstimate:
    """Estimates of the peers in the messages, moved to now and to this servicer, (peers, ...)."""
    track = news.messages.track
    assert track is not None
    sent = SplitEstimate(mean=track.state, correlated=track.correlated, independent=track.covariance - track.correlated)
    now = _moved(sent, orbit, delay) if delay > 0.0 else sent
    of_peer = (baselines.covariance - baselines.of_own)[:, : MOTION.size, : MOTION.size]
    return replace(now, mean=now.mean + baselines.mean[:, : MOTION.size], independent=now.independent + of_peer)


def _moved(estimates: SplitEstimate, orbit: OrbitEstimate, delay: float) -> SplitEstimate:
    """Estimates of position and velocity, (peers, ...), after `delay` [s] of free motion."""
    forth = free_relative_motion.transition_matrix(two_body_gravity.gravity_gradient(orbit.servicer.r_SN_N), delay)

    def moved(P: Array) -> Array:
        half = product(forth, product(forth, P).T)
        return 0.5 * (half + half.T)

    peers = range(estimates.mean.shape[0])
    return SplitEstimate(
        mean=jnp.stack([apply(forth, estimates.mean[k]) for k in peers]),
        correlated=jnp.stack([moved(estimates.correlated[k]) for k in peers]),
        independent=jnp.stack([moved(estimates.independent[k]) for k in peers]),
    )


def predict(
    tuning: OrbitFilterTuning,
    zonal_degree: int,
    memory: EstimateSharing,
    before: OrbitEstimate,
    after: OrbitEstimate,
    delta_v_N: Vector,
    burn_covariance: Matrix,
    reopened: Flag,
    dt: float,
) -> EstimateSharing:
    """Memory `dt` [s] later; the arguments are those of `box_sharing.predict`."""
    r_before_N, r_after_N = before.servicer.r_SN_N, after.servicer.r_SN_N
    step = OrbitStep(dt=dt, r_SN_N=r_before_N, velocity_covariance=burn_covariance)
    unmodelled = tuning.relative_acceleration_noise**2 * dt * jnp.eye(3, dtype=burn_covariance.dtype)
    noise = burn_covariance + unmodelled

    def moved(state: Float[Array, "6"]) -> Float[Array, "6"]:
        return baseline_motion.propagate(zonal_degree, state, r_before_N, r_after_N, delta_v_N, dt)

    def grown(P: Array, process: Matrix) -> Array:
        slow = P.shape[0] - MOTION.size
        one, zero = jnp.ones(slow, dtype=P.dtype), jnp.zeros(slow, dtype=P.dtype)
        return orbit_covariance.propagate(P, replace(step, velocity_covariance=process), one, zero)

    count = memory.baselines.mean.shape[0]
    mean = [
        jnp.concatenate([moved(row[: MOTION.size]), row[MOTION.size :]])
        for row in (memory.baselines.mean[k] for k in range(count))
    ]
    covariance = [grown(memory.baselines.covariance[k], noise) for k in range(count)]
    of_own = [grown(memory.baselines.of_own[k], burn_covariance + 0.5 * unmodelled) for k in range(count)]
    baselines = Baselines(mean=jnp.stack(mean), covariance=jnp.stack(covariance), of_own=jnp.stack(of_own))
    memory = replace(memory, baselines=baselines)
    if memory.local is None or memory.tracks is None:
        return memory
    assert memory.correlated is not None
    found = memory.tracks.estimates
    zero = jnp.zeros_like(noise)
    estimates = SplitEstimate(
        mean=jnp.stack([moved(found.mean[k]) for k in range(count)]),
        correlated=jnp.stack([grown(found.correlated[k], unmodelled) for k in range(count)]),
        independent=jnp.stack([grown(found.independent[k], zero) for k in range(count)]),
    )
    of_own = jnp.stack([grown(memory.tracks.of_own[k], burn_covariance) for k in range(count)])
    motion = MOTION.split(moved(MOTION.vector(position=memory.local.r_TS_N, velocity=memory.local.v_TS_N)))
    target = replace(memory.local, r_TS_N=motion["position"], v_TS_N=motion["velocity"])
    local = relative_orbit_ekf.predict(tuning, relative_state.reopen(target, reopened), step)
    correlated = relative_state.reopen(replace(target, covariance=memory.correlated), reopened)
    correlated = relative_orbit_ekf.predict(tuning, correlated, replace(step, velocity_covariance=zero))
    tracks = replace(memory.tracks, estimates=estimates, of_own=of_own)
    return replace(memory, local=local, correlated=correlated.covariance, tracks=tracks)
