"""Joint filter of several bodies against a dense filter in Joseph's form, and its covariance over a long time."""

from functools import cache, partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from rpojax.core.orbits import gravity_gradient
from rpojax.core.pytree import replace
from rpojax.core.vectors import apply
from rpojax.flight.cooperation import baseline_motion, joint_filter, joint_measurements
from rpojax.flight.cooperation.baseline_motion import TickMotion
from rpojax.flight.cooperation.burn_effect import BurnEffect
from rpojax.flight.cooperation.joint_filter import JointEstimate
from rpojax.flight.cooperation.received_messages import OwnThen, ReceivedMessages
from rpojax.flight.cooperation.team_settings import BaselineTuning, Link, LinkSettings, ServicerTuning
from rpojax.flight.navigation import outline_correlation, relative_filter_state, shape_errors
from rpojax.flight.navigation.orbit_filter_tuning import OrbitFilterTuning
from rpojax.flight.navigation.orbit_measurements import BoxMeasurement
from rpojax.flight.navigation.relative_filter_state import VIEW_STATES
from rpojax.scenario import params as parameters
from rpojax.scenario.loading import scenario_loader

R_N = np.array([6.9e6, 1e5, -3e5])
G = np.asarray(jax.jit(gravity_gradient.gravity_gradient)(R_N))
BURNS = np.diag([1e-8, 4e-8, 2e-8])
BACK = jax.jit(baseline_motion.transition_matrix)(G, -3.0)
BASELINE = BaselineTuning(
    noise=jnp.asarray(0.05),
    error_sigma=jnp.asarray(0.007),
    error_time_constant=jnp.asarray(700.0),
    range_noise=jnp.asarray(0.02),
    range_bias_sigma=jnp.asarray(0.05),
)
LINK = Link(LinkSettings(3, "boxes", 1, 3, (), 0, True), BASELINE, 1.0)
PLACES = jnp.array([[30.0, 20.0, 0.0, 0.0, 0.01, 0.02], [0.0, 0.0, -40.0, 0.01, 0.0, 0.0]])
IDENTITY = jnp.array([1.0, 0.0, 0.0, 0.0])
BODIES, SLOW, PEER = 3, 20, 7
"""Target and two peers; six slow errors of the own view and seven of each peer."""
SIZE = 6 * BODIES + SLOW


@cache
def tuning() -> OrbitFilterTuning:
    file = scenario_loader.load("inspection", ["navigation.target_size_sigma=0.3"])
    with jax.ensure_compile_time_eval():  # it may be asked for first in a trace
        return parameters.build_params(file.model_dump(), 128, 128).flight.navigation


def peer_tuning() -> OrbitFilterTuning:
    return jax.tree.map(lambda leaf: jnp.stack([leaf] * 2), tuning())


@jax.jit
def initial() -> JointEstimate:
    own = relative_filter_state.initial(tuning(), jnp.array([0.0, 0.0, 30.0]), jnp.zeros(3), VIEW_STATES)
    return joint_filter.initial(LINK, tuning(), peer_tuning(), own, PLACES)


def ahead() -> BoxMeasurement:
    """Box of a target straight ahead of the camera."""
    zero, yes, no = jnp.zeros(()), jnp.ones((), dtype=bool), jnp.zeros((), dtype=bool)
    return BoxMeasurement(
        tangent=jnp.zeros(2),
        log_size=jnp.log(tuning().target_size / 30.0),
        log_aspect=zero,
        side_px=zero + 25.0,
        present=yes,
        expected=yes,
        truncated=no,
        half_frame_tangent=jnp.full(2, 0.0875),
        attitude_variance_change=zero,
        interval=zero + 1.0,
    )


def received(used: jax.Array, **known: Any) -> ReceivedMessages:
    """What is received of the peers, or of one of them, as far as it is `known`."""
    unknown = dict.fromkeys(["messages", "interval", "burns", "attitude_variance", "baseline", "measured", "own"])
    tunings = ServicerTuning(filter=peer_tuning(), focal_px=None)
    return ReceivedMessages(**{**unknown, "used": used, "tuning": tunings, **known})


def own_then(to_stamp: jax.Array | None) -> OwnThen:
    """A servicer that has not burned since the time stamp."""
    return OwnThen(message=None, burns=jnp.zeros(6), to_stamp=to_stamp)


