"""Joint filter of one servicer: the target relative to it, the baselines to its peers, and the errors of all views.

Bodies are the target and the peers, each with position and velocity from this servicer in N. Slow errors are the slow
states of the own filter (`relative_filter_state`), then those of each peer (`peer_layout`): slow part of the size error
of its boxes, bearing bias of its camera, slow error of the difference of GPS positions, and bias of the range over the
link if that is measured. The fast errors of the peers' boxes, which are a tumble's, count as noise
(`joint_measurements`).
"""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from rpojax.core.filter_state_layout import MOTION, StateLayout
from rpojax.core.pytree import pytree, replace
from rpojax.flight.cooperation import baseline_motion, joint_covariance, received_messages
from rpojax.flight.cooperation.baseline_motion import TickMotion, peer_layout
from rpojax.flight.cooperation.joint_covariance import JointCovariance
from rpojax.flight.cooperation.received_messages import ReceivedMessages
from rpojax.flight.cooperation.team_settings import BaselineTuning, Link
from rpojax.flight.navigation import relative_filter_state, shape_errors
from rpojax.flight.navigation.orbit_filter_tuning import OrbitFilterTuning
from rpojax.flight.navigation.relative_filter_state import RelativeEstimate

Matrix = Float[Array, "3 3"]
Scalar = Float[Array, ""]


@pytree
class JointEstimate:
    """Mean and covariance of the joint state.

    Attributes:
        own: estimate of the target by this servicer; its covariance is that of the joint one only in `own_estimate`
        peers: (peers, n) means of the peers, in the order of `peer_layout`
        covariance: of all
    """

    own: RelativeEstimate
    peers: Array
    covariance: JointCovariance

    @property
    def peer_layout(self) -> StateLayout:
        """Names of the blocks of a peer's state."""
        return peer_layout(self.peers.shape[1] == peer_layout(has_ranges=True).size)

    @property
    def own_slow(self) -> StateLayout:
        """Names of the servicer's own slow states."""
        return self.own.layout.after("velocity")

    def slow_places(self, peer: int, first: str, last: str | None = None) -> slice:
        """Places of a peer's slow errors among all, from the first block to the last one."""
        layout = self.peer_layout.after("velocity")
        start = self.own_slow.size + peer * layout.size
        return slice(start + layout[first].start, start + layout[last or first].stop)


def own_estimate(estimate: JointEstimate) -> RelativeEstimate:
    """Estimate of the target relative to this servicer, with its covariance."""
    return replace(estimate.own, covariance=estimate.covariance.of_body(0, estimate.own_slow.size))


def initial(
    link: Link,
    tuning: OrbitFilterTuning,
    peer_tuning: OrbitFilterTuning,
    own: RelativeEstimate,
    baselines: Float[Array, "peers 6"],
) -> JointEstimate:
    """Estimate at hand-over, with the first baselines [m, m/s]; the tuning of the peers has a leading axis."""
    baseline, has_ranges = link.baseline, link.settings.ranging
    count, dtype, layout = baselines.shape[0], baselines.dtype, peer_layout(has_ranges)
    zero = jnp.zeros(3, dtype=dtype)
    positions, velocities, slow = [zero], [zero], [jnp.zeros(own.layout.size - MOTION.size, dtype=dtype)]
    for k in range(count):
        of_peer = jax.tree.map(lambda leaf, k=k: leaf[k], peer_tuning)
        motion = baseline_motion.initial_variance(tuning, of_peer)
        positions.append(motion[MOTION["position"]])
        velocities.append(motion[MOTION["velocity"]])
        slow += [
            shape_errors.scale_variance(of_peer)[:1],
            jnp.full(2, relative_filter_state.lasting_variance(of_peer.bearing_bias_sigma)),
            jnp.full(3, baseline.error_sigma**2),
            *([baseline.range_bias_sigma[None] ** 2] if has_ranges else []),
        ]
    columns = layout.size - MOTION.size
    P = jnp.diag(jnp.concatenate([*positions, *velocities, *slow])) + _own_block(own.covariance, count, columns)
    P = P + tuning.target_size_sigma**2 * _common_sizes(own.layout, layout, count).astype(dtype)
    peers = jnp.concatenate([baselines, jnp.zeros((count, columns), dtype=dtype)], axis=1)
    return JointEstimate(own=own, peers=peers, covariance=joint_covariance.from_matrix(P, 1 + count))


