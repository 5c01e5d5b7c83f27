"""Relative orbit filter: update against the textbook, gate, truncated and false boxes."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import rendezvous_scene
from hypothesis import given
from numpy_reference import SEEDS, axis_angle_quaternion, random_covariance, random_unit, rotation_matrix, unit

from rpojax.core.pytree import replace
from rpojax.flight.flight_records import FlightParams
from rpojax.flight.navigation import outline_correlation, relative_orbit_ekf
from rpojax.flight.navigation.box_measurement import box_measurement_model, outlier_gate
from rpojax.flight.navigation.box_measurement.box_measurement_model import LinearisedBox
from rpojax.flight.navigation.box_measurement.outlier_gate import GateState
from rpojax.flight.navigation.orbit_measurements import BoxMeasurement, box_view
from rpojax.flight.navigation.relative_filter_state import RelativeEstimate
from rpojax.scenario.params import Params

TEXTBOOK = 1e-10  # conditioning of the joint innovation covariance times rounding


@jax.jit
def linearise_box(
    flight: FlightParams, q_KN: jax.Array, r_TS_N: jax.Array, box: BoxMeasurement, slow_scale: float = 0.0
) -> LinearisedBox:
    view = box_view(box, flight.vehicle.focal_px, q_KN)
    return box_measurement_model.linearise_box(flight.navigation, view, r_TS_N, slow_scale)


box_derivative = jax.jit(jax.jacfwd(lambda *arguments: linearise_box(*arguments).predicted, argnums=2))
update = jax.jit(relative_orbit_ekf.update, static_argnums=1)


@pytest.fixture(scope="module")
def known(flight: FlightParams) -> RelativeEstimate:
    """A target at 30 m known to 5 cm, two pixels of the bearing: little enough to accept a single box."""
    return rendezvous_scene.estimate(flight, position_sigma=0.05).relative


def seen(
    flight: FlightParams, q_KN: np.ndarray, r_TS_N: np.ndarray = rendezvous_scene.TARGET_AHEAD, **flags: bool
) -> BoxMeasurement:
    return rendezvous_scene.box(flight, rotation_matrix(q_KN), r_TS_N, **flags)


def take(
    flight: FlightParams,
    estimate: RelativeEstimate,
    q_KN: np.ndarray,
    box: BoxMeasurement,
    track: GateState | None = None,
    gated: bool = True,
) -> tuple[RelativeEstimate, GateState, bool]:
    after, memory, innovation, _ = update(
        flight.navigation,
        gated,
        estimate,
        outlier_gate.initial() if track is None else track,
        box_view(box, flight.vehicle.focal_px, jnp.asarray(q_KN)),
    )
    return after, memory, bool(innovation.accepted)


def moved(box: BoxMeasurement, pixels: float, focal_px: jax.Array) -> BoxMeasurement:
    return replace(box, tangent=box.tangent + jnp.array([pixels, 0.0]) / focal_px)


@pytest.mark.parametrize(("fraction", "used"), [(0.99, True), (1.01, False)])
@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("truncated", [False, True])
def test_the_gate_is_at_the_sigma_of_the_expected_box(
    flight: FlightParams, q_KN: np.ndarray, fraction: float, used: bool, axis: int, truncated: bool
) -> None:
    # Off the boresight, so that the frame may cut the outline.
    place = rendezvous_scene.TARGET_AHEAD + rotation_matrix(q_KN).T @ np.array([2.3, 0.0, 0.0])
    estimate = rendezvous_scene.estimate(flight, place, position_sigma=0.05).relative
    shown = {"bearing_bias": jnp.array([3e-3, -2e-3]), "center_offset": jnp.array([0.1, 0.2])}
    estimate = replace(estimate, slow={**estimate.slow, **shown})
    box = seen(flight, q_KN, place, truncated=truncated)
    memory = outlier_gate.initial()
    arguments = (flight.navigation, True, estimate, memory)
    expected = update(*arguments, box_view(box, flight.vehicle.focal_px, jnp.asarray(q_KN)))[3]
    offset = fraction * flight.navigation.gate_sigma * jnp.sqrt(expected.variance[axis]) * jnp.eye(2)[axis]
    tried = replace(box, tangent=expected.values[:2] + offset, log_size=expected.values[2])
    assert bool(expected.in_front)
    assert bool(update(*arguments, box_view(tried, flight.vehicle.focal_px, jnp.asarray(q_KN)))[2].accepted) == used


def assert_same(found: RelativeEstimate, expected: RelativeEstimate) -> None:
    jax.tree.map(np.testing.assert_array_equal, found, expected)


@given(SEEDS)
def test_the_update_of_all_states_agrees_with_the_textbook(params: Params, seed: int) -> None:
    rng = np.random.default_rng(seed)
    flight = params.flight
    sigma = np.concatenate(
        [np.full(3, 0.04), np.full(3, 0.01), [0.065, 0.14], [5e-4, 5e-4], [5e-3, 5e-3], [0.015, 0.01, 0.01, 0.005]]
    )
    q_KN = random_unit(rng, 4)
    R_KN = rotation_matrix(q_KN)
    r_TS_N = R_KN.T @ (rng.uniform(20.0, 60.0) * unit(np.array([*rng.uniform(-0.05, 0.05, 2), 1.0])))
    v_TS_N, scale, bias = 0.02 * rng.normal(size=3), 0.1 * rng.normal(size=2), 5e-4 * rng.normal(size=2)
    center = 5e-3 * rng.normal(size=2)
    P = random_covariance(rng, sigma)
    before = RelativeEstimate(
        r_TS_N=r_TS_N,
        v_TS_N=v_TS_N,
        slow={
            "size": scale,
            "bearing_bias": bias,
            "center_offset": center,
            "burn_scale": np.array([0.01]),
            "thrust_direction": np.zeros(2),
            "ballistic": np.zeros(1),
        },
        covariance=P,
        outline=outline_correlation.initial(),
    )
    before = jax.tree.map(jnp.asarray, before)
    depth = (R_KN @ r_TS_N)[2]
    ideal = rendezvous_scene.box(flight, R_KN, r_TS_N)
    residual = rng.normal(size=3) * [1e-3, 1e-3, 0.05]
    box = replace(
        ideal,
        tangent=ideal.tangent + bias + center / depth + residual[:2],
        log_size=ideal.log_size + float(np.sum(scale)) + residual[2],
    )
    after, _, innovation, _ = update(
        flight.navigation,
        True,
        before,
        outlier_gate.initial(),
        box_view(box, flight.vehicle.focal_px, jnp.asarray(q_KN)),
    )
    assert innovation.accepted
    # Boxes do not measure the last four states: errors of burns, and what pushes the two apart.
    H = np.zeros((3, 16))
    H[:, :3] = box_derivative(flight, q_KN, r_TS_N, box)
    # In the direction in which the target appears.
    H[:2, :3] -= bias[:, None] * R_KN[2] / depth
    H[2, 6:8] = 1.0
    H[0, 8] = H[1, 9] = 1.0
    H[0, 10] = H[1, 11] = 1.0 / depth
    expected = linearise_box(flight, q_KN, r_TS_N, box, scale[0])
    R = np.diag(np.asarray(expected.variance))
    S = H @ P @ H.T + R
    K = np.linalg.solve(S, H @ P).T
    x = K @ residual
    np.testing.assert_allclose(after.vector - before.vector, x, atol=TEXTBOOK * np.max(np.abs(x)))
    for name, part in {
        "size": x[6:8],
        "bearing_bias": x[8:10],
        "center_offset": x[10:12],
        "burn_scale": x[12:13],
        "thrust_direction": x[13:15],
        "ballistic": x[15:],
    }.items():
        change = after.slow[name] - before.slow[name]
        np.testing.assert_allclose(change, part, atol=TEXTBOOK * np.max(np.abs(x)), err_msg=name)
    units = np.outer(sigma, sigma)
    np.testing.assert_allclose(np.asarray(after.covariance) / units, (P - K @ S @ K.T) / units, atol=TEXTBOOK)
    np.testing.assert_allclose(innovation.innovation[0], residual[0], atol=1e-12)
    np.testing.assert_allclose(innovation.variance[0], S[0, 0], rtol=1e-9)


def test_a_wide_prior_is_linearised_along_the_measured_direction(flight: FlightParams, q_KN: np.ndarray) -> None:
    wide = rendezvous_scene.estimate(flight, position_sigma=5.0).relative
    angle = np.deg2rad(4.0)
    R_KN = rotation_matrix(q_KN)
    line = R_KN.T @ np.array([np.sin(angle), 0.0, np.cos(angle)])
    box = seen(flight, q_KN, 30.0 * line)
    after, _, used = take(flight, wide, q_KN, box, gated=False)
    assert used
    variances, axes = np.linalg.eigh(np.asarray(after.covariance)[:3, :3])
    across = np.arccos(min(abs(axes[:, 2] @ unit(np.asarray(after.r_TS_N))), 1.0))
    # Linearised at the prior, the long axis would stay 4 deg off.
    assert np.rad2deg(across) < 0.4
    assert variances[1] < 0.2**2
    assert variances[2] > 2.0**2
    found = R_KN @ np.asarray(after.r_TS_N)
    np.testing.assert_allclose(found[:2] / found[2], box.tangent, atol=5e-4)


def test_a_good_box_is_accepted_and_corrects_the_estimate(
    flight: FlightParams, known: RelativeEstimate, q_KN: np.ndarray
) -> None:
    box = moved(seen(flight, q_KN), 3.0, flight.vehicle.focal_px)
    after, track, used = take(flight, known, q_KN, box)
    assert used
    shift = rotation_matrix(q_KN) @ np.asarray(after.r_TS_N - known.r_TS_N)
    assert 0.02 < shift[0] < 3.0 / 731.0 * 30.0
    assert track.rejections == 0.0


@pytest.mark.parametrize("fault", ["bearing", "size"])
def test_an_outlier_is_rejected_and_changes_only_the_gate(
    flight: FlightParams, known: RelativeEstimate, q_KN: np.ndarray, fault: str
) -> None:
    box = seen(flight, q_KN)
    outlier = moved(box, 40.0, flight.vehicle.focal_px)
    if fault == "size":
        outlier = replace(box, log_size=box.log_size + 1.2)
    after, track, used = take(flight, known, q_KN, outlier)
    assert not used
    assert_same(after, known)
    # Alone it says nothing against the estimate.
    assert track.rejections == 0.0
    assert track.clutter > outlier_gate.initial().clutter


def test_without_the_gate_an_outlier_is_used(flight: FlightParams, known: RelativeEstimate, q_KN: np.ndarray) -> None:
    outlier = moved(seen(flight, q_KN), 40.0, flight.vehicle.focal_px)
    after, _, used = take(flight, known, q_KN, outlier, gated=False)
    assert used
    assert np.linalg.norm(after.r_TS_N - known.r_TS_N) > 0.1


@pytest.mark.parametrize("gated", [True, False])
def test_a_frame_without_a_box_changes_nothing(
    flight: FlightParams, known: RelativeEstimate, q_KN: np.ndarray, gated: bool
) -> None:
    after, track, used = take(flight, known, q_KN, seen(flight, q_KN, present=False), gated=gated)
    assert not used
    assert_same(after, known)
    assert track.rejections == 0.0


def rotated(q_KN: np.ndarray, degrees: float, axis: tuple[float, float, float] = (0.0, 1.0, 0.0)) -> np.ndarray:
    """Camera attitude rotated about one of its own axes by an angle [deg]."""
    found = rendezvous_scene.quaternion.multiply(
        jnp.asarray(axis_angle_quaternion(np.array(axis), np.deg2rad(degrees))), jnp.asarray(q_KN)
    )
    return np.asarray(found)


def test_a_truncated_box_updates_bearing_but_not_size(
    flight: FlightParams, known: RelativeEstimate, q_KN: np.ndarray
) -> None:
    aside = rotated(q_KN, 4.5)  # half a degree inside of the frame, with a target of 2 deg
    box = seen(flight, aside, truncated=True)
    wrong_size = replace(box, log_size=box.log_size - 1.0)
    after, _, used = take(flight, known, aside, wrong_size)
    assert used
    line = unit(rendezvous_scene.TARGET_AHEAD)
    before = line @ np.asarray(known.covariance)[:3, :3] @ line
    np.testing.assert_allclose(line @ np.asarray(after.covariance)[:3, :3] @ line, before, rtol=1e-9)
    np.testing.assert_array_equal(after.slow["size"], known.slow["size"])
    np.testing.assert_allclose(after.r_TS_N, known.r_TS_N, atol=1e-12)


@pytest.mark.parametrize(("fraction", "accepted"), [(0.99, True), (1.01, False)])
def test_a_single_box_is_accepted_up_to_three_box_sigmas_of_prior_uncertainty(
    flight: FlightParams, q_KN: np.ndarray, fraction: float, accepted: bool
) -> None:
    box = seen(flight, q_KN)
    noise = float(linearise_box(flight, q_KN, rendezvous_scene.TARGET_AHEAD, box).variance[0])
    # Bearing bias and offset of the box centre are part of the uncertainty.
    border = 30.0 * np.sqrt(3.0**2 * noise - np.deg2rad(0.03) ** 2 - (0.005 / 30.0) ** 2)
    _, _, used = take(flight, rendezvous_scene.estimate(flight, position_sigma=fraction * border).relative, q_KN, box)
    assert used is accepted


def test_a_wide_prior_needs_confirmation_by_a_second_box(flight: FlightParams, q_KN: np.ndarray) -> None:
    wide = rendezvous_scene.estimate(flight, position_sigma=3.0).relative
    first = moved(seen(flight, q_KN), 10.0, flight.vehicle.focal_px)
    after, track, used = take(flight, wide, q_KN, first)
    assert not used
    assert_same(after, wide)
    _, _, confirmed = take(flight, after, q_KN, moved(first, 3.0, flight.vehicle.focal_px), track)
    assert confirmed
    _, _, elsewhere = take(flight, after, q_KN, moved(first, -30.0, flight.vehicle.focal_px), track)
    assert not elsewhere


def test_confirmation_is_by_inertial_direction(flight: FlightParams, q_KN: np.ndarray) -> None:
    wide = rendezvous_scene.estimate(flight, position_sigma=3.0).relative
    _, track, _ = take(flight, wide, q_KN, seen(flight, q_KN))
    R_turned = rotation_matrix(axis_angle_quaternion([0.0, 1.0, 0.0], np.deg2rad(2.0))) @ rotation_matrix(q_KN)
    q_turned = np.asarray(rendezvous_scene.quaternion.from_matrix(jnp.asarray(R_turned)))
    same_place = rendezvous_scene.box(flight, R_turned, rendezvous_scene.TARGET_AHEAD)
    _, _, same_target = take(flight, wide, q_turned, same_place, track)
    assert same_target
    _, _, same_pixel = take(flight, wide, q_turned, seen(flight, q_KN), track)
    assert not same_pixel


def test_a_target_predicted_behind_the_camera_accepts_no_box(
    flight: FlightParams, known: RelativeEstimate, q_KN: np.ndarray
) -> None:
    backwards = np.asarray(rendezvous_scene.quaternion.multiply(jnp.array([0.0, 1.0, 0.0, 0.0]), jnp.asarray(q_KN)))
    _, _, used = take(flight, known, backwards, seen(flight, q_KN))
    assert not used


def test_repeated_rejections_inflate_the_covariance_until_the_target_is_accepted(
    flight: FlightParams, known: RelativeEstimate, q_KN: np.ndarray
) -> None:
    lost = rendezvous_scene.TARGET_AHEAD + rotation_matrix(q_KN).T @ np.array(
        [1.5, 0.0, 0.0]
    )  # 50 sigma of a box away, still in view
    certain = replace(known, covariance=known.covariance * 0.01)
    truth = seen(flight, q_KN, lost)
    estimate, track = certain, outlier_gate.initial()
    before = np.asarray(certain.covariance)
    for rejection in range(1, 8):
        estimate, track, used = take(flight, estimate, q_KN, truth, track)
        assert not used
        grown = np.diag(np.asarray(estimate.covariance) - before)
        expected = [0.0] * 16 if rejection < 7 else [(0.03 * 30.0) ** 2] * 3 + [0.005**2] * 3 + [0.0] * 10
        np.testing.assert_allclose(grown, expected, rtol=1e-9, atol=1e-15)
    assert track.rejections == 0.0
    estimate, track, used = take(flight, estimate, q_KN, truth, track)
    assert used
    off = rotation_matrix(q_KN) @ (np.asarray(estimate.r_TS_N) - lost)
    assert np.max(np.abs(off[:2])) < 0.1


@pytest.mark.parametrize(
    ("sigma", "degrees", "possible"), [(0.05, 0.0, False), (0.05, 4.5, True), (0.05, -4.5, True), (1.0, 0.0, True)]
)
def test_a_truncated_box_is_possible_only_near_the_edge_of_the_frame(
    flight: FlightParams, q_KN: np.ndarray, sigma: float, degrees: float, possible: bool
) -> None:
    known = rendezvous_scene.estimate(flight, position_sigma=sigma).relative
    for axis in ((0.0, 1.0, 0.0), (1.0, 0.0, 0.0)):  # sideways, up and down
        aside = rotated(q_KN, degrees, axis)
        box = seen(flight, aside, truncated=True)
        _, _, used = take(flight, known, aside, box, rendezvous_scene.gate_after_a_box())
        assert used is possible
        # The same box is possible if not truncated.
        _, _, whole = take(flight, known, aside, seen(flight, aside), rendezvous_scene.gate_after_a_box())
        assert whole


def test_a_truncated_box_larger_than_the_target_is_rejected(
    flight: FlightParams, known: RelativeEstimate, q_KN: np.ndarray
) -> None:
    aside = rotated(q_KN, 4.5)
    box = seen(flight, aside, truncated=True)
    model = linearise_box(flight, aside, rendezvous_scene.TARGET_AHEAD, box)
    # The size's own noise, the target's two size errors, and the range.
    sigma = np.sqrt(model.variance[2] + 0.065**2 + 0.14**2 + (0.05 / 30.0) ** 2)
    for sigmas, accepted in ((3.9, True), (4.1, False), (-9.0, True)):
        _, _, used = take(flight, known, aside, replace(box, log_size=box.log_size + sigmas * sigma))
        assert used is accepted, sigmas


def test_a_wide_prior_needs_confirmation_of_a_truncated_box(flight: FlightParams, q_KN: np.ndarray) -> None:
    wide = rendezvous_scene.estimate(flight, position_sigma=1.5).relative
    # A false box as large as half the frame is as uncertain as the prior itself, which must not make the prior look
    # certain enough.
    large = seen(flight, q_KN, truncated=True)
    false = replace(moved(large, 40.0, flight.vehicle.focal_px), side_px=jnp.float64(60.0))
    after, track, used = take(flight, wide, q_KN, false)
    assert not used
    assert_same(after, wide)
    _, _, elsewhere = take(flight, wide, q_KN, moved(false, -80.0, flight.vehicle.focal_px), track)
    assert not elsewhere
    _, _, confirmed = take(flight, wide, q_KN, false, track)
    assert confirmed


def test_isolated_false_boxes_never_change_the_estimate(
    flight: FlightParams, known: RelativeEstimate, q_KN: np.ndarray
) -> None:
    false = moved(seen(flight, q_KN), 45.0, flight.vehicle.focal_px)
    none = seen(flight, q_KN, present=False)
    estimate, track = known, outlier_gate.initial()
    for frame in range(200):
        estimate, track, used = take(flight, estimate, q_KN, none if frame % 20 else false, track)
        assert not used
    assert_same(estimate, known)


@given(SEEDS)
def test_attitude_drift_adds_to_the_variance_of_the_bearing_bias_alone(params: Params, seed: int) -> None:
    rng = np.random.default_rng(seed)
    flight = params.flight
    sigma = np.concatenate(
        [np.full(3, 0.04), np.full(3, 0.01), [0.065, 0.14], [5e-4, 5e-4], [5e-3, 5e-3], [0.015, 0.01, 0.01, 0.005]]
    )
    before = replace(rendezvous_scene.estimate(flight).relative, covariance=random_covariance(rng, sigma))
    drift = rng.uniform(0.1, 2.0) * 1e-6
    absent = replace(
        rendezvous_scene.box(flight, np.eye(3), np.array([0.0, 0.0, 30.0]), present=False),
        attitude_variance_change=jnp.float64(drift),
    )
    after, _, _ = take(flight, before, random_unit(rng, 4), absent)
    grown = np.asarray(after.covariance) - np.asarray(before.covariance)
    np.testing.assert_allclose(grown, np.diag(before.layout.vector(bearing_bias=jnp.full(2, drift))), atol=1e-21)


def test_under_attitude_drift_a_box_corrects_the_bearing_bias(
    flight: FlightParams, known: RelativeEstimate, q_KN: np.ndarray
) -> None:
    box = moved(seen(flight, q_KN), 3.0, flight.vehicle.focal_px)
    drifted = replace(box, attitude_variance_change=jnp.float64(0.01**2))
    steady, _, _ = take(flight, known, q_KN, box, rendezvous_scene.gate_after_a_box())
    drifting, _, used = take(flight, known, q_KN, drifted, rendezvous_scene.gate_after_a_box())
    assert used
    assert np.linalg.norm(drifting.r_TS_N - known.r_TS_N) < 0.1 * np.linalg.norm(steady.r_TS_N - known.r_TS_N)
    np.testing.assert_allclose(drifting.slow["bearing_bias"][0], box.tangent[0], rtol=0.1)


def test_a_bias_that_becomes_known_does_not_measure_the_range(flight: FlightParams) -> None:
    # A camera that rolls about the line of sight tells its mounting from the target's place, and nothing of the range.
    # Linearised in the direction of the estimated place, which moves as the bias becomes known, it would seem to.
    place, focal_px, frames = np.array([0.0, 0.0, 1850.0]), jnp.asarray(3e4), 300
    tuning = replace(flight.navigation, attitude_sigma=jnp.asarray(3e-5), bearing_bias_sigma=jnp.asarray(1.7e-3))
    before = rendezvous_scene.estimate(replace(flight, navigation=tuning), place, np.zeros(3), 15.0, 1e-6).relative
    before = replace(before, covariance=before.covariance.at[jnp.array([0, 1]), jnp.array([0, 1])].set(3.0**2))
    box = rendezvous_scene.box(flight, np.eye(3), place)
    bias, noise = jnp.array([2e-3, -1e-3]), 4e-5 * np.random.default_rng(4).normal(size=(frames, 2))
    rolls = np.linspace(0.0, 0.5 * np.pi, frames)
    attitudes = np.stack([axis_angle_quaternion(np.array([0.0, 0.0, 1.0]), roll) for roll in rolls])

    def take_one(estimate: RelativeEstimate, frame: tuple[jax.Array, jax.Array]) -> tuple[RelativeEstimate, None]:
        view = box_view(replace(box, tangent=box.tangent + bias + frame[1]), focal_px, frame[0])
        return relative_orbit_ekf.update(tuning, False, estimate, outlier_gate.initial(), view)[0], None

    after = jax.lax.scan(take_one, before, (jnp.asarray(attitudes), jnp.asarray(noise)))[0]
    sigma = np.sqrt(np.diag(after.covariance))
    np.testing.assert_allclose(after.slow["bearing_bias"], bias, atol=3e-5)
    np.testing.assert_allclose(after.r_TS_N[:2], place[:2], atol=0.05)
    # 14.4 m: nearly as before. About the estimated place it would be 11.5 m.
    assert 14.3 < sigma[2] <= 15.0
    assert abs(float(after.r_TS_N[2]) - 1850.0) < 3.0
