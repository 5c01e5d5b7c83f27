"""Joint filter of one servicer: the target relative to it, the baselines to its peers, and the errors of all views.

Bodies are the target and the peers, each with position and velocity from this servicer in N. Slow errors are the six of
the own view (`relative_orbit_ekf`), then for each peer: slow part of the size error of its boxes (1), bearing bias of
its camera (2), slow error of the difference of GPS positions (3), and bias of the range over the link (1, if it is
measured). The fast errors of the peers' boxes, which are a tumble's, count as noise (`joint_measurements`).
"""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from rpojax.core.pytree import pytree, replace
from rpojax.flight.cooperation import baseline_motion, joint_covariance
from rpojax.flight.cooperation.burn_effect import BurnEffect
from rpojax.flight.cooperation.joint_covariance import JointCovariance
from rpojax.flight.cooperation.link_settings import BaselineTuning
from rpojax.flight.navigation import outline_correlation, shape_errors
from rpojax.flight.navigation.orbit_filter_tuning import OrbitFilterTuning
from rpojax.flight.navigation.relative_estimate import RelativeEstimate

Vector = Float[Array, "3"]
Matrix = Float[Array, "3 3"]
Scalar = Float[Array, ""]

OWN_SLOW = 6
"""Slow errors of the servicer's own view: size (2), bearing (2), centre (2)."""
MOTION = 6
"""Position and velocity of a body."""
_PEER_SLOW = 6
"""Slow errors of a peer without a range over the link: size (1), bearing (2), GPS difference (3)."""


@pytree
class JointEstimate:
    """Mean and covariance of the joint state.

    Attributes:
        own: estimate of the target by this servicer; its covariance is that of the joint one only in `own_estimate`
        peers: (peers, 12) mean position, velocity and slow errors of the peers; 13 with a range over the link
        covariance: of all
    """

    own: RelativeEstimate
    peers: Array
    covariance: JointCovariance

    @property
    def has_ranges(self) -> bool:
        """Whether the biases of ranges over the links are states."""
        return self.peers.shape[1] > MOTION + _PEER_SLOW

    def slow_start(self, peer: int) -> int:
        """Place of a peer's slow errors among all."""
        return OWN_SLOW + peer * (self.peers.shape[1] - MOTION)


def own_estimate(estimate: JointEstimate) -> RelativeEstimate:
    """Estimate of the target relative to this servicer, with its covariance."""
    return replace(estimate.own, covariance=estimate.covariance.of_body(0, OWN_SLOW))


def initial(
    tuning: OrbitFilterTuning,
    baseline: BaselineTuning,
    own: RelativeEstimate,
    baselines: Float[Array, "peers 6"],
    peer_tuning: OrbitFilterTuning,
    has_ranges: bool,
) -> JointEstimate:
    """Estimate at hand-over, with the first baselines [m, m/s]; the tuning of the peers has a leading axis."""
    count, dtype = baselines.shape[0], baselines.dtype
    positions, velocities, slow = [jnp.zeros(3, dtype=dtype)], [jnp.zeros(3, dtype=dtype)], [jnp.zeros(OWN_SLOW)]
    for k in range(count):
        of = jax.tree.map(lambda leaf, k=k: leaf[k], peer_tuning)
        motion = baseline_motion.initial_variance(tuning, of)
        positions.append(motion[:3])
        velocities.append(motion[3:])
        slow += [
            shape_errors.scale_variance(of)[:1],
            jnp.full(2, of.bearing_bias_sigma**2),
            jnp.full(3, baseline.error_sigma**2),
            *([baseline.range_bias_sigma[None] ** 2] if has_ranges else []),
        ]
    columns = _PEER_SLOW + has_ranges
    P = jnp.diag(jnp.concatenate([*positions, *velocities, *slow])) + _own_block(own.covariance, count, columns)
    P = P + tuning.target_size_sigma**2 * _common_sizes(count, columns).astype(dtype)
    peers = jnp.concatenate([baselines, jnp.zeros((count, columns), dtype=dtype)], axis=1)
    return JointEstimate(own=own, peers=peers, covariance=joint_covariance.from_matrix(P, 1 + count))


