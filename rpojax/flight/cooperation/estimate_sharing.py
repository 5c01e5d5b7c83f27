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
from jaxtyping import Array, Float

from rpojax.core import kalman_update
from rpojax.core.filter_state_layout import MOTION
from rpojax.core.kalman_update import MeasurementRows
from rpojax.core.numerics import gradient_safe
from rpojax.core.pytree import pytree, replace
from rpojax.core.vectors import apply, product
from rpojax.flight.cooperation import baseline_motion, covariance_intersection, received_messages
from rpojax.flight.cooperation.baseline_motion import TickMotion, baseline_layout
from rpojax.flight.cooperation.covariance_intersection import SplitEstimate
from rpojax.flight.cooperation.message import TargetTrack
from rpojax.flight.cooperation.received_messages import ReceivedMessages
from rpojax.flight.cooperation.team_records import TeamRecords
from rpojax.flight.cooperation.team_settings import BaselineTuning, Link, ServicerTuning
from rpojax.flight.navigation import believed_sensor, orbit_covariance, relative_filter_state, relative_orbit_ekf
from rpojax.flight.navigation.orbit_covariance import OrbitStep
from rpojax.flight.navigation.orbit_filter_tuning import OrbitFilterTuning
from rpojax.flight.navigation.orbit_measurements import box_view
from rpojax.flight.navigation.relative_filter_state import RelativeEstimate

Matrix = Float[Array, "3 3"]


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
    link: Link,
    tuning: OrbitFilterTuning,
    peer_tuning: OrbitFilterTuning,
    own: RelativeEstimate,
    baselines: Float[Array, "peers 6"],
) -> EstimateSharing:
    """Memory at hand-over, with the first baselines [m, m/s]; the tuning of the peers has a leading axis."""
    baseline, has_ranges = link.baseline, link.settings.ranging
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
    if link.settings.sharing == "naive":
        return memory
    none = jnp.stack([jnp.eye(MOTION.size, dtype=dtype)] * count)
    tracks = Tracks(
        estimates=SplitEstimate(mean=jnp.zeros((count, MOTION.size), dtype=dtype), correlated=none, independent=none),
        of_own=none,
        known=jnp.zeros(count, dtype=bool),
    )
    # Only the mounting of the camera is its own.
    mounting = own.layout.vector(bearing_bias=jnp.diag(own.covariance)[own.layout["bearing_bias"]])
    correlated = own.covariance - jnp.diag(mounting)
    return replace(memory, local=own, correlated=correlated, tracks=tracks)


def target_track(estimate: RelativeEstimate, correlated: Float[Array, "n n"]) -> TargetTrack:
    """What a message tells of the target, with the part of the covariance that may be correlated with others'."""
    return TargetTrack(
        state=jnp.concatenate([estimate.r_TS_N, estimate.v_TS_N]),
        covariance=estimate.motion_covariance,
        correlated=replace(estimate, covariance=correlated).motion_covariance,
    )


def update(tuning: ServicerTuning, memory: EstimateSharing, records: TeamRecords) -> EstimateSharing:
    """Memory after the own box and sensors, before the messages of the tick."""
    local, correlated, box = memory.local, memory.correlated, records.gated_box
    assert local is not None
    assert correlated is not None
    view = box_view(box, tuning.focal_px, records.q_KN)
    rows, _ = relative_orbit_ekf.rows_of_box(tuning.filter, False, local, view)
    drift = local.layout.vector(bearing_bias=jnp.full(2, box.attitude_variance_change))
    recovered = records.gate.recovered
    inflation = relative_orbit_ekf.recovery_variance(tuning.filter, local.layout, local.r_TS_N, recovered)
    gains, P = kalman_update.reduced_by_rows(local.covariance + jnp.diag(drift), rows)
    correlated = kalman_update.part_after(correlated, rows, gains) + jnp.diag(inflation)
    local = relative_filter_state.corrected(local, gains.deviation, P + jnp.diag(inflation))
    if records.rows is not None:
        rows = believed_sensor.at_estimate(records.rows, local)
        gains, P = kalman_update.reduced_by_rows(local.covariance, rows)
        correlated = kalman_update.part_after(correlated, rows, gains)
        local = relative_filter_state.corrected(local, gains.deviation, P)
    return replace(memory, local=replace(local, outline=records.orbit.relative.outline), correlated=correlated)


