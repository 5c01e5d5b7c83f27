"""Outlier gate: decision, confirmation and count of rejections."""

import dataclasses
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy_reference import IDENTITY, axis_angle_quaternion, unit

from rpojax.core.pytree import replace
from rpojax.flight.navigation.box_measurement import outlier_gate
from rpojax.flight.navigation.box_measurement.box_measurement_model import PriorBox
from rpojax.flight.navigation.box_measurement.outlier_gate import GateDecision, GateState
from rpojax.flight.navigation.orbit_filter_tuning import OrbitFilterTuning
from rpojax.flight.navigation.orbit_measurements import BoxMeasurement, box_view
from rpojax.scenario.params import Params

FOCAL = 64.0 / np.tan(np.radians(5.0))
"""Focal length of the packaged camera [px]."""
YES, NO = jnp.asarray(True), jnp.asarray(False)
VARIANCE = np.full(3, 4e-4)


def prior_of(residual: jax.Array, variance: jax.Array, wide: jax.Array) -> PriorBox:
    """Prior with all that the gate looks at."""
    others = dict.fromkeys((each.name for each in dataclasses.fields(PriorBox)), jnp.full((), jnp.nan))
    return PriorBox(**others | {"residual": residual, "innovation_variance": variance, "is_wide": wide})


@jax.jit
def accept(
    tuning: OrbitFilterTuning,
    state: GateState,
    box: BoxMeasurement,
    residual: jax.Array,
    variance: jax.Array,
    wide: jax.Array,
    possible: jax.Array,
) -> GateDecision:
    """Decision on a box of a camera with its axes along those of N."""
    view = box_view(box, jnp.asarray(FOCAL), jnp.asarray(IDENTITY))
    return outlier_gate.accept(tuning, view, state, prior_of(residual, variance, wide), possible)


@jax.jit
def update(
    tuning: OrbitFilterTuning,
    state: GateState,
    q_KN: jax.Array,
    box: BoxMeasurement,
    rejected: jax.Array,
    confirmed: jax.Array,
) -> tuple[GateState, jax.Array]:
    confirmed = box.present & confirmed
    decision = GateDecision(
        accepted=box.present & ~rejected, weight=jnp.zeros(()), confirmed=confirmed, supported=confirmed
    )
    return outlier_gate.update(tuning, box_view(box, jnp.asarray(FOCAL), q_KN), state, decision)


to_residual = jax.jit(jax.grad(lambda *arguments: accept(*arguments).weight, argnums=3))


@pytest.fixture(scope="module")
def tuning(params: Params) -> OrbitFilterTuning:
    return params.flight.navigation


def box(
    x: float = 0.0, y: float = 0.0, present: jax.Array = YES, truncated: jax.Array = NO, interval: float = 1.0
) -> BoxMeasurement:
    return BoxMeasurement(
        tangent=jnp.array([x, y]),
        log_size=jnp.float64(-3.0),
        log_aspect=jnp.zeros(()),
        side_px=jnp.float64(32.0),
        present=present,
        expected=YES,
        truncated=truncated,
        half_frame_tangent=jnp.full(2, 0.0875),
        attitude_variance_change=jnp.zeros(()),
        interval=jnp.float64(interval),
    )


def remembered(*boxes: dict[str, Any], clutter: float = 0.05) -> GateState:
    """Memory of boxes, the latest first, with changes to one straight ahead a second ago."""
    directions = [each.get("direction", np.array([0.0, 0.0, 1.0])) for each in boxes]
    state, count = outlier_gate.initial(), len(boxes)
    return replace(
        state,
        direction_N=state.direction_N.at[:, :count].set(np.stack(directions, axis=1)),
        log_size=state.log_size.at[:count].set([each.get("log_size", -3.0) for each in boxes]),
        truncated=state.truncated.at[:count].set([bool(each.get("truncated", False)) for each in boxes]),
        age=state.age.at[:count].set([each.get("age", 1.0) for each in boxes]),
        clutter=jnp.float64(clutter),
    )


