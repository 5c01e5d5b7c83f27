"""Augmented boxes stay on their spacecraft, the loss knows right from wrong, and training goes on where it was."""

from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from rpojax.training.detector import augmentation, evaluate_detector, refinement_loss, train_detector
from rpojax.training.detector.evaluate_detector import ImageDetections
from rpojax.training.detector.muon_optimizer import orthogonalize
from rpojax.training.detector.proposal_loss import maps_loss as loss
from rpojax.training.detector.training_options import NetworkTrainingOptions, NetworkTrainingProgress
from rpojax.training.detector.weight_standardization import apply_channel_gains, with_channel_gains
from rpojax.training.synthetic_data.detection_dataset import DetectionDataset
from rpojax.vision.detector.box_decoding import STRIDE
from rpojax.vision.detector.proposal_network import initialize

SIZE = 128


@pytest.fixture(scope="module")
def plates() -> DetectionDataset:
    """Bright plates on black, one in each of 40 pictures but the last, which is empty."""
    rng = np.random.default_rng(0)
    images, boxes = np.zeros((40, SIZE, SIZE, 3), np.uint8), []
    for image in images[:-1]:
        width, height = rng.integers(12, 60, 2)
        x, y = rng.integers(0, SIZE - width), rng.integers(0, SIZE - height)
        image[y : y + height, x : x + width] = rng.integers(120, 256, 3)
        boxes.append(np.array([[x, y, x + width, y + height]], np.float32))
    return DetectionDataset(images, (*boxes, np.zeros((0, 4), np.float32)), ("black",) * 40)