def place(kind: str, body: int) -> slice:
    first = {"x": 3 * body, "v": 3 * BODIES + 3 * body, "gps": 6 * BODIES + 6 + PEER * (body - 1) + 3}[kind]
    return slice(first, first + 3)


@jax.jit
def tick(estimate: JointEstimate, heard: jax.Array, burn: jax.Array) -> JointEstimate:
    """One second with measurements of baselines and ranges that agree with the estimate, three seconds late."""
    burns = BurnEffect(
        change=jnp.zeros((2, 6)), covariance=jnp.zeros((2, 6, 6)).at[:, 3:, 3:].set(burn * jnp.asarray(BURNS))
    )
    one, own = jnp.ones(2), own_then(BACK)
    of_peers = received(heard, interval=one, burns=burns, attitude_variance=1e-8 * one, own=own)
    estimate = joint_filter.advance_peers(BASELINE, estimate, of_peers)
    then = jnp.stack([apply(BACK[:3], row[:6]) for row in estimate.peers])
    of_peers = replace(of_peers, measured=heard, baseline=then + estimate.peers[:, 9:12])
    estimate = joint_measurements.update_baselines(BASELINE, estimate, of_peers)
    motion = TickMotion(
        r_before_N=jnp.asarray(R_N),
        r_after_N=jnp.asarray(R_N),
        delta_v_N=jnp.zeros(3),
        burn_covariance=burn * jnp.asarray(BURNS),
        reopened=jnp.asarray(False),
    )
    return joint_filter.propagate(tuning(), estimate, estimate, motion, 1.0)


@partial(jax.jit, static_argnums=1)
def peer_process(estimate: JointEstimate, peer: int) -> tuple[jax.Array, jax.Array]:
    """Decay and process variance of the slow errors of a peer that was received a second ago."""
    of_peer = received(
        jnp.asarray(True),
        interval=jnp.ones(()),
        attitude_variance=jnp.float64(1e-8),
        tuning=ServicerTuning(filter=tuning(), focal_px=None),
    )
    return joint_filter._peer_process(BASELINE, estimate, peer, of_peer)


slow_process = jax.jit(lambda own: relative_filter_state.slow_process(tuning(), own, own.r_TS_N, own.v_TS_N, 1.0))
widen = jax.jit(joint_filter.widen)
update_ranges = jax.jit(joint_measurements.update_ranges)


def dense_tick(P: np.ndarray, estimate: JointEstimate, heard: np.ndarray, burn: float) -> np.ndarray:
    """The same with dense matrices: Joseph's form, and the noise of the own position in all differences."""
    decay, growth = np.ones(SIZE), np.zeros(SIZE)
    for k in np.nonzero(heard)[0]:
        slow = 6 * BODIES + 6 + PEER * k
        of_view, variance = peer_process(estimate, int(k))
        decay[slow : slow + PEER], growth[slow : slow + PEER] = of_view, variance
    P = decay[:, None] * P * decay + np.diag(growth)
    for k in np.nonzero(heard)[0]:
        P[place("v", 1 + k), place("v", 1 + k)] += burn * BURNS
    H = np.zeros((6, SIZE))
    for k in range(2):
        rows = slice(3 * k, 3 * k + 3)
        H[rows, place("x", 1 + k)], H[rows, place("v", 1 + k)] = BACK[:3, :3], BACK[:3, 3:]
        H[rows, place("gps", 1 + k)] = np.eye(3)
    kept = np.repeat(heard, 3)
    H = H[kept]
    R = float(BASELINE.noise) ** 2 * np.kron(0.5 * (np.eye(2) + np.ones((2, 2))), np.eye(3))[kept][:, kept]
    K = np.linalg.solve(H @ P @ H.T + R, H @ P).T
    P = (np.eye(SIZE) - K @ H) @ P @ (np.eye(SIZE) - K @ H).T + K @ R @ K.T
    F = np.eye(SIZE)
    own_decay, own_growth = slow_process(estimate.own)
    own = slice(6 * BODIES, 6 * BODIES + 6)
    F[own, own] = np.diag(own_decay)
    Q = np.zeros((SIZE, SIZE))
    Q[own, own] = np.diag(own_growth)
    unmodelled = float(tuning().relative_acceleration_noise) ** 2 * np.eye(3)
    for i in range(BODIES):
        # A kick, then a drift.
        F[place("v", i), place("x", i)] = G
        F[place("x", i), place("x", i)], F[place("x", i), place("v", i)] = np.eye(3) + G, np.eye(3)
        for j in range(BODIES):
            Q[place("v", i), place("v", j)] = burn * BURNS + (1.0 if i == j else 0.5) * unmodelled
    return F @ P @ F.T + Q


