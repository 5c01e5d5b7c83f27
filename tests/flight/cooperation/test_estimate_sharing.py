"""Estimates and baselines of a servicer after messages, against dense updates in numpy."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import rendezvous_scene
from numpy_reference import MU, random_covariance, unit
from scipy.linalg import expm

from rpojax.core.pytree import replace
from rpojax.flight.cooperation import covariance_intersection, estimate_sharing
from rpojax.flight.cooperation.burn_effect import BurnEffect
from rpojax.flight.cooperation.covariance_intersection import SplitEstimate
from rpojax.flight.cooperation.estimate_sharing import Baselines, EstimateSharing, Tracks
from rpojax.flight.cooperation.message import Message, TargetTrack
from rpojax.flight.cooperation.received_messages import OwnThen, ReceivedMessages
from rpojax.flight.cooperation.team_settings import BaselineTuning
from rpojax.flight.flight_records import FlightParams
from rpojax.flight.navigation.combined_orbit_filter import OrbitEstimate
from rpojax.flight.navigation.relative_filter_state import VIEW_STATES, RelativeEstimate

DELAY = 5.0
NOISE, ERROR, TIME_CONSTANT, RANGE_NOISE, RANGE_BIAS = 0.05, 0.02, 700.0, 0.1, 0.05
TUNING = BaselineTuning(
    noise=jnp.asarray(NOISE),
    error_sigma=jnp.asarray(ERROR),
    error_time_constant=jnp.asarray(TIME_CONSTANT),
    range_noise=jnp.asarray(RANGE_NOISE),
    range_bias_sigma=jnp.asarray(RANGE_BIAS),
)
BASELINE_SIGMAS = np.array([*3 * [0.3], *3 * [1e-3], *3 * [ERROR], RANGE_BIAS])
TRACK_SIGMAS = np.array([*3 * [0.5], *3 * [2e-3]])


class Team:
    """Two peers, from one of which there is no message or no GPS position, with random numbers everywhere."""

    def __init__(self, flight: FlightParams, used: list[bool], measured: list[bool]) -> None:
        rng = np.random.default_rng(2)
        self.used, self.measured = np.array(used), np.array(measured)
        orbit = rendezvous_scene.estimate(flight)
        P = random_covariance(rng, np.array([*3 * [0.4], *3 * [2e-3], 0.1, 0.05, 1e-3, 1e-3, 0.1, 0.1]))
        slow = {state.name: orbit.relative.slow[state.name] for state in VIEW_STATES}
        self.orbit = replace(orbit, relative=replace(orbit.relative, slow=slow, covariance=jnp.asarray(P)))
        self.x = np.stack([np.concatenate([30.0 * unit(rng.normal(size=3)), rng.normal(0.0, 0.01, 7)]) for _ in "ab"])
        self.P = np.stack([random_covariance(rng, BASELINE_SIGMAS) for _ in "ab"])
        self.own = 0.4 * self.P
        self.state = np.stack([np.concatenate([30.0 * unit(rng.normal(size=3)), 1e-2 * np.ones(3)]) for _ in "ab"])
        self.covariance = np.stack([random_covariance(rng, TRACK_SIGMAS) for _ in "ab"])
        self.correlated = np.array([0.3, 0.6])[:, None, None] * self.covariance
        self.interval = np.where(self.used, [20.0, 300.0], 0.0)
        self.burns = rng.normal(0.0, 0.01, (2, 6))
        self.burn_covariance = np.stack([random_covariance(rng, np.array([*3 * [0.01], *3 * [1e-4]])) for _ in "ab"])
        self.own_burns = rng.normal(0.0, 0.01, 6)
        r = rendezvous_scene.R_SN_N
        gradient = MU / np.linalg.norm(r) ** 3 * (3.0 * np.outer(unit(r), unit(r)) - np.eye(3))
        self.generator = np.block([[np.zeros((3, 3)), np.eye(3)], [gradient, np.zeros((3, 3))]])
        self.gps = self.x[:, :3] + rng.normal(0.0, 0.1, (2, 3))
        self.ranges = np.linalg.norm(self.x[:, :3], axis=1) + rng.normal(0.0, 0.1, 2)

    @property
    def received(self) -> ReceivedMessages:
        track = TargetTrack(state=self.state, covariance=self.covariance, correlated=self.correlated)
        unused = jnp.zeros(2)
        message = Message(
            time=unused, gps=None, burns=None, from_start=None, q_KN=None, attitude_variance=unused, track=track
        )
        forth, back = expm(DELAY * self.generator), expm(-DELAY * self.generator)
        received = ReceivedMessages(
            messages=message,
            used=self.used,
            interval=self.interval,
            burns=BurnEffect(change=self.burns, covariance=self.burn_covariance),
            attitude_variance=unused,
            baseline=self.gps,
            measured=self.measured,
            own=OwnThen(message=None, burns=self.own_burns, to_now=forth, to_stamp=back),
            tuning=None,
            ranges=self.ranges,
        )
        return jax.tree.map(jnp.asarray, received)

    @property
    def memory(self) -> EstimateSharing:
        local = self.orbit.relative
        none = jnp.stack([jnp.eye(6)] * 2)
        tracks = Tracks(
            estimates=SplitEstimate(mean=jnp.zeros((2, 6)), correlated=none, independent=none),
            of_own=none,
            known=jnp.zeros(2, dtype=bool),
        )
        baselines = Baselines(mean=jnp.asarray(self.x), covariance=jnp.asarray(self.P), of_own=jnp.asarray(self.own))
        return EstimateSharing(baselines=baselines, local=local, correlated=0.5 * local.covariance, tracks=tracks)

    def baseline(self, k: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Mean, covariance and own part of a baseline after GPS and range, all rows at once."""
        decay = np.exp(-self.interval[k] / TIME_CONSTANT)
        factors = np.array([*6 * [1.0], *3 * [decay], 1.0])
        slow = np.diag([*6 * [0.0], *3 * [ERROR**2 * (1.0 - decay**2)], 0.0])
        x, P = factors * self.x[k], factors[:, None] * self.P[k] * factors + slow
        own = factors[:, None] * self.own[k] * factors + 0.5 * slow
        if self.used[k]:
            x[:6] += self.burns[k]
            P[:6, :6] += self.burn_covariance[k]
        back = expm(-DELAY * self.generator)[:3]
        position = back @ (x[:6] + self.own_burns)
        distance = np.linalg.norm(position)
        u = position / distance
        at_stamp = back @ P[:6, :6] @ back.T
        excess = (np.trace(at_stamp) - u @ at_stamp @ u) / distance
        H = np.zeros((4, 10))
        H[:3, :6], H[:3, 6:9] = back, np.eye(3)
        H[3, :6], H[3, 9] = u @ back, 1.0
        z = np.array([*(self.gps[k] - position - x[6:9]), self.ranges[k] - distance - 0.5 * excess - x[9]])
        R = np.array([*3 * [NOISE**2], RANGE_NOISE**2 + 0.5 * excess**2])
        rows = np.array([*3 * [self.measured[k]], self.used[k]])
        H, z, R, of_receiver = H[rows], z[rows], R[rows], np.array([*3 * [0.5 * NOISE**2], 0.0])[rows]
        K = P @ H.T @ np.linalg.inv(H @ P @ H.T + np.diag(R))
        remaining = np.eye(10) - K @ H
        return x + K @ z, remaining @ P, remaining @ own @ remaining.T + K @ np.diag(of_receiver) @ K.T


