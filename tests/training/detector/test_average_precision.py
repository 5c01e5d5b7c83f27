"""Average precision agrees with pycocotools, and with a case worked by hand."""

import contextlib
import io

import numpy as np
import pytest

from rpojax.training.detector.average_precision import average_precision, pairwise_iou

Boxes = list[np.ndarray]
LEAST_PX = 16.0


def scenes(seed: int, count: int = 40) -> tuple[Boxes, list[np.ndarray], Boxes]:
    """Found boxes with scores, and true ones: some missed, some found twice, some found where nothing is."""
    rng = np.random.default_rng(seed)
    found, scores, truth = [], [], []
    for _ in range(count):
        corner = rng.uniform(0.0, 80.0, (int(rng.integers(0, 4)), 2))
        real = np.hstack([corner, corner + rng.uniform(6.0, 45.0, corner.shape)])
        again = np.repeat(real, rng.integers(0, 3, len(real)), axis=0)
        moved = again + rng.normal(scale=2.0, size=again.shape)
        extra = rng.uniform(0.0, 60.0, (int(rng.integers(0, 3)), 2))
        boxes = np.vstack([moved, np.hstack([extra, extra + rng.uniform(6.0, 40.0, extra.shape)])])
        boxes[:, 2:] = np.maximum(boxes[:, 2:], boxes[:, :2] + 1.0)
        found.append(boxes)
        scores.append(rng.uniform(size=len(boxes)))
        truth.append(real)
    return found, scores, truth


def long_sides(boxes: np.ndarray) -> np.ndarray:
    """Longer side of boxes (n, 4)."""
    return (boxes[:, 2:] - boxes[:, :2]).max(axis=1, initial=0.0)


def by_pycocotools(found: Boxes, scores: list[np.ndarray], truth: Boxes, least_px: float) -> np.ndarray:
    """Average precision at COCO's ten thresholds; its areas are made to say which boxes are out of range."""
    coco = pytest.importorskip("pycocotools.coco")
    evaluation = pytest.importorskip("pycocotools.cocoeval")

    def entries(pictures: Boxes) -> list[dict]:
        listed = []
        for index, boxes in enumerate(pictures):
            for box, side in zip(boxes, long_sides(boxes), strict=True):
                xywh = [*box[:2], *(box[2:] - box[:2])]
                listed.append({"image_id": index, "category_id": 1, "bbox": xywh, "area": side**2, "iscrowd": 0})
        return [{**entry, "id": number + 1} for number, entry in enumerate(listed)]

    with contextlib.redirect_stdout(io.StringIO()):
        real = coco.COCO()
        real.dataset = {
            "images": [{"id": index} for index in range(len(truth))],
            "categories": [{"id": 1}],
            "annotations": entries(truth),
        }
        real.createIndex()
        guesses = coco.COCO()
        scored = [
            {**entry, "score": score} for entry, score in zip(entries(found), np.concatenate(scores), strict=True)
        ]
        guesses.dataset = {**real.dataset, "annotations": scored}
        guesses.createIndex()
        judge = evaluation.COCOeval(real, guesses, "bbox")
        judge.params.areaRng = [[least_px**2, 1e10]]
        judge.params.areaRngLbl = ["all"]
        judge.evaluate()
        judge.accumulate()
    return judge.eval["precision"][:, :, 0, 0, -1].mean(axis=1)


@pytest.mark.parametrize("seed", [0, 1, 2])
@pytest.mark.parametrize("least_px", [0.0, LEAST_PX])
def test_average_precision_is_that_of_pycocotools(seed: int, least_px: float) -> None:
    found, scores, truth = scenes(seed)
    ignored = [long_sides(boxes) < least_px for boxes in truth]
    unasked = [long_sides(boxes) < least_px for boxes in found]
    expected = by_pycocotools(found, scores, truth, least_px)
    assert 0.05 < expected.mean() < 0.95  # a case with something to count
    np.testing.assert_allclose(average_precision(found, scores, truth, ignored, unasked), expected, atol=1e-9)


def test_a_case_worked_by_hand() -> None:
    truth = [np.array([[0.0, 0.0, 10.0, 10.0]]), np.array([[0.0, 0.0, 10.0, 10.0]])]
    found = [np.array([[0.0, 0.0, 10.0, 10.0]]), np.array([[20.0, 20.0, 30.0, 30.0], [0.0, 0.0, 10.0, 8.0]])]
    scores = [np.array([0.9]), np.array([0.8, 0.7])]
    # Precision 1 up to recall 0.5 (51 of 101 recalls), then 2/3; the IoU of the last box is 0.8.
    expected = (51 + 50 * 2 / 3) / 101
    precision = average_precision(found, scores, truth, thresholds=np.array([0.5, 0.85]))
    np.testing.assert_allclose(precision, [expected, 51 / 101])


def test_nothing_to_find_has_no_precision_and_overlaps_are_as_worked_by_hand() -> None:
    assert np.isnan(average_precision([np.zeros((0, 4))], [np.zeros(0)], [np.zeros((0, 4))])).all()
    a, b = np.array([[0.0, 0.0, 2.0, 2.0]]), np.array([[1.0, 0.0, 3.0, 2.0], [5.0, 5.0, 6.0, 6.0]])
    np.testing.assert_allclose(pairwise_iou(a, b), [[1 / 3, 0.0]])