def _own_block(covariance: Float[Array, "m m"], peers: int, columns: int) -> Float[Array, "n n"]:
    """The servicer's own covariance in its place in the joint one."""
    gap, rest = 3 * peers, columns * peers

    def placed(block: Array) -> Array:
        return jnp.concatenate(
            [
                jnp.pad(block[MOTION["position"]], ((0, gap), (0, 0))),
                jnp.pad(block[MOTION["velocity"]], ((0, gap), (0, 0))),
                jnp.pad(block[MOTION.size :], ((0, rest), (0, 0))),
            ],
            axis=0,
        )

    return placed(placed(covariance).T).T


def _common_sizes(own: StateLayout, peer: StateLayout, peers: int) -> Float[Array, "n n"]:
    """Ones where the size errors of two views meet: all are of one target, whose size is wrong for all alike."""
    first = MOTION.size * peers
    is_size = np.zeros(first + own.size + (peer.size - MOTION.size) * peers)
    is_size[first + own["size"].start] = 1.0
    for k in range(peers):
        is_size[first + own.size + (peer.size - MOTION.size) * k + peer["size"].start - MOTION.size] = 1.0
    return jnp.asarray(np.outer(is_size, is_size) - np.diag(is_size))


def propagate(
    tuning: OrbitFilterTuning, estimate: JointEstimate, means: JointEstimate, motion: TickMotion, dt: float
) -> JointEstimate:
    """Estimate `dt` [s] later, the `means` of which are propagated; errors of the peers' views wait for messages."""
    own, burn_covariance = means.own, motion.burn_covariance
    decay, own_variance = relative_filter_state.slow_process(tuning, estimate.own, own.r_TS_N, own.v_TS_N, dt)
    identity = jnp.eye(3, dtype=burn_covariance.dtype)
    unmodelled = tuning.relative_acceleration_noise**2 * dt * identity
    # A burn moves the servicer away from target and peers alike; half of an unmodelled acceleration is its own.
    same, other = burn_covariance + unmodelled, burn_covariance + 0.5 * unmodelled
    count = estimate.peers.shape[0]
    rest = estimate.covariance.ss.shape[0] - estimate.own_slow.size
    noise = [[same if i == j else other for j in range(1 + count)] for i in range(1 + count)]
    covariance = joint_covariance.propagate(
        estimate.covariance,
        motion.gravity_gradient,
        jnp.concatenate([jnp.concatenate(row, axis=1) for row in noise], axis=0),
        jnp.concatenate([decay, jnp.ones(rest, dtype=decay.dtype)]),
        jnp.pad(own_variance, (0, rest)),
        dt,
    )
    return replace(means, covariance=covariance)


def widen(estimate: JointEstimate, factor: Scalar) -> JointEstimate:
    """Estimate with the sigma of the target's position and velocity multiplied by a factor, at least 1.

    The whole rows and columns are multiplied: a greater own block alone, beside the same correlations with slow errors
    and peers, need not be a covariance.
    """
    P = estimate.covariance
    motion = jnp.concatenate([jnp.full(3, factor), jnp.ones(P.xx.shape[0] - 3, dtype=P.xx.dtype)])
    return replace(estimate, covariance=joint_covariance.scaled(P, motion, jnp.ones_like(P.ss[0])))