ELSEWHERE = {"direction": unit(np.array([0.05, 0.05, 1.0]))}


def decide(
    tuning: OrbitFilterTuning,
    sigmas: list[float],
    state: GateState | None = None,
    measured: BoxMeasurement | None = None,
    wide: jax.Array = NO,
    possible: jax.Array = YES,
) -> bool:
    """Decision on a box with residuals in sigmas of the innovation variance."""
    decision = accept(
        tuning,
        outlier_gate.initial() if state is None else state,
        box() if measured is None else measured,
        np.array(sigmas) * np.sqrt(VARIANCE),
        VARIANCE,
        wide,
        possible,
    )
    assert float(decision.weight) == float(decision.accepted)
    return bool(decision.accepted)


@pytest.mark.parametrize("row", range(3))
def test_the_gate_is_at_four_sigma_of_bearing_and_size(tuning: OrbitFilterTuning, row: int) -> None:
    inside, outside = np.zeros(3), np.zeros(3)
    inside[row], outside[row] = -3.99, 4.01
    assert decide(tuning, list(inside))
    assert not decide(tuning, list(outside))


def test_a_truncated_box_may_be_smaller_but_not_larger_than_predicted(tuning: OrbitFilterTuning) -> None:
    cut = box(truncated=YES)
    assert decide(tuning, [1.0, 1.0, -9.0], measured=cut)
    assert decide(tuning, [1.0, 1.0, 3.99], measured=cut)
    assert not decide(tuning, [1.0, 1.0, 4.01], measured=cut)
    assert not decide(tuning, [5.0, 1.0, 0.0], measured=cut)


def test_absent_and_impossible_boxes_are_never_accepted(tuning: OrbitFilterTuning) -> None:
    assert not decide(tuning, [0.0, 0.0, 0.0], measured=box(present=NO))
    assert not decide(tuning, [0.0, 0.0, 0.0], possible=NO)


def test_an_unconfirmed_box_is_accepted_only_if_the_prior_is_not_wide(tuning: OrbitFilterTuning) -> None:
    assert decide(tuning, [0.0, 0.0, 0.0], wide=NO)
    assert not decide(tuning, [0.0, 0.0, 0.0], wide=YES)


@pytest.mark.parametrize(
    ("pixels", "age", "interval", "accepted"),
    [
        *[(4.9, 1.0, 1.0, True), (5.1, 1.0, 1.0, False), (9.9, 2.0, 1.0, True), (10.1, 2.0, 1.0, False)],
        *[(0.0, 3.0, 1.0, True), (0.0, 4.0, 1.0, False), (4.9, 0.2, 0.2, True), (5.1, 0.2, 0.2, False)],
        *[(0.0, 3.0, 0.2, True), (0.0, 3.2, 0.2, False), (14.9, 5.0, 5.0, True), (15.1, 5.0, 5.0, False)],
        *[(0.0, 15.0, 5.0, True), (0.0, 20.0, 5.0, False)],
    ],
)
def test_a_box_is_confirmed_by_one_five_pixels_a_second_away_within_three_seconds_or_three_frames(
    tuning: OrbitFilterTuning, pixels: float, age: float, interval: float, accepted: bool
) -> None:
    before = unit(np.array([pixels / FOCAL, 0.0, 1.0]))
    state = remembered({"direction": before, "age": age})
    measured = box(interval=interval)
    assert decide(tuning, [0.0, 0.0, 0.0], state, measured, wide=YES) is accepted


@pytest.mark.parametrize(
    ("log_size", "truncated", "accepted"), [(-3.4, NO, True), (-2.6, NO, True), (-3.6, NO, False), (-3.6, YES, True)]
)
def test_a_box_of_another_size_confirms_nothing_unless_the_frame_cuts_it(
    tuning: OrbitFilterTuning, log_size: float, truncated: jax.Array, accepted: bool
) -> None:
    state = remembered({"log_size": log_size, "truncated": truncated})
    assert decide(tuning, [0.0, 0.0, 0.0], state, wide=YES) is accepted