def _own_block(covariance: Float[Array, "12 12"], peers: int, columns: int) -> Float[Array, "n n"]:
    """The servicer's own covariance in its place in the joint one."""
    gap, rest = 3 * peers, columns * peers

    def placed(block: Array) -> Array:
        return jnp.concatenate(
            [
                jnp.pad(block[:3], ((0, gap), (0, 0))),
                jnp.pad(block[3:6], ((0, gap), (0, 0))),
                jnp.pad(block[6:], ((0, rest), (0, 0))),
            ],
            axis=0,
        )

    return placed(placed(covariance).T).T


def _common_sizes(peers: int, columns: int) -> Float[Array, "n n"]:
    """Ones where the size errors of two views meet: all are of one target, whose size is wrong for all alike."""
    first = MOTION * (1 + peers)
    is_size = np.zeros(first + OWN_SLOW + columns * peers)
    is_size[[first, *(first + OWN_SLOW + columns * k for k in range(peers))]] = 1.0
    return jnp.asarray(np.outer(is_size, is_size) - np.diag(is_size))


def propagate(
    tuning: OrbitFilterTuning,
    estimate: JointEstimate,
    own: RelativeEstimate,
    motion: Float[Array, "peers 6"],
    gravity_gradient: Matrix,
    burn_covariance: Matrix,
    dt: float,
) -> JointEstimate:
    """Estimate `dt` [s] later with the means already propagated; errors of the peers' views wait for their messages."""
    decay, own_variance = _slow_process(
        tuning, replace(own, scale=estimate.own.scale, outline=estimate.own.outline), dt
    )
    identity = jnp.eye(3, dtype=burn_covariance.dtype)
    unmodelled = tuning.relative_acceleration_noise**2 * dt * identity
    # A burn moves the servicer away from target and peers alike; half of an unmodelled acceleration is its own.
    same, other = burn_covariance + unmodelled, burn_covariance + 0.5 * unmodelled
    count = motion.shape[0]
    rest = estimate.covariance.ss.shape[0] - OWN_SLOW
    noise = [[same if i == j else other for j in range(1 + count)] for i in range(1 + count)]
    covariance = joint_covariance.propagate(
        estimate.covariance,
        gravity_gradient,
        jnp.concatenate([jnp.concatenate(row, axis=1) for row in noise], axis=0),
        jnp.concatenate([decay, jnp.ones(rest, dtype=decay.dtype)]),
        jnp.pad(own_variance, (0, rest)),
        dt,
    )
    peers = jnp.concatenate([motion, estimate.peers[:, MOTION:]], axis=1)
    return JointEstimate(own=own, peers=peers, covariance=covariance)


def _slow_process(
    tuning: OrbitFilterTuning, own: RelativeEstimate, dt: float | Scalar
) -> tuple[Float[Array, "6"], Float[Array, "6"]]:
    """Decay over `dt` [s] of the errors of size, bearing and centre of a view, and their process variance."""
    errors = shape_errors.shape_errors(
        tuning, outline_correlation.correlation_time(own.outline), own.scale[0], own.r_TS_N, own.v_TS_N
    )
    one = jnp.ones(2, dtype=errors.scale_variance.dtype)
    decay = jnp.concatenate(
        [jnp.exp(-dt / errors.scale_time_constant), one, one * jnp.exp(-dt / errors.center_time_constant)]
    )
    variance = jnp.concatenate([errors.scale_variance, 0.0 * one, errors.center_variance * one])
    walk = jnp.pad(jnp.full(2, errors.bearing_process_variance * dt), (2, 2))
    return decay, variance * (1.0 - decay**2) + walk


def widen(estimate: JointEstimate, factor: Scalar) -> JointEstimate:
    """Estimate with the sigma of the target's position and velocity multiplied by a factor, at least 1.

    The whole rows and columns are multiplied: a greater own block alone, beside the same correlations with slow errors
    and peers, need not be a covariance.
    """
    P = estimate.covariance
    motion = jnp.concatenate([jnp.full(3, factor), jnp.ones(P.xx.shape[0] - 3, dtype=P.xx.dtype)])
    return replace(estimate, covariance=joint_covariance.scaled(P, motion, jnp.ones_like(P.ss[0])))