def inflate(estimate: JointEstimate, variance: Float[Array, " n"]) -> JointEstimate:
    """Estimate with variances added to the servicer's own states."""
    P = estimate.covariance
    others, rest = P.xx.shape[0] - 3, P.ss.shape[0] - estimate.own_slow.size
    covariance = replace(
        P,
        xx=P.xx + jnp.diag(jnp.pad(variance[MOTION["position"]], (0, others))),
        vv=P.vv + jnp.diag(jnp.pad(variance[MOTION["velocity"]], (0, others))),
        ss=P.ss + jnp.diag(jnp.pad(variance[MOTION.size :], (0, rest))),
    )
    return replace(estimate, covariance=covariance)


def advance_peers(baseline: BaselineTuning, estimate: JointEstimate, received: ReceivedMessages) -> JointEstimate:
    """Estimate with what time and burns did to the peers since the messages before; without one nothing happens."""
    P = estimate.covariance
    own_size = estimate.own_slow.size
    factors, added, states = [jnp.ones(own_size)], [jnp.zeros(own_size)], []
    moved = []
    for k in range(estimate.peers.shape[0]):
        state, of_peer = estimate.peers[k], received_messages.of_peer(received, k)
        decay, variance = _peer_process(baseline, estimate, k, of_peer)
        factors.append(decay)
        added.append(jnp.where(of_peer.used, variance, 0.0))
        moved.append(jnp.where(of_peer.used, of_peer.burns.covariance, 0.0))
        change = jnp.where(of_peer.used, of_peer.burns.change, 0.0)
        states.append(jnp.concatenate([state[: MOTION.size] + change, decay * state[MOTION.size :]]))
    P = joint_covariance.scaled_slow(P, jnp.concatenate(factors))
    x, v = MOTION["position"], MOTION["velocity"]
    covariance = replace(
        P,
        xx=P.xx + _peer_blocks([block[x, x] for block in moved]),
        xv=P.xv + _peer_blocks([block[x, v] for block in moved]),
        vv=P.vv + _peer_blocks([block[v, v] for block in moved]),
        ss=P.ss + jnp.diag(jnp.concatenate(added)),
    )
    return replace(estimate, peers=jnp.stack(states), covariance=covariance)


def _peer_process(
    baseline: BaselineTuning, estimate: JointEstimate, peer: int, received: ReceivedMessages
) -> tuple[Array, Array]:
    """Decay of a peer's slow errors since its message before, and their process variance, by what it sent."""
    layout, own, dt = estimate.peer_layout, estimate.own, jnp.where(received.used, received.interval, 0.0)
    state = layout.split(estimate.peers[peer])
    view = replace(own, slow={**own.slow, "size": jnp.pad(state["size"], (0, 1))})
    decay, variance = (
        estimate.own_slow.split(values)
        for values in relative_filter_state.slow_process(
            received.tuning.filter, view, own.r_TS_N - state["position"], own.v_TS_N - state["velocity"], dt
        )
    )
    gps_decay = jnp.exp(-dt / baseline.error_time_constant)
    decays = {
        "size": decay["size"][:1],
        "bearing_bias": decay["bearing_bias"],
        "gps_difference": jnp.full(3, gps_decay),
        "range_bias": jnp.ones(1, dtype=dt.dtype),
    }
    variances = {
        "size": variance["size"][:1],
        "bearing_bias": variance["bearing_bias"] + received.attitude_variance,
        "gps_difference": jnp.full(3, baseline.error_sigma**2 * (1.0 - gps_decay**2)),
        "range_bias": jnp.zeros(1, dtype=dt.dtype),
    }
    names = [name for name, _ in layout.after("velocity").blocks]
    return jnp.concatenate([decays[name] for name in names]), jnp.concatenate([variances[name] for name in names])


def _peer_blocks(blocks: list[Matrix]) -> Float[Array, "x x"]:
    """Matrix of all bodies with these blocks of the peers on its diagonal."""
    size = 3 + 3 * len(blocks)
    rows = [jnp.zeros((3, size), dtype=blocks[0].dtype)]
    for k, block in enumerate(blocks):
        rows.append(jnp.pad(block, ((0, 0), (3 + 3 * k, size - 6 - 3 * k))))
    return jnp.concatenate(rows, axis=0)
