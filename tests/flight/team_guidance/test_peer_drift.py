"""Free drifts relative to other servicers, against both propagated step by step; burns that keep clear of them."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import rendezvous_scene

from rpojax.core.frames import hill_frame, hill_to_inertial
from rpojax.core.orbits import yamanaka_ankersen
from rpojax.core.pytree import replace
from rpojax.flight.flight_records import FlightParams
from rpojax.flight.mission import safe_burn
from rpojax.flight.mission.drift_clearance import Drift, orbit_period
from rpojax.flight.team_guidance import peer_drift
from rpojax.flight.team_guidance.intent import Intent
from rpojax.flight.team_guidance.peer_drift import NextBurn, PeerDrifts
from rpojax.flight.team_guidance.team_knowledge import KnownPeers

LEAD = 60.0
OWN = np.array([0.0, 36.0, 22.0, 0.01992, 0.0, 0.0])
PEER = np.array([-18.0, 0.0, 0.0, 0.0, 0.03984, 0.02435])
KEEP_OUT = 12.0


to_inertial = jax.jit(hill_to_inertial)
relative_motion = jax.jit(peer_drift.relative_motion)
safe_delta_v_among = jax.jit(safe_burn.safe_delta_v_among)
advanced = jax.jit(yamanaka_ankersen.advanced)
transition_matrix = jax.jit(yamanaka_ankersen.transition_matrix)

transition_matrices = jax.jit(jax.vmap(yamanaka_ankersen.transition_matrix, in_axes=(None, 0)))


@pytest.fixture(scope="module")
def scene(flight: FlightParams) -> Any:
    """Target's orbit, its Hill frame, and the estimate of a servicer at `OWN`."""
    estimate = rendezvous_scene.estimate(flight)
    r_TN_N = estimate.servicer.r_SN_N + estimate.relative.r_TS_N
    v_TN_N = estimate.servicer.v_SN_N + estimate.relative.v_TS_N
    R_HN, omega_HN_N = jax.jit(hill_frame)(r_TN_N, v_TN_N)
    r_ST_N, v_ST_N = to_inertial(OWN[:3], OWN[3:], R_HN, omega_HN_N)
    servicer = replace(estimate.servicer, r_SN_N=r_TN_N + r_ST_N, v_SN_N=v_TN_N + v_ST_N)
    relative = replace(estimate.relative, r_TS_N=-r_ST_N, v_TS_N=-v_ST_N)
    estimate = replace(estimate, servicer=servicer, relative=relative)
    return estimate, jax.jit(yamanaka_ankersen.target_orbit)(r_TN_N, v_TN_N), R_HN, omega_HN_N


def known(scene: Any, delta_v_H: np.ndarray, burn_time: float) -> KnownPeers:
    """A peer at `PEER`, which has announced a burn."""
    _, _, R_HN, omega_HN_N = scene
    r_N, v_N = to_inertial(PEER[:3] - OWN[:3], PEER[3:] - OWN[3:], R_HN, omega_HN_N)
    # The axes of H at the burn are those of now turned with the orbit.
    R_HN, omega_HN_N = np.asarray(R_HN), np.asarray(omega_HN_N)
    angle = omega_HN_N @ R_HN[2] * burn_time
    turned = np.array([[np.cos(angle), np.sin(angle), 0.0], [-np.sin(angle), np.cos(angle), 0.0], [0.0, 0.0, 1.0]])
    intents = Intent(
        time=jnp.zeros(1),
        follows=jnp.ones(1, dtype=bool),
        delta_v_N=jnp.asarray((turned @ R_HN).T @ delta_v_H)[None],
        burn_time=jnp.array([burn_time]),
        shift=jnp.zeros(1),
        sees=jnp.ones(1, dtype=bool),
    )
    return KnownPeers(
        state_N=jax.device_put(np.concatenate([r_N, v_N])[None]),
        covariance_N=jax.device_put(1e-4 * np.eye(6)[None]),
        intents=intents,
        numbers=jnp.array([1], dtype=jnp.int32),
        number=jnp.int32(0),
        slots=jnp.zeros((1, 2)),
    )


def at_burn(scene: Any, peers: KnownPeers) -> tuple[np.ndarray, np.ndarray]:
    """State and covariance of the servicer from its peer at its burn."""
    estimate, orbit, R_HN, omega_HN_N = scene
    burn_orbit = advanced(orbit, jnp.float64(LEAD))
    R_HN, omega_HN_N = np.asarray(R_HN), np.asarray(omega_HN_N)
    c, s = np.cos(LEAD * omega_HN_N @ R_HN[2]), np.sin(LEAD * omega_HN_N @ R_HN[2])
    R_CN = np.stack([c * R_HN[0] + s * R_HN[1], -s * R_HN[0] + c * R_HN[1], R_HN[2]])
    state, covariance = relative_motion(
        estimate,
        peers,
        NextBurn(orbit=burn_orbit, R_CN=R_CN, time=jnp.float64(0.0), lead=jnp.float64(LEAD)),
        jnp.float64(0.02),
    )
    return np.asarray(state)[0], np.asarray(covariance)[0]