@pytest.mark.parametrize("pieces", [False, True])
def test_boxes_follow_their_pixels_through_every_change_of_place(
    plates: DetectionDataset, pieces: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    def plain(rng: object, image: np.ndarray, noise: object) -> np.ndarray:
        return image.astype(np.float32) / 255.0

    monkeypatch.setattr(augmentation, "augment_appearance", plain)
    made = augmentation.augment_batch(plates, np.arange(39), np.random.default_rng(1), pieces)
    side = SIZE // 2 if pieces else SIZE
    assert made.images.shape[1:] == (side, side, 3)
    assert len(made.images) == (78 if pieces else 39)
    checked = 0
    for image, boxes, weight in zip(made.images, made.boxes, made.weight, strict=True):
        bright = image.max(axis=2) > 0.2
        for box in boxes[weight == 1.0]:
            left, top, right, bottom = np.round(box).astype(int)
            # Full inside, and dark around it unless the frame ends or a mosaic's neighbour begins.
            assert bright[top + 1 : bottom - 1, left + 1 : right - 1].all()
            checked += 1
        if (weight != 0.0).sum() == 1 and (weight == 1.0).any():
            rows, columns = (np.nonzero(bright.any(axis=axis))[0] for axis in (1, 0))
            box = boxes[weight == 1.0][0]
            edges = [columns[0], rows[0], columns[-1] + 1, rows[-1] + 1]
            np.testing.assert_allclose(edges, box, atol=1.5)  # interpolation spreads an edge over a pixel
    assert checked >= 39


def test_changes_of_look_keep_codes_in_range(plates: DetectionDataset) -> None:
    made = augmentation.augment_batch(plates, np.arange(40), np.random.default_rng(2))
    assert made.images.dtype == np.float32
    assert made.images.min() >= 0.0
    assert made.images.max() <= 1.0
    assert made.weight[39].sum() == 0.0 or made.weight[39].max() == 1.0  # empty, or in a mosaic


def perfect(box: np.ndarray, cells: int = 32) -> np.ndarray:
    """Channels (1, y, x, 5) that name one box at every cell, hot at its middle only."""
    raw = np.zeros((1, cells, cells, 5), np.float32)
    place = (np.arange(cells) + 0.5) * STRIDE
    raw[..., 0] = -12.0
    middle = 0.5 * (box[:2] + box[2:])
    raw[0, int(middle[1] // STRIDE), int(middle[0] // STRIDE), 0] = 12.0
    for channel, (edge, sign) in enumerate(zip(box, (-1, -1, 1, 1), strict=True)):
        distance = sign * (edge - place) / STRIDE
        raw[0, :, :, 1 + channel] = np.arcsinh(distance[None, :] if channel % 2 == 0 else distance[:, None])
    return raw


def test_a_perfect_answer_has_no_loss_and_any_fault_has_some() -> None:
    box = np.array([20.5, 33.0, 61.0, 52.25])
    boxes = jnp.zeros((1, 8, 4), jnp.float32).at[0, 0].set(jnp.asarray(box, jnp.float32))
    weight = jnp.zeros((1, 8), jnp.float32).at[0, 0].set(1.0)
    raw = perfect(box)
    best = float(loss(jnp.asarray(raw), boxes, weight))
    assert best < 0.01
    shifted = raw.copy()
    shifted[..., 1] += 0.05
    cold, alarmed = raw.copy(), raw.copy()
    cold[..., 0] = -12.0
    alarmed[0, 28, 28, 0] = 3.0
    for fault in (shifted, cold, alarmed):
        assert float(loss(jnp.asarray(fault), boxes, weight)) > best + 0.02
    # What is neither right nor wrong may be hot without a price; with no box at all it may not.
    unsure = jnp.where(weight > 0.0, -1.0, 0.0).astype(jnp.float32)
    assert float(loss(jnp.asarray(raw), boxes, unsure)) < 0.01
    assert float(loss(jnp.asarray(raw), boxes, 0.0 * weight)) > 5.0


def test_folded_kernels_have_no_mean_and_the_length_of_their_gain() -> None:
    params = initialize(jax.random.key(0))
    trained = with_channel_gains(params)
    trained["down1"]["gain"] = trained["down1"]["gain"].at[3].set(0.25)
    kernel = apply_channel_gains(trained)["down1"]["kernel"]
    np.testing.assert_allclose(kernel.mean(axis=(0, 1, 2)), 0.0, atol=1e-6)
    lengths = np.sqrt((np.asarray(kernel) ** 2).sum(axis=(0, 1, 2)))
    before = np.asarray(params["down1"]["kernel"])
    before = np.sqrt(((before - before.mean(axis=(0, 1, 2))) ** 2).sum(axis=(0, 1, 2)))
    np.testing.assert_allclose(np.delete(lengths, 3), np.delete(before, 3), rtol=1e-5)
    assert lengths[3] == pytest.approx(0.25, rel=1e-5)
    np.testing.assert_array_equal(apply_channel_gains(trained)["out"]["kernel"], trained["out"]["kernel"])
    # What was trained before begins where it ended.
    again = apply_channel_gains(with_channel_gains(apply_channel_gains(trained)))
    np.testing.assert_allclose(again["same1"]["kernel"], apply_channel_gains(trained)["same1"]["kernel"], atol=1e-6)


@pytest.mark.parametrize("shape", [(3, 3, 16, 32), (1, 1, 64, 48), (1, 1, 8, 64)])
def test_an_orthogonal_step_has_like_singular_values_along_those_of_the_slope(shape: tuple[int, ...]) -> None:
    slope = np.random.default_rng(0).normal(size=shape).astype(np.float32)
    matrix = slope.reshape(-1, shape[-1])
    step = np.asarray(orthogonalize(jnp.asarray(slope))).reshape(matrix.shape)
    left, values, right = np.linalg.svd(matrix, full_matrices=False)
    found = left.T @ step @ right.T
    # The polynomial trades exactness for speed: values end between 0.7 and 1.2.
    assert 0.65 < np.diag(found).min() <= np.diag(found).max() < 1.25
    np.testing.assert_allclose(found - np.diag(np.diag(found)), 0.0, atol=1e-3)
    assert values.max() / values.min() > 1.5


def second_loss(asked: np.ndarray, named: np.ndarray, logit: float, weight: float = 1.0) -> tuple[float, float]:
    """Losses of edges and goodness where the second look names a box when asked about one; the truth is (20..60)."""
    frame = np.array([[0.0, 0.0, 80.0, 80.0]])
    base = np.array([0.2, 0.2, 0.8, 0.8])
    raw = np.concatenate([(named / 80.0 - base) / 0.25, [logit]])[None]
    truth, weights = np.zeros((8, 4)), np.zeros(8)
    truth[0], weights[0] = (20.0, 20.0, 60.0, 60.0), weight
    arrays = (jnp.asarray(values, jnp.float32) for values in (raw, frame, asked[None], truth, weights))
    edge, good, _ = refinement_loss._image_loss(*arrays)
    return float(edge[0]), float(good[0])


def test_the_second_look_pays_for_wrong_edges_and_for_wrong_confidence() -> None:
    truth, near, far = (np.array(b, float) for b in ((20, 20, 60, 60), (24, 18, 64, 58), (70, 70, 80, 80)))
    assert second_loss(near, truth, 9.0) == (pytest.approx(0.0, abs=1e-4), pytest.approx(0.0, abs=1e-3))
    assert second_loss(near, near, 9.0)[0] > 0.2
    assert second_loss(near, truth, -3.0)[1] > 2.0
    # Asked about nothing it pays for confidence only; what is neither right nor wrong costs nothing.
    assert second_loss(far, truth, -9.0) == (0.0, pytest.approx(0.0, abs=1e-3))
    assert second_loss(far, truth, 3.0)[1] > 2.0
    assert second_loss(near, near, 3.0, weight=-1.0) == (0.0, 0.0)


def test_the_second_look_is_asked_about_named_true_and_random_boxes() -> None:
    heat = jnp.full((32, 32), -9.0, jnp.float32).at[10, 10].set(4.0)
    edges = jnp.broadcast_to(jnp.array([30.0, 34.0, 54.0, 50.0], jnp.float32), (32, 32, 4))
    boxes = jnp.zeros((8, 4), jnp.float32).at[0].set(jnp.array([60.0, 70.0, 100.0, 96.0], jnp.float32))
    weight = jnp.zeros(8, jnp.float32).at[0].set(1.0)
    keys = jax.vmap(jax.random.key)(jnp.arange(200))
    asked = np.asarray(
        jax.jit(jax.vmap(lambda key: refinement_loss._candidate_boxes(heat, edges, boxes, weight, key)))(keys)
    )
    np.testing.assert_allclose(asked[:, 0].mean(axis=0), [30, 34, 54, 50], atol=0.5)
    np.testing.assert_allclose(asked[:, -2].mean(axis=0), boxes[0], atol=1.5)
    assert asked[:, -2].std() > asked[:, 0].std()
    assert (asked[..., 2:] >= asked[..., :2]).all()
    assert asked[:, -1, 0].std() > 20.0


@pytest.mark.slow
def test_a_training_that_was_interrupted_goes_on_to_the_same_weights(plates: DetectionDataset, tmp_path: Path) -> None:
    first, second = (
        NetworkTrainingOptions(epochs=3, batch=16, pieces_share=0.0),
        NetworkTrainingOptions(epochs=2, batch=16, pieces_share=0.0),
    )
    check = plates.subset(np.arange(4))
    whole, _ = train_detector.train(plates, check, first, second)
    checkpoint, seen = tmp_path / "checkpoint", []

    def note(look: str, step: NetworkTrainingProgress) -> None:
        seen.append((look, step.done))
        if len(seen) in (2, 4):
            raise KeyboardInterrupt

    for _ in range(2):
        with pytest.raises(KeyboardInterrupt):
            train_detector.train(plates, check, first, second, checkpoint, note)
    resumed, history = train_detector.train(plates, check, first, second, checkpoint, note)
    assert seen == [("first", 2), ("first", 4), ("first", 6), ("second", 2), ("second", 4)]
    assert [step.done for step in history["first"]] == [2, 4, 6]
    assert [step.done for step in history["second"]] == [2, 4]
    for a, b in zip(jax.tree.leaves(resumed), jax.tree.leaves(whole), strict=True):
        # Sums of a convolution's threads come in any order.
        np.testing.assert_allclose(a, b, atol=1e-3)
    train_detector.remove_checkpoints(checkpoint)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_training_learns_to_find_plates(plates: DetectionDataset) -> None:
    second = NetworkTrainingOptions(epochs=120, batch=20, pieces_share=0.0)
    params, history = train_detector.train(plates, plates, NetworkTrainingOptions(epochs=80, batch=20), second)
    assert history["first"][0].map50 < 0.1
    assert history["first"][-1].map50 > 0.8
    assert history["second"][-1].map50_95 > history["first"][-1].map50_95
    assert (
        evaluate_detector.detection_metrics(evaluate_detector.detect_images(params, plates.images), plates)[
            "median_iou"
        ]
        > 0.8
    )


def test_figures_count_misses_false_alarms_and_small_ones_as_they_say() -> None:
    truth = (
        np.array([[10.0, 10.0, 40.0, 30.0]]),
        np.array([[50.0, 50.0, 90.0, 90.0], [5.0, 5.0, 12.0, 12.0]]),
        np.zeros((0, 4)),
        np.zeros((0, 4)),
    )
    data = DetectionDataset(np.zeros((4, SIZE, SIZE, 3), np.uint8), truth, ("black", "earth", "earth", "black"))
    found = ImageDetections(
        [truth[0], truth[1][1:], np.array([[0.0, 0.0, 30.0, 30.0]]), np.array([[0.0, 0.0, 30.0, 30.0]])],
        [np.array([0.9]), np.array([0.8]), np.array([0.7]), np.array([0.1])],
    )
    figures = evaluate_detector.detection_metrics(found, data)
    assert figures["boxes"] == 2  # the third is below 16 px, and finding it changes nothing
    assert figures["recall"] == figures["median_iou"] == 0.5
    assert figures["map50"] == pytest.approx(51 / 101, abs=1e-4)
    assert figures["false_alarms_per_empty_frame"] == 0.5  # one of two is over the threshold
    report = evaluate_detector.evaluation_report(found, data)
    assert report["by_size"]["0 to 8 px"]["recall"] == 1.0
    assert report["by_background"]["black"]["recall"] == 1.0
    assert report["by_background"]["earth"]["recall"] == 0.0