def inflate(estimate: JointEstimate, variance: Float[Array, "12"]) -> JointEstimate:
    """Estimate with variances added to the servicer's own states."""
    P = estimate.covariance
    others, rest = P.xx.shape[0] - 3, P.ss.shape[0] - OWN_SLOW
    covariance = replace(
        P,
        xx=P.xx + jnp.diag(jnp.pad(variance[:3], (0, others))),
        vv=P.vv + jnp.diag(jnp.pad(variance[3:6], (0, others))),
        ss=P.ss + jnp.diag(jnp.pad(variance[6:], (0, rest))),
    )
    return replace(estimate, covariance=covariance)


def hear(
    tuning: OrbitFilterTuning,
    baseline: BaselineTuning,
    estimate: JointEstimate,
    used: Bool[Array, " peers"],
    interval: Float[Array, " peers"],
    burns: BurnEffect,
    attitude_variance: Float[Array, " peers"],
) -> JointEstimate:
    """Estimate with what time and burns did to the peers since the messages before; without news nothing happens.

    Args:
        tuning: of the peers, with a leading axis
        baseline: belief in differences of GPS positions and ranges
        estimate: of this servicer
        used: (peers,) bool
        interval: (peers,) between the time stamps [s]
        burns: effect of the peers' burns since the message before, propagated to now
        attitude_variance: (peers,) change of the variance of their attitudes since then [rad^2]
    """
    P = estimate.covariance
    factors, added, states = [jnp.ones(OWN_SLOW)], [jnp.zeros(OWN_SLOW)], []
    moved = []
    for k in range(estimate.peers.shape[0]):
        state, dt = estimate.peers[k], jnp.where(used[k], interval[k], 0.0)
        decay, variance = _peer_process(
            jax.tree.map(lambda leaf, k=k: leaf[k], tuning), baseline, estimate, k, dt, attitude_variance[k]
        )
        factors.append(decay)
        added.append(jnp.where(used[k], variance, 0.0))
        moved.append(jnp.where(used[k], burns.covariance[k], 0.0))
        change = jnp.where(used[k], burns.change[k], 0.0)
        states.append(jnp.concatenate([state[:MOTION] + change, decay * state[MOTION:]]))
    P = joint_covariance.scaled_slow(P, jnp.concatenate(factors))
    covariance = replace(
        P,
        xx=P.xx + _peer_blocks([block[:3, :3] for block in moved]),
        xv=P.xv + _peer_blocks([block[:3, 3:] for block in moved]),
        vv=P.vv + _peer_blocks([block[3:, 3:] for block in moved]),
        ss=P.ss + jnp.diag(jnp.concatenate(added)),
    )
    return replace(estimate, peers=jnp.stack(states), covariance=covariance)


def _peer_process(
    tuning: OrbitFilterTuning,
    baseline: BaselineTuning,
    estimate: JointEstimate,
    peer: int,
    dt: Scalar,
    attitude_variance: Scalar,
) -> tuple[Array, Array]:
    """Decay over `dt` [s] of a peer's slow errors, and their process variance."""
    state = estimate.peers[peer]
    view = replace(
        estimate.own,
        scale=state[6:8] * jnp.array([1.0, 0.0]),
        r_TS_N=estimate.own.r_TS_N - state[:3],
        v_TS_N=estimate.own.v_TS_N - state[3:6],
    )
    decay, variance = _slow_process(tuning, view, dt)
    gps_decay = jnp.exp(-dt / baseline.error_time_constant)
    gps_variance = baseline.error_sigma**2 * (1.0 - gps_decay**2)
    constant = int(estimate.has_ranges)
    decays = [decay[:1], decay[2:4], jnp.full(3, gps_decay), jnp.ones(constant, dtype=dt.dtype)]
    variances = [variance[:1], variance[2:4] + attitude_variance, jnp.full(3, gps_variance), jnp.zeros(constant)]
    return jnp.concatenate(decays), jnp.concatenate(variances)


def _peer_blocks(blocks: list[Matrix]) -> Float[Array, "x x"]:
    """Matrix of all bodies with these blocks of the peers on its diagonal."""
    size = 3 + 3 * len(blocks)
    rows = [jnp.zeros((3, size), dtype=blocks[0].dtype)]
    for k, block in enumerate(blocks):
        rows.append(jnp.pad(block, ((0, 0), (3 + 3 * k, size - 6 - 3 * k))))
    return jnp.concatenate(rows, axis=0)