def test_covariance_is_that_of_a_dense_filter() -> None:
    estimate = initial()
    P = np.asarray(estimate.covariance.matrix)
    rng = np.random.default_rng(1)
    for _ in range(25):
        heard, burn = rng.uniform(size=2) < 0.7, float(rng.uniform() < 0.3)
        P = dense_tick(P, estimate, heard, burn)
        estimate = tick(estimate, jnp.asarray(heard), jnp.asarray(burn))
    found = np.asarray(estimate.covariance.matrix)
    sigma = np.sqrt(np.diag(P))
    np.testing.assert_allclose(found / np.outer(sigma, sigma), P / np.outer(sigma, sigma), atol=1e-9)


def test_errors_of_a_peer_that_is_heard_fade_to_what_they_are_without_measurements() -> None:
    rng, dt, attitude = np.random.default_rng(4), 500.0, 1e-7
    estimate = initial()
    P = estimate.covariance
    # The first GPS difference is known, the second not at all.
    first = [6 + PEER * k + 3 for k in range(2)]
    known = np.ones(SLOW)
    known[first[0] : first[0] + 3] = 0.1
    P = replace(P, ss=jnp.asarray(np.asarray(P.ss) * np.outer(known, known)))
    peers = np.array(estimate.peers)
    peers[:, 6:] = rng.normal(size=(2, PEER))
    estimate = replace(estimate, covariance=P, peers=jnp.asarray(peers))
    burns = BurnEffect(change=jnp.asarray(rng.normal(size=(2, 6))), covariance=jnp.asarray(np.stack([np.eye(6)] * 2)))
    used, both = jnp.array([True, False]), jnp.ones(2)
    of_peers = received(used, interval=dt * both, burns=burns, attitude_variance=attitude * both)
    after = jax.jit(joint_filter.advance_peers)(BASELINE, estimate, of_peers)

    time = outline_correlation.correlation_time(estimate.own.outline)
    r, v = estimate.own.r_TS_N - peers[0, :3], estimate.own.v_TS_N - peers[0, 3:6]
    errors = shape_errors.shape_errors(tuning(), time, jnp.asarray(peers[0, 6]), r, v)
    size, gps = np.exp(-dt / float(errors.scale_time_constant[0])), np.exp(-dt / 700.0)
    factors = np.array([size, 1.0, 1.0, gps, gps, gps, 1.0])
    np.testing.assert_allclose(after.peers[0, :6], peers[0, :6] + burns.change[0], rtol=1e-12)
    np.testing.assert_allclose(after.peers[0, 6:], factors * peers[0, 6:], rtol=1e-12)
    np.testing.assert_array_equal(after.peers[1], peers[1])

    slow = slice(6, 6 + PEER)
    before, found = np.asarray(P.ss), np.asarray(after.covariance.ss)
    walk = attitude + float(errors.bearing_process_variance) * dt
    stationary = np.array([float(errors.scale_variance[0]), 0.0, 0.0, *3 * [0.007**2], 0.0])
    expected = factors**2 * np.diag(before)[slow] + (1.0 - factors**2) * stationary + [0.0, walk, walk, *4 * [0.0]]
    np.testing.assert_allclose(np.diag(found)[slow], expected, rtol=1e-9)
    all_factors = np.concatenate([np.ones(6), factors, np.ones(PEER)])
    off_diagonal = ~np.eye(SLOW, dtype=bool)
    scaled = all_factors[:, None] * before * all_factors
    np.testing.assert_allclose(found[off_diagonal], scaled[off_diagonal], rtol=1e-9)
    np.testing.assert_array_equal(np.diag(found)[6 + PEER :], np.diag(before)[6 + PEER :])
    # A burn of the peer makes its place uncertain, and no other.
    added = np.asarray(after.covariance.xx - P.xx)
    np.testing.assert_array_equal(added, np.diag([0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 0.0, 0.0, 0.0]))