@pytest.mark.parametrize(
    ("boxes", "clutter", "accepted"),
    [
        ([{}], 0.5, False),
        ([{}, {"age": 2.0}], 0.5, True),
        ([{}, ELSEWHERE | {"age": 2.0}], 0.05, False),
        ([ELSEWHERE, {"age": 2.0}, {"age": 3.0}], 0.05, True),
        ([ELSEWHERE, ELSEWHERE | {"age": 2.0}, {"age": 3.0}], 0.5, False),
    ],
)
def test_the_more_false_boxes_there_are_the_more_must_agree(
    tuning: OrbitFilterTuning, boxes: list[dict[str, Any]], clutter: float, accepted: bool
) -> None:
    state = remembered(*boxes, clutter=clutter)
    assert decide(tuning, [0.0, 0.0, 0.0], state, wide=YES) is accepted


@jax.jit
def confirmations(tuning: OrbitFilterTuning, clutter: jax.Array, interval: jax.Array) -> jax.Array:
    """Whether each of 20 boxes of a target that stays where it is would be confirmed."""
    view = box_view(replace(box(), interval=interval), jnp.asarray(FOCAL), jnp.asarray(IDENTITY))
    wide = prior_of(jnp.zeros(3), jnp.asarray(VARIANCE), YES)

    def frame(state: GateState, _: None) -> tuple[GateState, jax.Array]:
        decision = outlier_gate.accept(tuning, view, state, wide, YES)
        return outlier_gate.update(tuning, view, state, decision)[0], decision.confirmed

    return jax.lax.scan(frame, replace(outlier_gate.initial(), clutter=clutter), None, length=20)[1]


@pytest.mark.parametrize("interval", [0.2, 1.0, 3.0, 10.0, 30.0])
@pytest.mark.parametrize("clutter", [0.05, 0.5, 1.0])
def test_a_target_that_every_frame_shows_is_confirmed_by_the_fourth_box(
    tuning: OrbitFilterTuning, interval: float, clutter: float
) -> None:
    found = np.asarray(confirmations(tuning, jnp.float64(clutter), jnp.float64(interval)))
    assert not found[0]
    assert np.all(found[3:])


def test_pairs_of_random_boxes_are_taken_for_the_target_once_in_thousands(tuning: OrbitFilterTuning) -> None:
    rng, runs = np.random.default_rng(7), 20000
    places = rng.uniform(-0.0875, 0.0875, (runs, 3, 2))
    directions = np.concatenate([places, np.ones((runs, 3, 1))], axis=-1)
    state = remembered({}, {"age": 2.0}, {"age": 3.0}, clutter=0.5)

    def confirmed(direction_N: jax.Array, tangent: jax.Array) -> jax.Array:
        seen = replace(box(), tangent=tangent)
        now = replace(state, direction_N=direction_N)
        return accept(tuning, now, seen, jnp.zeros(3), jnp.asarray(VARIANCE), YES, YES).accepted

    transposed = np.moveaxis(directions / np.linalg.norm(directions, axis=-1, keepdims=True), -1, 1)
    found = jax.jit(jax.vmap(confirmed))(transposed, rng.uniform(-0.0875, 0.0875, (runs, 2)))
    assert np.mean(found) < 1.0 / 1000.0


def test_the_size_of_a_confirmed_box_may_be_two_fifths_beyond_the_gate(tuning: OrbitFilterTuning) -> None:
    assert not decide(tuning, [1.0, 1.0, -5.5])
    assert decide(tuning, [1.0, 1.0, -5.5], remembered({}))
    assert not decide(tuning, [1.0, 1.0, -5.7], remembered({}))
    assert not decide(tuning, [1.0, 1.0, -5.5], remembered({}), wide=YES)
    assert not decide(tuning, [4.1, 1.0, -5.5], remembered({}))


