"""Sharing of estimates: each servicer fuses its own estimate of the target with the latest one of each peer.

What is sent comes from the sender's own boxes alone, and what was fused is never sent or filtered again. The errors of
two such estimates are nearly independent, but not quite (one target, whose accelerations and shape are the same for
all), so that they are fused by covariance intersection. The errors of the baseline between them come from GPS, and
are independent of both. The control that fuses them as if they were independent, and sends on what it has fused, is
`update_naively`.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from rpojax.core import kalman_update
from rpojax.core.kalman_update import MeasurementRows
from rpojax.core.orbits import two_body_gravity
from rpojax.core.pytree import pytree, replace
from rpojax.flight.cooperation import baseline_motion, covariance_intersection, free_relative_motion, peer_news
from rpojax.flight.cooperation.covariance_intersection import SplitEstimate
from rpojax.flight.cooperation.free_relative_motion import apply, product
from rpojax.flight.cooperation.link_settings import BaselineTuning
from rpojax.flight.cooperation.message import TargetTrack
from rpojax.flight.cooperation.peer_news import News
from rpojax.flight.navigation import orbit_covariance, relative_orbit_ekf
from rpojax.flight.navigation.combined_orbit_filter import OrbitEstimate
from rpojax.flight.navigation.orbit_filter_tuning import OrbitFilterTuning
from rpojax.flight.navigation.orbit_measurements import BoxMeasurement
from rpojax.flight.navigation.relative_orbit_ekf import RelativeEstimate

Flag = Bool[Array, ""]
Matrix = Float[Array, "3 3"]
Scalar = Float[Array, ""]
Vector = Float[Array, "3"]


_WIDENED = 1.5
"""Growth of the variance by which one sees that guidance widened it after a search: twice."""


@pytree
class Baselines:
    """Positions of the peers from this servicer, by GPS alone.

    Attributes:
        mean: (peers, 9) position [m] and velocity [m/s] in N, slow error of the difference of GPS positions [m]
        covariance: (peers, 9, 9)
    """

    mean: Array
    covariance: Array


@pytree
class Tracks:
    """Latest estimates of the peers, as the target from this servicer.

    Attributes:
        estimates: (peers, 6) means, with covariances of the peers' estimates and of the baselines
        known: (peers,) bool, there is one
    """

    estimates: SplitEstimate
    known: Array


@pytree
class EstimateSharing:
    """Memory of one servicer.

    Attributes:
        baselines: to its peers
        local: estimate by its own boxes alone, None if fused estimates are filtered on
        tracks: of its peers, None likewise
        fused_variance: () of the fused position, sum of the axes [m^2], None likewise
    """

    baselines: Baselines
    local: RelativeEstimate | None = None
    tracks: Tracks | None = None
    fused_variance: Array | None = None


def initial(
    tuning: OrbitFilterTuning,
    baseline: BaselineTuning,
    own: RelativeEstimate,
    baselines: Float[Array, "peers 6"],
    peer_tuning: OrbitFilterTuning,
    naive: bool,
) -> EstimateSharing:
    """Memory at hand-over, with the first baselines [m, m/s]; the tuning of the peers has a leading axis."""
    count, dtype = baselines.shape[0], baselines.dtype
    covariances = []
    for k in range(count):
        motion = baseline_motion.initial_variance(tuning, jax.tree.map(lambda leaf, k=k: leaf[k], peer_tuning))
        covariances.append(jnp.diag(jnp.concatenate([motion, jnp.full(3, baseline.error_sigma**2)])))
    mean = jnp.concatenate([baselines, jnp.zeros((count, 3), dtype=dtype)], axis=1)
    memory = EstimateSharing(baselines=Baselines(mean=mean, covariance=jnp.stack(covariances)))
    if naive:
        return memory
    none = jnp.stack([jnp.eye(6, dtype=dtype)] * count)
    tracks = Tracks(
        estimates=SplitEstimate(mean=jnp.zeros((count, 6), dtype=dtype), correlated=none, independent=none),
        known=jnp.zeros(count, dtype=bool),
    )
    return replace(memory, local=own, tracks=tracks, fused_variance=_position_variance(own.covariance))


def target_track(estimate: RelativeEstimate) -> TargetTrack:
    """What a message tells of the target."""
    return TargetTrack(
        state=jnp.concatenate([estimate.r_TS_N, estimate.v_TS_N]), covariance=estimate.covariance[:6, :6]
    )


def update(
    tuning: OrbitFilterTuning,
    focal_px: Scalar,
    memory: EstimateSharing,
    orbit: OrbitEstimate,
    q_KN: Float[Array, "4"],
    box: BoxMeasurement,
    recovered: Flag,
) -> EstimateSharing:
    """Memory after the own box, present if it passed the gate, before the messages of the tick."""
    local = memory.local
    assert local is not None
    rows, _ = relative_orbit_ekf.rows_of_box(tuning, False, focal_px, local, q_KN, box)
    drift = jnp.pad(jnp.full(2, box.attitude_variance_change), (8, 2))
    result = kalman_update.update(
        local.covariance,
        rows,
        process_variance=drift,
        inflation_variance=relative_orbit_ekf.recovery_variance(tuning, local.r_TS_N, recovered),
    )
    return replace(memory, local=relative_orbit_ekf.corrected(local, result, orbit.relative.outline))


def receive(
    baseline: BaselineTuning, memory: EstimateSharing, orbit: OrbitEstimate, news: News, delay: float
) -> tuple[EstimateSharing, RelativeEstimate]:
    """Memory after the messages of a tick, which are `delay` [s] old, and the fused estimate."""
    local, tracks = memory.local, memory.tracks
    assert local is not None
    assert tracks is not None
    baselines = _updated_baselines(baseline, memory.baselines, orbit, news, delay)
    arrived = _tracks(baselines, orbit, news, delay)
    estimates = peer_news.select_peers(news.used, arrived, tracks.estimates)
    tracks = Tracks(estimates=estimates, known=tracks.known | news.used)
    mean, P = _state(local), local.covariance
    for k in range(tracks.known.shape[0]):
        other = jax.tree.map(lambda leaf, k=k: leaf[k], tracks.estimates)
        total = other.correlated + other.independent
        weight = covariance_intersection.best_weight(P[:3, :3], total[:3, :3])
        own = SplitEstimate(mean=mean, correlated=P, independent=jnp.zeros_like(P))
        mean, P = covariance_intersection.fuse(own, other, tracks.known[k], weight)
    memory = replace(memory, baselines=baselines, tracks=tracks, fused_variance=_position_variance(P))
    return memory, _estimate(local, mean, P)


def receive_naively(
    baseline: BaselineTuning, memory: EstimateSharing, orbit: OrbitEstimate, news: News, delay: float
) -> tuple[EstimateSharing, RelativeEstimate]:
    """Memory and estimate after estimates of peers are taken as independent of the own one, which they are not."""
    baselines = _updated_baselines(baseline, memory.baselines, orbit, news, delay)
    arrived = _tracks(baselines, orbit, news, delay)
    mean, P = _state(orbit.relative), orbit.relative.covariance
    for k in range(news.used.shape[0]):
        total = arrived.correlated[k] + arrived.independent[k]
        mean, P = covariance_intersection.independent_fusion(mean, P, arrived.mean[k], total, news.used[k])
    return replace(memory, baselines=baselines), _estimate(orbit.relative, mean, P)


def _position_variance(P: Float[Array, "12 12"]) -> Scalar:
    return P[0, 0] + P[1, 1] + P[2, 2]


def _state(estimate: RelativeEstimate) -> Float[Array, "12"]:
    return jnp.concatenate(
        [estimate.r_TS_N, estimate.v_TS_N, estimate.scale, estimate.bearing_bias, estimate.center_offset]
    )


def _estimate(before: RelativeEstimate, state: Float[Array, "12"], covariance: Array) -> RelativeEstimate:
    return replace(
        before,
        r_TS_N=state[:3],
        v_TS_N=state[3:6],
        scale=state[6:8],
        bearing_bias=state[8:10],
        center_offset=state[10:],
        covariance=covariance,
    )


def _updated_baselines(
    baseline: BaselineTuning, baselines: Baselines, orbit: OrbitEstimate, news: News, delay: float
) -> Baselines:
    """Baselines after burns of the peers and differences of GPS positions."""
    back = free_relative_motion.transition_matrix(two_body_gravity.gravity_gradient(orbit.servicer.r_SN_N), -delay)
    means, covariances = [], []
    for k in range(news.used.shape[0]):
        x, P, used = baselines.mean[k], baselines.covariance[k], news.used[k]
        decay = jnp.exp(-news.interval[k] / baseline.error_time_constant)
        factors = jnp.concatenate([jnp.ones(6, dtype=x.dtype), jnp.full(3, decay)])
        added = jnp.pad(jnp.where(used, news.burns.covariance[k], 0.0), ((0, 3), (0, 3)))
        slow = jnp.full(3, baseline.error_sigma**2 * (1.0 - decay**2))
        x = factors * x + jnp.pad(jnp.where(used, news.burns.change[k], 0.0), (0, 3))
        P = P * factors[:, None] * factors[None, :] + added + jnp.diag(jnp.pad(slow, (6, 0)))
        same = jnp.eye(3, dtype=x.dtype)
        rows = MeasurementRows(
            residual=news.baseline[k] - apply(back[:3], x[:6] + news.own_burns) - x[6:],
            jacobian=jnp.concatenate([back[:3], same], axis=1),
            variance=jnp.full(3, baseline.noise**2),
            weight=jnp.full(3, jnp.where(news.measured[k], 1.0, 0.0)).astype(x.dtype),
        )
        result = kalman_update.update(P, rows, HP=product(back[:3], P[:6]) + P[6:])
        means.append(x + result.deviation)
        covariances.append(result.covariance)
    return Baselines(mean=jnp.stack(means), covariance=jnp.stack(covariances))


def _tracks(baselines: Baselines, orbit: OrbitEstimate, news: News, delay: float) -> SplitEstimate:
    """Estimates of the peers in the messages, moved to now and to this servicer, (peers, ...)."""
    track = news.messages.track
    assert track is not None
    forth = free_relative_motion.transition_matrix(two_body_gravity.gravity_gradient(orbit.servicer.r_SN_N), delay)
    count = news.used.shape[0]
    moved = [product(forth, product(forth, track.covariance[k]).T) for k in range(count)]
    mean = [apply(forth, track.state[k]) + baselines.mean[k, :6] for k in range(count)]
    return SplitEstimate(mean=jnp.stack(mean), correlated=jnp.stack(moved), independent=baselines.covariance[:, :6, :6])


def predict(
    tuning: OrbitFilterTuning,
    zonal_degree: int,
    memory: EstimateSharing,
    before: OrbitEstimate,
    after: OrbitEstimate,
    delta_v_N: Vector,
    burn_covariance: Matrix,
    dt: float,
) -> EstimateSharing:
    """Memory `dt` [s] later; the arguments are those of `box_sharing.predict`."""
    r_before_N, r_after_N = before.servicer.r_SN_N, after.servicer.r_SN_N
    gradient = two_body_gravity.gravity_gradient(r_before_N)
    noise = burn_covariance + tuning.relative_acceleration_noise**2 * dt * jnp.eye(3, dtype=burn_covariance.dtype)

    def moved(state: Float[Array, "6"]) -> Float[Array, "6"]:
        return baseline_motion.propagate(zonal_degree, state, r_before_N, r_after_N, delta_v_N, dt)

    def grown(P: Array, process: Matrix) -> Array:
        slow = P.shape[0] - 6
        one, zero = jnp.ones(slow, dtype=P.dtype), jnp.zeros(slow, dtype=P.dtype)
        return orbit_covariance.propagate(P, gradient, one, process, zero, dt)

    count = memory.baselines.mean.shape[0]
    mean = [jnp.concatenate([moved(row[:6]), row[6:]]) for row in (memory.baselines.mean[k] for k in range(count))]
    covariance = [grown(memory.baselines.covariance[k], noise) for k in range(count)]
    memory = replace(memory, baselines=Baselines(mean=jnp.stack(mean), covariance=jnp.stack(covariance)))
    if memory.local is None or memory.tracks is None:
        return memory
    assert memory.fused_variance is not None
    found = memory.tracks.estimates
    estimates = SplitEstimate(
        mean=jnp.stack([moved(found.mean[k]) for k in range(count)]),
        correlated=jnp.stack([grown(found.correlated[k], noise) for k in range(count)]),
        independent=jnp.stack([grown(found.independent[k], jnp.zeros_like(noise)) for k in range(count)]),
    )
    state = moved(_state(memory.local)[:6])
    is_widened = _position_variance(before.relative.covariance) > _WIDENED * memory.fused_variance
    widened = relative_orbit_ekf.widen(memory.local, is_widened)
    local = relative_orbit_ekf.predict(tuning, widened, state[:3], state[3:], r_before_N, burn_covariance, dt)
    return replace(memory, local=local, tracks=replace(memory.tracks, estimates=estimates))