def receive(
    baseline: BaselineTuning, memory: EstimateSharing, received: ReceivedMessages
) -> tuple[EstimateSharing, RelativeEstimate]:
    """Memory after the messages of a tick, and the fused estimate."""
    local, tracks = memory.local, memory.tracks
    assert local is not None
    assert tracks is not None
    baselines = _updated_baselines(baseline, memory.baselines, received)
    arrived = Tracks(
        estimates=_tracks(baselines, received),
        of_own=baselines.of_own[:, : MOTION.size, : MOTION.size],
        known=received.used,
    )
    tracks = replace(received_messages.select_peers(received.used, arrived, tracks), known=tracks.known | received.used)
    assert memory.correlated is not None
    independent = local.covariance - memory.correlated
    own = SplitEstimate(mean=local.vector, correlated=memory.correlated, independent=independent)
    mean, P = covariance_intersection.fuse(own, _others(tracks), tracks.known)
    return replace(memory, baselines=baselines, tracks=tracks), relative_filter_state.moved_to(local, mean, P)


def _others(tracks: Tracks) -> list[SplitEstimate]:
    """Estimates of the peers; this servicer's share of a baseline's error is in all other baselines."""
    others = []
    for k in range(tracks.known.shape[0]):
        track, of_own = jax.tree.map(lambda leaf, k=k: leaf[k], (tracks.estimates, tracks.of_own))
        if tracks.known.shape[0] == 1:
            others.append(replace(track, independent=track.independent + of_own))
        else:
            others.append(replace(track, correlated=track.correlated + of_own))
    return others


def receive_naively(
    baseline: BaselineTuning, memory: EstimateSharing, own: RelativeEstimate, received: ReceivedMessages
) -> tuple[EstimateSharing, RelativeEstimate]:
    """Memory and estimate after estimates of peers are taken as independent of the `own` one, which they are not."""
    baselines = _updated_baselines(baseline, memory.baselines, received)
    arrived = _tracks(baselines, received)
    mean, P = own.vector, own.covariance
    for k in range(received.used.shape[0]):
        total = arrived.correlated[k] + arrived.independent[k] + baselines.of_own[k, : MOTION.size, : MOTION.size]
        mean, P = covariance_intersection.independent_fusion(mean, P, arrived.mean[k], total, received.used[k])
    return replace(memory, baselines=baselines), relative_filter_state.moved_to(own, mean, P)


def _updated_baselines(baseline: BaselineTuning, baselines: Baselines, received: ReceivedMessages) -> Baselines:
    """Baselines after burns of the peers, differences of GPS positions and ranges over the links."""
    updated = []
    for k in range(received.used.shape[0]):
        before = jax.tree.map(lambda leaf, k=k: leaf[k], baselines)
        updated.append(_updated_baseline(baseline, before, received_messages.of_peer(received, k)))
    return jax.tree.map(lambda *leaves: jnp.stack(leaves), *updated)


def _updated_baseline(baseline: BaselineTuning, before: Baselines, received: ReceivedMessages) -> Baselines:
    """Baseline to one peer by what is received of it; half of the noise of a difference is the own receiver's."""
    used, layout = received.used, baseline_layout(received.ranges is not None)
    decay = jnp.exp(-received.interval / baseline.error_time_constant)
    factors = jnp.ones(layout.size, dtype=decay.dtype).at[layout["gps_difference"]].set(decay)
    slow = jnp.diag(layout.vector(gps_difference=jnp.full(3, baseline.error_sigma**2 * (1.0 - decay**2))))
    rest = (0, layout.size - MOTION.size)
    x = factors * before.mean + jnp.pad(jnp.where(used, received.burns.change, 0.0), rest)
    both = factors[:, None] * factors[None, :]
    burns = jnp.pad(jnp.where(used, received.burns.covariance, 0.0), (rest, rest))
    rows, of_receiver = _baseline_rows(baseline, x, before.covariance * both + burns + slow, received)
    gains, covariance = kalman_update.reduced_by_rows(before.covariance * both + burns + slow, rows)
    of_own = kalman_update.part_after(before.of_own * both + 0.5 * slow, rows, gains, of_receiver)
    return Baselines(mean=x + gains.deviation, covariance=covariance, of_own=of_own)


