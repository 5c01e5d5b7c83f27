"""Sharing of boxes: each servicer uses every box that it sees or hears of once, in a joint filter of its own."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from rpojax.core.orbits import two_body_gravity
from rpojax.core.pytree import replace
from rpojax.core.state_layout import MOTION
from rpojax.flight.cooperation import baseline_motion, free_relative_motion, joint_filter, joint_measurements
from rpojax.flight.cooperation.joint_filter import JointEstimate
from rpojax.flight.cooperation.link_settings import BaselineTuning
from rpojax.flight.cooperation.peer_news import News
from rpojax.flight.navigation import relative_orbit_ekf, relative_state
from rpojax.flight.navigation.combined_orbit_filter import OrbitEstimate
from rpojax.flight.navigation.orbit_filter_tuning import OrbitFilterTuning
from rpojax.flight.navigation.orbit_measurements import BoxMeasurement

Matrix = Float[Array, "3 3"]
Vector = Float[Array, "3"]


def update(
    tuning: OrbitFilterTuning,
    baseline: BaselineTuning,
    focal_px: Float[Array, ""],
    estimate: JointEstimate,
    orbit: OrbitEstimate,
    q_KN: Float[Array, "4"],
    box: BoxMeasurement,
    recovered: Bool[Array, ""],
    news: News,
    delay: float,
) -> tuple[JointEstimate, Bool[Array, " peers"]]:
    """Joint estimate after the own box and the messages of a tick, and which boxes of peers were used.

    Args:
        tuning: of this servicer
        baseline: belief in differences of GPS positions, and in ranges over the links
        focal_px: () of its camera [px]
        estimate: before
        orbit: after the own orbit filter's update
        q_KN: (4,) attitude of its camera
        box: present if it passed the gate
        recovered: () bool, the gate rejected boxes for so long that it asks for a wider covariance
        news: messages of the tick
        delay: age of these messages [s]
    """
    estimate = joint_measurements.update_own(tuning, focal_px, estimate, q_KN, box)
    added = relative_orbit_ekf.recovery_variance(tuning, estimate.own.layout, estimate.own.r_TS_N, recovered)
    estimate = joint_filter.inflate(estimate, added)
    back = None
    if delay > 0.0:
        back = free_relative_motion.transition_matrix(two_body_gravity.gravity_gradient(orbit.servicer.r_SN_N), -delay)
    estimate = joint_filter.hear(
        news.tuning, baseline, estimate, news.used, news.interval, news.burns, news.attitude_variance
    )
    differences = news.measured, news.baseline, news.own_burns, back
    estimate = joint_measurements.update_baselines(baseline, estimate, *differences)
    if news.ranges is not None:
        ranges = news.used, news.ranges, news.own_burns, back
        estimate = joint_measurements.update_ranges(baseline, estimate, *ranges)
    accepted = []
    for k in range(estimate.peers.shape[0]):
        of = jax.tree.map(lambda leaf, k=k: leaf[k], (news.tuning, news.focal_px, news.messages, news.interval))
        peer_tuning, peer_focal_px, sent, interval = of
        assert sent.box is not None
        heard = news.used[k]
        peer_box = replace(sent.box, present=sent.box.present & heard, expected=sent.box.expected & heard)
        estimate, is_used = joint_measurements.update_peer_box(
            peer_tuning, peer_focal_px, estimate, k, sent.q_KN, peer_box, interval, back
        )
        accepted.append(is_used)
    return replace(estimate, own=replace(estimate.own, outline=orbit.relative.outline)), jnp.stack(accepted)


def predict(
    tuning: OrbitFilterTuning,
    zonal_degree: int,
    estimate: JointEstimate,
    before: OrbitEstimate,
    after: OrbitEstimate,
    delta_v_N: Vector,
    burn_covariance: Matrix,
    reopened: Bool[Array, ""],
    dt: float,
) -> JointEstimate:
    """Joint estimate `dt` [s] later.

    `before` and `after` are the servicer's orbit estimates before and after their prediction, with the expected
    velocity change `delta_v_N` [m/s]. An estimate that guidance has `reopened` since the update is so here, too.
    """
    r_before_N, r_after_N = before.servicer.r_SN_N, after.servicer.r_SN_N
    motion = [
        baseline_motion.propagate(zonal_degree, state[: MOTION.size], r_before_N, r_after_N, delta_v_N, dt)
        for state in (estimate.peers[k] for k in range(estimate.peers.shape[0]))
    ]
    return joint_filter.propagate(
        tuning,
        joint_filter.widen(estimate, relative_state.reopening_factor(reopened)),
        after.relative,
        jnp.stack(motion),
        two_body_gravity.gravity_gradient(r_before_N),
        burn_covariance,
        dt,
    )