def test_covariance_stays_symmetric_and_definite_for_hours() -> None:
    def advance(estimate: JointEstimate, number: jax.Array) -> tuple[JointEstimate, Any]:
        burn = jnp.where(number % 100 == 0, 1.0, 0.0)
        heard = jnp.stack([number % 3 > 0, number % 7 > 2])
        seen = joint_measurements.update_own(own_tuning, estimate, IDENTITY, ahead())
        after = tick(replace(seen, own=estimate.own), heard, burn)
        after = joint_filter.widen(after, jnp.where(number % 1500 == 1499, jnp.sqrt(2.0), 1.0))
        return after, None

    own_tuning = ServicerTuning(filter=tuning(), focal_px=jnp.asarray(700.0))
    run = jax.jit(lambda estimate, numbers: jax.lax.scan(advance, estimate, numbers)[0])
    estimate = initial()
    for hour in range(3):
        estimate = run(estimate, jnp.arange(3600 * hour, 3600 * (hour + 1), dtype=jnp.int32))
        P = np.asarray(estimate.covariance.matrix)
        np.testing.assert_array_equal(P, P.T)
        sigma = np.sqrt(np.diag(P))
        assert np.linalg.eigvalsh(P / np.outer(sigma, sigma))[0] > 1e-9


def test_a_wider_own_block_alone_would_be_no_covariance() -> None:
    """Why a failed search widens rows and columns: the target is known by its bearing from a peer alone."""
    estimate = initial()
    P = np.asarray(estimate.covariance.matrix)
    h = np.zeros(SIZE)
    h[place("x", 0)], h[place("x", 1)] = [0.0, 1.0, 0.0], [0.0, -1.0, 0.0]
    P = P - np.outer(P @ h, P @ h) / (h @ P @ h + 1e-6)
    factors = np.ones(SIZE)
    factors[place("x", 0)] = factors[place("v", 0)] = np.sqrt(2.0)
    own = [*range(3), *range(9, 12), *range(18, 24)]
    block = P.copy()
    block[np.ix_(own, own)] = (factors[:, None] * P * factors)[np.ix_(own, own)]
    widened = widen(
        JointEstimate(
            own=estimate.own,
            peers=estimate.peers,
            covariance=joint_filter.joint_covariance.from_matrix(jnp.asarray(P), BODIES),
        ),
        jnp.sqrt(2.0),
    ).covariance.matrix
    np.testing.assert_allclose(widened, factors[:, None] * P * factors, rtol=1e-12)
    assert np.linalg.eigvalsh(widened)[0] > 0.0


@pytest.mark.parametrize("delay", [None, BACK])
def test_a_range_is_used_as_a_dense_filter_does(delay: jax.Array | None) -> None:
    estimate = initial()
    # Baselines that are known to centimetres, where the second order of the range is nothing.
    for _ in range(40):
        estimate = tick(estimate, jnp.ones(2, dtype=bool), jnp.zeros(()))
    P = np.asarray(estimate.covariance.matrix)
    motion = np.asarray(estimate.peers)[0, :6]
    b = motion[:3] if delay is None else np.asarray(delay)[:3] @ motion
    distance = float(np.linalg.norm(b))
    ranges = np.array([distance + 0.1, 0.0])
    of_peers = received(jnp.array([True, False]), ranges=jnp.asarray(ranges), own=own_then(delay))
    after = update_ranges(BASELINE, estimate, of_peers)
    h, u = np.zeros(SIZE), b / distance
    h[place("x", 1)] = u if delay is None else u @ np.asarray(delay[:3, :3])
    if delay is not None:
        h[place("v", 1)] = u @ np.asarray(delay[:3, 3:])
    h[place("gps", 1).stop] = 1.0
    s = h @ P @ h + float(BASELINE.range_noise) ** 2
    sigma = np.sqrt(np.diag(P))
    expected = P - np.outer(P @ h, P @ h) / s
    found = np.asarray(after.covariance.matrix)
    # The second order of the range adds (0.03 m)^2 / 36 m to it.
    np.testing.assert_allclose(found / np.outer(sigma, sigma), expected / np.outer(sigma, sigma), atol=1e-4)
    np.testing.assert_allclose(after.peers[0, :3] - estimate.peers[0, :3], (P @ h)[place("x", 1)] * 0.1 / s, atol=2e-4)