@pytest.mark.parametrize("burn_time", [20.0, 100.0], ids=["before the own burn", "after it"])
def test_the_relative_motion_at_a_burn_is_that_of_both_with_the_announced_burn(scene: Any, burn_time: float) -> None:
    orbit = scene[1]
    delta_v_H = np.array([2e-3, 6e-3, -4e-3])

    def moved(state: np.ndarray, begin: float, end: float) -> np.ndarray:
        place = advanced(orbit, jnp.float64(begin))
        return np.asarray(transition_matrix(place, jnp.float64(end - begin))) @ state

    found, covariance = at_burn(scene, known(scene, delta_v_H, burn_time))
    end = 300.0
    peer = moved(PEER, 0.0, burn_time) + np.concatenate([np.zeros(3), delta_v_H])
    expected = moved(OWN, 0.0, end) - moved(peer, burn_time, end)
    # R_CN and the turned axes are those of a circular orbit: 1e-6 of the burn.
    np.testing.assert_allclose(moved(found, LEAD, end), expected, rtol=0.0, atol=1e-4)
    execution = (0.02 * np.linalg.norm(delta_v_H)) ** 2
    np.testing.assert_allclose(np.diag(covariance)[3:].sum(), 3e-4 + 3.0 * execution, rtol=1e-2)


def drifts(state_H: np.ndarray, orbit: Any) -> PeerDrifts:
    """One drift relative to a peer."""
    return PeerDrifts(
        state_H=jax.device_put(state_H[None]),
        covariance_H=jax.device_put(1e-10 * np.eye(6)[None]),
        orbit=orbit,
        sigmas=jnp.float64(3.0),
        radius=jnp.float64(KEEP_OUT),
        first_span=orbit_period(orbit),
        horizon=jnp.float64(86400.0),
    )


def burn(scene: Any, own: np.ndarray, peer: np.ndarray, planned: np.ndarray) -> safe_burn.SafeBurn:
    """Burn of a servicer at `own` beside one at `peer`, and far from the target's keep-out zone."""
    orbit = scene[1]
    from_target = Drift(
        orbit=orbit,
        state_H=jnp.asarray(own),
        scale_sigma=jnp.float64(0.0),
        covariance_H=jax.device_put(1e-10 * np.eye(6)),
        sigmas=jnp.float64(3.0),
        semi_axes=jax.device_put(np.ones(3)),
        first_span=orbit_period(orbit),
        horizon=jnp.float64(86400.0),
    )
    relative = drifts(own - peer, orbit)
    others = jax.tree_util.Partial(peer_drift.least_clearance, relative)
    return safe_delta_v_among(from_target, others, planned, 0.04, True)


def least_distance(scene: Any, relative: np.ndarray) -> float:
    """Least distance of a relative drift in a day, sampled every 20 s."""
    orbit = scene[1]
    matrices = transition_matrices(orbit, np.arange(20.0, 86400.0, 20.0))
    return float(np.linalg.norm(np.asarray(matrices)[:, :3] @ relative, axis=1).min())


def test_a_burn_towards_the_drift_of_another_servicer_is_changed(scene: Any) -> None:
    # Onto the other one's relative orbit, at its place but for 3 m.
    state = np.array([-18.0, 3.0, 0.0, 0.0, 0.03984, 0.02435])
    own = OWN
    matrix = np.asarray(transition_matrix(scene[1], jnp.float64(1500.0)))
    meeting = np.linalg.solve(matrix[:3, 3:], (matrix @ state)[:3] - matrix[:3, :3] @ own[:3])
    planned = meeting - own[3:]
    peer = np.array([-18.0, 0.0, 0.0, 0.0, 0.03984, 0.02435])
    after = own - peer + np.concatenate([np.zeros(3), planned])
    assert least_distance(scene, after) < 6.0
    found = burn(scene, own, peer, planned)
    assert int(found.changed_for) == 0
    after = own - peer + np.concatenate([np.zeros(3), np.asarray(found.delta_v_H)])
    assert least_distance(scene, after) >= KEEP_OUT


def test_a_burn_that_leads_to_nobody_is_that_of_a_servicer_alone(scene: Any) -> None:
    planned = np.array([0.0, 1e-4, 1e-3])
    found = burn(scene, OWN, PEER, planned)
    np.testing.assert_array_equal(found.delta_v_H, planned)
    assert int(found.changed_for) == -1