def test_boxes_that_are_known_to_be_no_target_do_not_hold_the_camera(tuning: OrbitFilterTuning) -> None:
    supported = replace(remembered({}), supported_age=jnp.float64(1.0))
    assert bool(outlier_gate.is_promising(tuning, supported))
    assert not bool(outlier_gate.is_promising(tuning, replace(supported, contradicted=YES)))
    assert not bool(outlier_gate.is_promising(tuning, replace(supported, supported_age=jnp.float64(3.5))))


@pytest.mark.parametrize("sigmas", [-3.0, 4.0, -7.0])
def test_a_size_beyond_the_gate_counts_as_one_at_its_edge(tuning: OrbitFilterTuning, sigmas: float) -> None:
    total, noise = 0.04, 0.01
    prior = prior_of(jnp.array([0.0, 0.0, sigmas * 0.2]), jnp.full(3, total), NO)
    bounded = float(outlier_gate.bounded_size_variance(tuning, prior, jnp.float64(noise)))
    expected = max(abs(sigmas), 4.0) / 4.0
    assert (bounded + total - noise) / total == pytest.approx(expected**2)


def test_a_rejected_box_that_another_confirms_is_a_contradiction(tuning: OrbitFilterTuning) -> None:
    for rejected, confirmed in ((YES, YES), (YES, NO), (NO, YES)):
        state, _ = update(tuning, outlier_gate.initial(), IDENTITY, box(), rejected, confirmed)
        assert bool(state.contradicted) is bool(rejected & confirmed)


def test_a_box_behind_the_camera_confirms_nothing(tuning: OrbitFilterTuning) -> None:
    state = remembered({"direction": np.array([0.0, 0.0, -1.0])})
    assert not decide(tuning, [0.0, 0.0, 0.0], state, wide=YES)


def test_the_decision_has_a_smooth_derivative_near_the_gate(tuning: OrbitFilterTuning) -> None:
    def derivative(sigmas: float) -> float:
        residual = np.array([sigmas * 0.02, 0.0, 0.0])
        arguments = (tuning, outlier_gate.initial(), box(), residual, VARIANCE, NO, YES)
        return float(to_residual(*arguments)[0])

    assert derivative(3.99) < -1.0
    assert derivative(-3.99) > 1.0
    assert abs(derivative(1.0)) < 1e-6


def test_the_state_keeps_direction_and_age_of_the_last_box(
    tuning: OrbitFilterTuning,
) -> None:
    q_KN = axis_angle_quaternion([0.0, 1.0, 0.0], -np.pi / 2)  # the camera looks along x of N
    state, _ = update(tuning, outlier_gate.initial(), q_KN, box(0.1, 0.0), NO, NO)
    np.testing.assert_allclose(state.direction_N[:, 0], unit(np.array([1.0, 0.0, -0.1])), atol=1e-15)
    assert state.age[0] == 1.0
    later, _ = update(tuning, state, IDENTITY, box(present=NO), NO, NO)
    np.testing.assert_array_equal(later.direction_N, state.direction_N)
    assert later.age[0] == 2.0
    last, _ = update(tuning, later, IDENTITY, box(), NO, NO)
    np.testing.assert_array_equal(last.direction_N[:, 1], state.direction_N[:, 0])
    np.testing.assert_array_equal(last.age[:2], [1.0, 3.0])


def test_the_sixth_rejection_in_a_row_triggers_recovery_and_resets_the_count(
    tuning: OrbitFilterTuning,
) -> None:
    state, recoveries, counts = outlier_gate.initial(), [], []
    for rejected in (YES, YES, NO, YES, YES, YES, YES, YES, YES, YES):
        state, recover = update(tuning, state, IDENTITY, box(), rejected, YES)
        recoveries.append(bool(recover))
        counts.append(float(state.rejections))
    assert counts == [1, 2, 0, 1, 2, 3, 4, 5, 0, 1]
    assert recoveries == [False] * 8 + [True, False]


