"""Sharing of boxes: each servicer uses every box that it sees or hears of once, in a joint filter of its own."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from rpojax.core.orbits import two_body_gravity
from rpojax.core.pytree import replace
from rpojax.flight.cooperation import baseline_motion, free_relative_motion, joint_filter
from rpojax.flight.cooperation.joint_filter import JointEstimate
from rpojax.flight.cooperation.link_settings import BaselineTuning
from rpojax.flight.cooperation.peer_news import News
from rpojax.flight.navigation import relative_orbit_ekf
from rpojax.flight.navigation.combined_orbit_filter import OrbitEstimate
from rpojax.flight.navigation.orbit_filter_tuning import OrbitFilterTuning
from rpojax.flight.navigation.orbit_measurements import BoxMeasurement

Matrix = Float[Array, "3 3"]
Scalar = Float[Array, ""]
Vector = Float[Array, "3"]


def update(
    tuning: OrbitFilterTuning,
    baseline: BaselineTuning,
    focal_px: Scalar,
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
        baseline: belief in differences of GPS positions
        focal_px: () of its camera [px]
        estimate: before
        orbit: after the own orbit filter's update
        q_KN: (4,) attitude of its camera
        box: present if it passed the gate
        recovered: () bool, the gate rejected boxes for so long that it asks for a wider covariance
        news: messages of the tick
        delay: age of these messages [s]
    """
    estimate = joint_filter.update_own(tuning, focal_px, estimate, q_KN, box)
    added = relative_orbit_ekf.recovery_variance(tuning, estimate.own.r_TS_N, recovered)
    estimate = joint_filter.inflate(estimate, jnp.diag(added))
    back = free_relative_motion.transition_matrix(two_body_gravity.gravity_gradient(orbit.servicer.r_SN_N), -delay)
    count = estimate.peers.shape[0]
    of = [jax.tree.map(lambda leaf, k=k: leaf[k], replace(news, own_burns=jnp.zeros(count))) for k in range(count)]
    for k in range(count):
        estimate = joint_filter.hear(
            of[k].tuning, baseline, estimate, k, of[k].used, of[k].interval, of[k].burns, of[k].attitude_variance
        )
    estimate = joint_filter.update_baselines(baseline, estimate, news.measured, news.baseline, news.own_burns, back)
    accepted = []
    for k in range(count):
        heard, sent = of[k].used, of[k].messages.box
        assert sent is not None
        sent = replace(sent, present=sent.present & heard, expected=sent.expected & heard)
        estimate, is_used = joint_filter.update_peer_box(
            of[k].tuning, of[k].focal_px, estimate, k, of[k].messages.q_KN, sent, back
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
    dt: float,
) -> JointEstimate:
    """Joint estimate `dt` [s] later.

    `before` and `after` are the servicer's orbit estimates before and after their prediction, with the expected
    velocity change `delta_v_N` [m/s]. What guidance added to the covariance since the update is added here, too.
    """
    added = before.relative.covariance - estimate.covariance[: joint_filter.OWN, : joint_filter.OWN]
    r_before_N, r_after_N = before.servicer.r_SN_N, after.servicer.r_SN_N
    peers = []
    for k in range(estimate.peers.shape[0]):
        state = estimate.peers[k]
        moved = baseline_motion.propagate(zonal_degree, state[:6], r_before_N, r_after_N, delta_v_N, dt)
        peers.append(jnp.concatenate([moved, state[6:]]))
    return joint_filter.propagate(
        tuning,
        joint_filter.inflate(estimate, added),
        after.relative,
        jnp.stack(peers),
        two_body_gravity.gravity_gradient(r_before_N),
        burn_covariance,
        dt,
    )