def results(team: Team) -> tuple[EstimateSharing, RelativeEstimate, EstimateSharing, RelativeEstimate]:
    return _results(team.memory, team.orbit, team.received)


@jax.jit
def _results(
    memory: EstimateSharing, orbit: OrbitEstimate, received: ReceivedMessages
) -> tuple[EstimateSharing, RelativeEstimate, EstimateSharing, RelativeEstimate]:
    naive = replace(memory, local=None, correlated=None, tracks=None)
    return (
        *estimate_sharing.receive(TUNING, memory, received),
        *estimate_sharing.receive_naively(TUNING, naive, orbit.relative, received),
    )


def assert_close(found: jax.Array, expected: np.ndarray, covariance: np.ndarray) -> None:
    """Equal to a millionth of the standard deviations of a covariance, or of their products."""
    sigma = np.sqrt(np.diag(covariance))
    scale = sigma if expected.ndim == 1 else np.outer(sigma, sigma)
    np.testing.assert_allclose(np.asarray(found) / scale, expected / scale, atol=1e-5)


@pytest.mark.parametrize(
    ("used", "measured"), [([True, True], [True, False]), ([True, False], [True, False]), ([True, True], [True, True])]
)
def test_messages_update_baselines_and_tracks_as_dense_matrices_do(
    flight: FlightParams, monkeypatch: pytest.MonkeyPatch, used: list[bool], measured: list[bool]
) -> None:
    """With shares of one, split covariance intersection takes errors as independent."""
    monkeypatch.setattr(covariance_intersection, "best_shares", lambda *_: [jnp.ones(())] * 3)
    team = Team(flight, used, measured)
    memory, fused, naive_memory, naive = results(team)
    forth = expm(DELAY * team.generator)
    mean = np.concatenate([rendezvous_scene.TARGET_AHEAD, team.orbit.relative.v_TS_N, np.zeros(6)])
    P = np.asarray(team.orbit.relative.covariance)
    assert memory.tracks is not None
    for k in range(2):
        x, covariance, own = team.baseline(k)
        for baselines in (memory.baselines, naive_memory.baselines):
            assert_close(baselines.mean[k], x, team.P[k])
            assert_close(baselines.covariance[k], covariance, covariance)
            assert_close(baselines.of_own[k], own, covariance)
        if not used[k]:
            continue
        track, total = memory.tracks.estimates, forth @ team.covariance[k] @ forth.T + covariance[:6, :6]
        correlated = forth @ team.correlated[k] @ forth.T
        assert_close(track.mean[k], forth @ team.state[k] + x[:6], total)
        assert_close(track.correlated[k], correlated, total)
        assert_close(track.independent[k], total - correlated - own[:6, :6], total)
        assert_close(memory.tracks.of_own[k], own[:6, :6], total)
        K = P[:, :6] @ np.linalg.inv(P[:6, :6] + total)
        mean, P = mean + K @ (forth @ team.state[k] + x[:6] - mean[:6]), P - K @ P[:6]
    for found in (fused, naive):
        assert_close(found.vector, mean, P)
        assert_close(found.covariance, P, P)
    np.testing.assert_array_equal(memory.tracks.known, used)