@pytest.mark.parametrize(("interval", "frames"), [(0.2, 30), (0.5, 12), (1.0, 6), (5.0, 6)])
def test_recovery_takes_six_seconds_of_rejected_boxes_and_six_boxes_of_a_slow_camera(
    tuning: OrbitFilterTuning, interval: float, frames: int
) -> None:
    state, recoveries = outlier_gate.initial(), []
    for _ in range(frames):
        state, recover = update(tuning, state, IDENTITY, box(interval=interval), YES, YES)
        recoveries.append(bool(recover))
    assert recoveries == [False] * (frames - 1) + [True]


@jax.jit
def update_all(tuning: OrbitFilterTuning, present: jax.Array) -> tuple[jax.Array, jax.Array]:
    """Count of rejections and recovery after each frame; every present box is rejected, though others confirm it."""

    def frame(state: GateState, present: jax.Array) -> tuple[GateState, tuple[jax.Array, jax.Array]]:
        after, recover = update(tuning, state, jnp.asarray(IDENTITY), box(present=present), present, YES)
        return after, (after.rejections, recover)

    return jax.lax.scan(frame, outlier_gate.initial(), present)[1]


def test_a_frame_without_a_box_decays_the_count_of_rejections_by_a_twentieth(
    tuning: OrbitFilterTuning,
) -> None:
    counts, recoveries = update_all(tuning, np.arange(13) % 2 == 0)
    expected = [(1.0 - 0.95**k) / 0.05 for k in range(1, 7)]  # 1, 1.95, 2.85, ... 5.30
    np.testing.assert_allclose(counts[:11:2], expected, rtol=1e-12)
    np.testing.assert_allclose(counts[1:12:2], 0.95 * np.array(expected), rtol=1e-12)
    # With the decay it takes seven rejections instead of six in a row: the seventh makes the count 6.03.
    assert np.asarray(recoveries).tolist() == [False] * 12 + [True]
    assert counts[12] == 0.0


def test_boxes_that_none_confirms_never_trigger_recovery(tuning: OrbitFilterTuning) -> None:
    state = outlier_gate.initial()
    for _ in range(20):
        state, recover = update(tuning, state, IDENTITY, box(), YES, NO)
        assert not bool(recover)
    assert state.rejections == 0.0
    assert state.clutter == pytest.approx(1.0 - 0.95 * (1.0 - 1.0 / 30.0) ** 20)


def test_confirmed_boxes_once_in_twenty_frames_never_trigger_recovery(tuning: OrbitFilterTuning) -> None:
    counts, recoveries = update_all(tuning, np.arange(4000) % 20 == 0)
    assert not np.any(recoveries)
    np.testing.assert_allclose(np.max(counts), 1.0 / (1.0 - 0.95**19), rtol=1e-9)


@pytest.mark.parametrize("present", [YES, NO])
def test_a_box_with_a_weight_is_weighed_by_the_gate_too(tuning: OrbitFilterTuning, present: jax.Array) -> None:
    limit, slope = float(tuning.gate_sigma), float(tuning.gate_slope_width)
    for sigmas in (0.0, limit - 0.01, limit + 0.02):
        residual = np.array([sigmas, 0.0, 0.0]) * np.sqrt(VARIANCE)
        measured = replace(box(present=present), weight=jnp.float64(0.7))
        found = accept(tuning, outlier_gate.initial(), measured, residual, VARIANCE, NO, YES)
        assert bool(found.accepted) == (bool(present) and sigmas < limit)
        expected = 0.7 / (1.0 + np.exp(-(limit**2 - sigmas**2) / slope))
        np.testing.assert_allclose(found.weight, expected, rtol=1e-9)
    impossible = accept(tuning, outlier_gate.initial(), measured, residual, VARIANCE, NO, NO)
    assert float(impossible.weight) == 0.0


def test_a_box_that_is_taken_out_has_no_weight() -> None:
    weighed = replace(box(), weight=jnp.float64(0.7))
    assert float(weighed.only_where(NO).weight) == 0.0
    assert float(weighed.only_where(YES).weight) == 0.7
    assert not weighed.only_where(NO).present
    assert box().only_where(YES).weight is None
