"""The gate's decision and its memory, rule by rule."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy_reference import IDENTITY, axis_angle_quaternion, unit

from rpojax.core.pytree import replace
from rpojax.flight.navigation import outlier_gate
from rpojax.flight.navigation.orbit_filter_tuning import OrbitFilterTuning
from rpojax.flight.navigation.orbit_measurements import BoxMeasurement
from rpojax.flight.navigation.outlier_gate import GateState
from rpojax.scenario.params import Params

FOCAL = jnp.float64(700.0)
YES, NO = jnp.asarray(True), jnp.asarray(False)
VARIANCE = np.full(3, 4e-4)

accept = jax.jit(outlier_gate.accept)
update = jax.jit(outlier_gate.update)
to_residual = jax.jit(jax.grad(outlier_gate.accept, argnums=5))


@pytest.fixture(scope="module")
def tuning(params: Params) -> OrbitFilterTuning:
    return params.flight.navigation


def box(x: float = 0.0, y: float = 0.0, present: jax.Array = YES, truncated: jax.Array = NO) -> BoxMeasurement:
    return BoxMeasurement(
        tangent=jnp.array([x, y]),
        log_size=jnp.float64(-3.0),
        side_px=jnp.float64(32.0),
        present=present,
        truncated=truncated,
        half_frame_tangent=jnp.full(2, 0.0875),
        attitude_variance_change=jnp.zeros(()),
    )


def decide(
    tuning: OrbitFilterTuning,
    sigmas: list[float],
    track: GateState | None = None,
    measured: BoxMeasurement | None = None,
    wide: jax.Array = NO,
    possible: jax.Array = YES,
) -> float:
    """Verdict on a box whose residuals are so many sigmas of the total variance."""
    return float(
        accept(
            tuning,
            FOCAL,
            np.eye(3),
            outlier_gate.initial() if track is None else track,
            box() if measured is None else measured,
            np.array(sigmas) * np.sqrt(VARIANCE),
            VARIANCE,
            wide,
            possible,
        )
    )


@pytest.mark.parametrize("row", range(3))
def test_four_sigma_of_bearing_or_size_is_the_border(tuning: OrbitFilterTuning, row: int) -> None:
    inside, outside = np.zeros(3), np.zeros(3)
    inside[row], outside[row] = -3.99, 4.01
    assert decide(tuning, list(inside)) == 1.0
    assert decide(tuning, list(outside)) == 0.0


def test_a_truncated_box_may_be_as_small_as_it_likes_but_no_larger_than_predicted(tuning: OrbitFilterTuning) -> None:
    cut = box(truncated=YES)
    assert decide(tuning, [1.0, 1.0, -9.0], measured=cut) == 1.0
    assert decide(tuning, [1.0, 1.0, 3.99], measured=cut) == 1.0
    assert decide(tuning, [1.0, 1.0, 4.01], measured=cut) == 0.0
    assert decide(tuning, [5.0, 1.0, 0.0], measured=cut) == 0.0


def test_no_box_and_a_target_that_cannot_give_the_box_are_never_accepted(tuning: OrbitFilterTuning) -> None:
    assert decide(tuning, [0.0, 0.0, 0.0], measured=box(present=NO)) == 0.0
    assert decide(tuning, [0.0, 0.0, 0.0], possible=NO) == 0.0


def test_without_a_box_before_it_a_box_is_only_believed_when_the_prior_is_not_wide(tuning: OrbitFilterTuning) -> None:
    assert decide(tuning, [0.0, 0.0, 0.0], wide=NO) == 1.0
    assert decide(tuning, [0.0, 0.0, 0.0], wide=YES) == 0.0


@pytest.mark.parametrize(
    ("pixels", "age", "accepted"),
    [(4.9, 1.0, 1.0), (5.1, 1.0, 0.0), (9.9, 2.0, 1.0), (10.1, 2.0, 0.0), (0.0, 3.0, 1.0), (0.0, 4.0, 0.0)],
)
def test_a_box_is_confirmed_by_one_five_pixels_a_frame_away_at_most_three_frames_ago(
    tuning: OrbitFilterTuning, pixels: float, age: float, accepted: float
) -> None:
    before = unit(np.array([pixels / float(FOCAL), 0.0, 1.0]))
    track = replace(outlier_gate.initial(), direction_N=jnp.asarray(before), age=jnp.float64(age))
    assert decide(tuning, [0.0, 0.0, 0.0], track, wide=YES) == accepted


def test_a_box_behind_the_camera_confirms_nothing(tuning: OrbitFilterTuning) -> None:
    track = replace(outlier_gate.initial(), direction_N=jnp.array([0.0, 0.0, -1.0]), age=jnp.float64(1.0))
    assert decide(tuning, [0.0, 0.0, 0.0], track, wide=YES) == 0.0


def test_the_verdict_has_a_smooth_derivative_to_the_residual_near_the_border(tuning: OrbitFilterTuning) -> None:
    def slope(sigmas: float) -> float:
        residual = np.array([sigmas * 0.02, 0.0, 0.0])
        arguments = (tuning, FOCAL, np.eye(3), outlier_gate.initial(), box(), residual, VARIANCE, NO, YES)
        return float(to_residual(*arguments)[0])

    assert slope(3.99) < -1.0
    assert slope(-3.99) > 1.0
    assert abs(slope(1.0)) < 1e-6


def test_the_memory_keeps_the_inertial_direction_of_the_last_box_and_counts_the_frames_since(
    tuning: OrbitFilterTuning,
) -> None:
    q_KN = axis_angle_quaternion([0.0, 1.0, 0.0], -np.pi / 2)  # the camera looks along x of N
    track, _ = update(tuning, outlier_gate.initial(), q_KN, box(0.1, 0.0), NO)
    np.testing.assert_allclose(track.direction_N, unit(np.array([1.0, 0.0, -0.1])), atol=1e-15)
    assert track.age == 1.0
    later, _ = update(tuning, track, IDENTITY, box(present=NO), NO)
    np.testing.assert_array_equal(later.direction_N, track.direction_N)
    assert later.age == 2.0


def test_rejections_in_a_row_are_counted_until_the_sixth_raises_doubt_and_starts_anew(
    tuning: OrbitFilterTuning,
) -> None:
    track, doubts, counts = outlier_gate.initial(), [], []
    for rejected in (YES, YES, NO, YES, YES, YES, YES, YES, YES, YES):
        track, doubt = update(tuning, track, IDENTITY, box(), rejected)
        doubts.append(bool(doubt))
        counts.append(float(track.rejections))
    assert counts == [1, 2, 0, 1, 2, 3, 4, 5, 0, 1]
    assert doubts == [False] * 8 + [True, False]


@jax.jit
def remember_all(tuning: OrbitFilterTuning, present: jax.Array) -> tuple[jax.Array, jax.Array]:
    """Count of rejections and doubt after each frame; every box there is gets rejected."""

    def frame(track: GateState, present: jax.Array) -> tuple[GateState, tuple[jax.Array, jax.Array]]:
        after, doubt = outlier_gate.update(tuning, track, jnp.asarray(IDENTITY), box(present=present), present)
        return after, (after.rejections, doubt)

    return jax.lax.scan(frame, outlier_gate.initial(), present)[1]


def test_a_missed_frame_between_rejections_fades_their_count_by_a_twentieth_and_does_not_reset_it(
    tuning: OrbitFilterTuning,
) -> None:
    counts, doubts = remember_all(tuning, np.arange(13) % 2 == 0)
    expected = [(1.0 - 0.95**k) / 0.05 for k in range(1, 7)]  # 1, 1.95, 2.85, ... 5.30
    np.testing.assert_allclose(counts[:11:2], expected, rtol=1e-12)
    np.testing.assert_allclose(counts[1:12:2], 0.95 * np.array(expected), rtol=1e-12)
    # The fading costs one more rejection than the six that raise doubt in a row: the seventh makes it 6.03.
    assert np.asarray(doubts).tolist() == [False] * 12 + [True]
    assert counts[12] == 0.0


def test_false_boxes_once_in_twenty_frames_never_raise_doubt(tuning: OrbitFilterTuning) -> None:
    counts, doubts = remember_all(tuning, np.arange(4000) % 20 == 0)
    assert not np.any(doubts)
    np.testing.assert_allclose(np.max(counts), 1.0 / (1.0 - 0.95**19), rtol=1e-9)
