"""Sharing of boxes: each servicer uses every box that it sees or receives once, in a joint filter of its own."""

import jax.numpy as jnp
from jaxtyping import Array, Bool

from rpojax.core.filter_state_layout import MOTION
from rpojax.core.pytree import replace
from rpojax.flight.cooperation import baseline_motion, joint_filter, joint_measurements, received_messages
from rpojax.flight.cooperation.baseline_motion import TickMotion
from rpojax.flight.cooperation.joint_filter import JointEstimate
from rpojax.flight.cooperation.received_messages import ReceivedMessages
from rpojax.flight.cooperation.team_records import TeamRecords
from rpojax.flight.cooperation.team_settings import BaselineTuning, Link, ServicerTuning
from rpojax.flight.navigation import relative_filter_state, relative_orbit_ekf
from rpojax.flight.navigation.orbit_filter_tuning import OrbitFilterTuning
from rpojax.flight.navigation.relative_filter_state import RelativeEstimate


def update(
    baseline: BaselineTuning,
    tuning: ServicerTuning,
    estimate: JointEstimate,
    records: TeamRecords,
    received: ReceivedMessages,
) -> tuple[JointEstimate, Bool[Array, " peers"]]:
    """Joint estimate after what a servicer measured itself and received in a tick, and which boxes of peers were used.

    `tuning` is its own one; if its gate rejected boxes for so long that it has recovered, the covariance gets wider.
    """
    if records.rows is not None:
        estimate = joint_measurements.update_by_rows(estimate, records.rows)
    estimate = joint_measurements.update_own(tuning, estimate, records.q_KN, records.gated_box)
    own = estimate.own
    added = relative_orbit_ekf.recovery_variance(tuning.filter, own.layout, own.r_TS_N, records.gate.recovered)
    estimate = joint_filter.inflate(estimate, added)
    estimate = joint_filter.advance_peers(baseline, estimate, received)
    estimate = joint_measurements.update_baselines(baseline, estimate, received)
    if received.ranges is not None:
        estimate = joint_measurements.update_ranges(baseline, estimate, received)
    accepted = []
    for k in range(estimate.peers.shape[0]):
        estimate, is_used = joint_measurements.update_peer_box(estimate, k, received_messages.of_peer(received, k))
        accepted.append(is_used)
    return replace(estimate, own=replace(estimate.own, outline=records.orbit.relative.outline)), jnp.stack(accepted)


def predict(
    link: Link, tuning: OrbitFilterTuning, estimate: JointEstimate, own: RelativeEstimate, motion: TickMotion
) -> JointEstimate:
    """Joint estimate after the motion of a tick, with the target relative to this servicer as its `own` filter has it.

    An estimate that guidance has reopened since the update is reopened here, too.
    """
    moved = [
        baseline_motion.propagate(link.settings.zonal_degree, state[: MOTION.size], motion, link.tick_s)
        for state in (estimate.peers[k] for k in range(estimate.peers.shape[0]))
    ]
    peers = jnp.concatenate([jnp.stack(moved), estimate.peers[:, MOTION.size :]], axis=1)
    means = replace(estimate, own=own, peers=peers)
    wider = joint_filter.widen(estimate, relative_filter_state.reopening_factor(motion.reopened))
    return joint_filter.propagate(tuning, wider, means, motion, link.tick_s)