def _baseline_rows(
    baseline: BaselineTuning, x: Float[Array, " n"], P: Float[Array, "n n"], received: ReceivedMessages
) -> tuple[MeasurementRows, Float[Array, " m"]]:
    """Difference of GPS positions, and range if there is one; and the variance that the own receiver adds to each."""
    layout, to_stamp = baseline_layout(received.ranges is not None), received.own.to_stamp
    then = jnp.eye(3, MOTION.size, dtype=x.dtype) if to_stamp is None else to_stamp[MOTION["position"]]
    part = layout.split(x)
    motion = jnp.concatenate([part["position"], part["velocity"]])
    position, same = apply(then, motion + received.own.burns), jnp.eye(3, dtype=x.dtype)
    by_position, by_velocity = then[:, MOTION["position"]], then[:, MOTION["velocity"]]
    residual = received.baseline - position - part["gps_difference"]
    jacobian = layout.rows(position=by_position, velocity=by_velocity, gps_difference=same)
    variance = jnp.full(3, baseline.noise**2)
    weight = jnp.full(3, jnp.where(received.measured, 1.0, 0.0)).astype(x.dtype)
    of_receiver = 0.5 * variance
    if received.ranges is not None:
        distance = gradient_safe.norm(position)
        u = position / distance
        at_stamp = product(then, product(then, P[: MOTION.size, : MOTION.size]).T)
        across = jnp.trace(at_stamp) - jnp.sum(u * apply(at_stamp, u), axis=0)
        # Of second order, as in the joint filter.
        excess = jnp.maximum(across, 0.0) / distance
        residual = jnp.concatenate(
            [residual, (received.ranges - distance - 0.5 * excess - part["range_bias"][0])[None]]
        )
        of_range = layout.rows(
            position=product(u[None], by_position),
            velocity=product(u[None], by_velocity),
            range_bias=jnp.ones((1, 1), dtype=x.dtype),
        )
        jacobian = jnp.concatenate([jacobian, of_range], axis=0)
        variance = jnp.concatenate([variance, (baseline.range_noise**2 + 0.5 * excess**2)[None]])
        weight = jnp.concatenate([weight, jnp.where(received.used, 1.0, 0.0)[None].astype(x.dtype)])
        of_receiver = jnp.pad(of_receiver, (0, 1))
    rows = MeasurementRows(residual=residual, jacobian=jacobian, variance=variance, weight=weight)
    return rows, of_receiver


def _tracks(baselines: Baselines, received: ReceivedMessages) -> SplitEstimate:
    """Estimates of the peers in the messages, moved to now and to this servicer, (peers, ...)."""
    track, to_now = received.messages.track, received.own.to_now
    assert track is not None
    sent = SplitEstimate(mean=track.state, correlated=track.correlated, independent=track.covariance - track.correlated)
    now = sent if to_now is None else _moved(sent, to_now)
    of_peer = (baselines.covariance - baselines.of_own)[:, : MOTION.size, : MOTION.size]
    return replace(now, mean=now.mean + baselines.mean[:, : MOTION.size], independent=now.independent + of_peer)


def _moved(estimates: SplitEstimate, to_now: Float[Array, "6 6"]) -> SplitEstimate:
    """Estimates of position and velocity, (peers, ...), after free motion with that transition."""

    def moved(P: Array) -> Array:
        half = product(to_now, product(to_now, P).T)
        return 0.5 * (half + half.T)

    peers = range(estimates.mean.shape[0])
    return SplitEstimate(
        mean=jnp.stack([apply(to_now, estimates.mean[k]) for k in peers]),
        correlated=jnp.stack([moved(estimates.correlated[k]) for k in peers]),
        independent=jnp.stack([moved(estimates.independent[k]) for k in peers]),
    )


def predict(link: Link, tuning: OrbitFilterTuning, memory: EstimateSharing, motion: TickMotion) -> EstimateSharing:
    """Memory after the motion of a tick."""
    dt, burn_covariance = link.tick_s, motion.burn_covariance
    step = OrbitStep(dt=dt, r_SN_N=motion.r_before_N, velocity_covariance=burn_covariance)
    unmodelled = tuning.relative_acceleration_noise**2 * dt * jnp.eye(3, dtype=burn_covariance.dtype)
    noise = burn_covariance + unmodelled

    def moved(state: Float[Array, "6"]) -> Float[Array, "6"]:
        return baseline_motion.propagate(link.settings.zonal_degree, state, motion, dt)

    def grown(P: Array, process: Matrix) -> Array:
        slow = P.shape[0] - MOTION.size
        kept, zero = jnp.ones(slow, dtype=P.dtype), jnp.zeros(slow, dtype=P.dtype)
        return orbit_covariance.propagate(P, replace(step, velocity_covariance=process), kept, zero)

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
    before = memory.tracks.estimates
    zero = jnp.zeros_like(noise)
    estimates = SplitEstimate(
        mean=jnp.stack([moved(before.mean[k]) for k in range(count)]),
        correlated=jnp.stack([grown(before.correlated[k], unmodelled) for k in range(count)]),
        independent=jnp.stack([grown(before.independent[k], zero) for k in range(count)]),
    )
    of_own = jnp.stack([grown(memory.tracks.of_own[k], burn_covariance) for k in range(count)])
    state = MOTION.split(moved(MOTION.vector(position=memory.local.r_TS_N, velocity=memory.local.v_TS_N)))
    target = replace(memory.local, r_TS_N=state["position"], v_TS_N=state["velocity"])
    local = relative_orbit_ekf.predict(tuning, relative_filter_state.reopen(target, motion.reopened), step)
    correlated = relative_filter_state.reopen(replace(target, covariance=memory.correlated), motion.reopened)
    correlated = relative_orbit_ekf.predict(tuning, correlated, replace(step, velocity_covariance=zero))
    tracks = replace(memory.tracks, estimates=estimates, of_own=of_own)
    return replace(memory, local=local, correlated=correlated.covariance, tracks=tracks)
