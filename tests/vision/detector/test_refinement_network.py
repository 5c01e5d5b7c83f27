"""What the second look cuts out of a picture, and where it says that boxes are."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from rpojax.vision.detector import refinement_network
from rpojax.vision.detector.non_maximum_suppression import pairwise_iou, suppress_overlapping
from rpojax.vision.detector.refinement_network import boxes_from_channels
from rpojax.vision.detector.region_crop import CROP_PX, crop_boxes

SIZE = 96


def cut_one(image: jax.Array, box: jax.Array) -> tuple[jax.Array, jax.Array]:
    """The cut around one box, and where it is."""
    cuts, frames = crop_boxes(image, box[None])
    return cuts[0], frames[0]


def ramp(slope_x: float, slope_y: float) -> jax.Array:
    """A picture whose codes rise evenly."""
    place = (np.arange(SIZE) + 0.5) / SIZE
    values = slope_x * place[None, :] + slope_y * place[:, None]
    return jnp.asarray(np.repeat(values[:, :, None], 3, axis=2), jnp.float32)


@pytest.mark.parametrize("box", [(30.0, 40.0, 36.0, 44.0), (20.0, 24.0, 60.0, 70.0), (26.5, 30.0, 70.25, 38.0)])
def test_a_cut_of_a_ramp_is_a_ramp_at_the_right_place(box: tuple[float, ...]) -> None:
    found, frame = cut_one(ramp(0.6, 0.3), jnp.asarray(box, jnp.float32))
    low, high = np.asarray(frame[:2]), np.asarray(frame[2:])
    assert (low < box[:2]).all()
    assert (high > box[2:]).all()
    place = (np.arange(CROP_PX) + 0.5) / CROP_PX
    x, y = ((low[i] + place * (high[i] - low[i])) / SIZE for i in (0, 1))
    expected = 2.0 * (0.6 * x[None, :] + 0.3 * y[:, None]) - 1.0
    np.testing.assert_allclose(found[..., 0], expected, atol=3e-3)
    np.testing.assert_array_equal(found[..., 3], 1.0)


def test_nothing_is_missed_where_a_cut_is_coarser_than_the_picture() -> None:
    image = np.zeros((SIZE, SIZE, 3), np.float32)
    image[::2] = 1.0  # stripes that a sparser sampling would turn into anything
    found, _ = cut_one(jnp.asarray(image), jnp.asarray([8.0, 8.0, 88.0, 88.0], jnp.float32))
    inside = np.asarray(found[4:-4, 4:-4, 0])
    np.testing.assert_allclose(inside, 0.0, atol=0.15)


def test_beyond_the_picture_there_is_nothing_and_it_says_so() -> None:
    found, frame = cut_one(ramp(0.0, 0.0) + 0.9, jnp.asarray([80.0, 30.0, 120.0, 50.0], jnp.float32))
    low, high = float(frame[0]), float(frame[2])
    x = low + (np.arange(CROP_PX) + 0.5) / CROP_PX * (high - low)
    np.testing.assert_array_equal(np.asarray(found[CROP_PX // 2, :, 3]), (x < SIZE).astype(np.float32))
    np.testing.assert_array_equal(np.asarray(found)[:, x > SIZE, :3], 0.0)
    np.testing.assert_allclose(np.asarray(found)[8:-8, x < SIZE - 2, :3], 0.8, atol=1e-5)


def test_a_cut_has_the_slope_of_finite_differences_in_the_box() -> None:
    image = jax.random.uniform(jax.random.key(0), (SIZE, SIZE, 3), jnp.float32)
    box = jnp.asarray([20.3, 31.1, 44.2, 52.9], jnp.float32)
    weight = jax.random.normal(jax.random.key(1), (CROP_PX, CROP_PX, 4), jnp.float32)

    def readout(box: jax.Array) -> jax.Array:
        return jnp.sum(weight * cut_one(image, box)[0])

    slope = jax.grad(readout)(box)
    for edge in range(4):
        step = jnp.zeros(4, jnp.float32).at[edge].set(0.01)
        difference = (readout(box + step) - readout(box - step)) / 0.02
        assert float(slope[edge]) == pytest.approx(float(difference), rel=0.05, abs=0.3)


def test_a_network_that_says_nothing_names_the_middle_of_the_cut() -> None:
    frame = jnp.asarray([[10.0, 20.0, 50.0, 100.0]], jnp.float32)
    box, logit = boxes_from_channels(jnp.zeros((1, 5), jnp.float32), frame)
    np.testing.assert_allclose(box[0], [18.0, 36.0, 42.0, 84.0], atol=1e-4)
    assert float(logit[0]) == 0.0


def test_a_look_is_the_same_for_each_box_alone() -> None:
    params = refinement_network.initialize(jax.random.key(0))
    image = jax.random.uniform(jax.random.key(1), (64, 96, 3), jnp.float32)
    boxes = jnp.asarray([[10.0, 10.0, 30.0, 20.0], [40.0, 5.0, 90.0, 60.0]], jnp.float32)
    together, logits = refinement_network.refine_boxes(params, image, boxes)
    for index in range(2):
        alone, logit = refinement_network.refine_boxes(params, image, boxes[index : index + 1])
        np.testing.assert_allclose(alone[0], together[index], atol=1e-3)
        assert float(logit[0]) == pytest.approx(float(logits[index]), abs=1e-4)


def test_of_boxes_that_lie_over_each_other_the_first_stays() -> None:
    boxes = jnp.asarray([[0.0, 0.0, 10.0, 10.0], [1.0, 0.0, 11.0, 10.0], [20.0, 0.0, 30.0, 10.0]])
    shared = pairwise_iou(boxes, boxes)
    np.testing.assert_allclose(np.diag(shared), 1.0)
    assert float(shared[0, 1]) == pytest.approx(90.0 / 110.0)
    np.testing.assert_allclose(suppress_overlapping(boxes, jnp.asarray([0.9, 0.8, 0.1]), 0.5), [0.9, 0.0, 0.1])
